"""How far an estimate scatters within a log, by parts of it: batch means.

Rows A θ + C p = b, of weight W, leave the residual r = b - A θ̂ - C p̂. Over one part of a log they pull the estimate by

    s = N⁻¹ Σ Aᵀ W r,      N = R⁻¹ᵀ R⁻¹ of all parts (`stadera.trunk.segment`)

and all these pulls together are zero. Of n parts that are longer than what successive rows have in common, Σ s sᵀ times
n/(n - 1) is the covariance of θ̂ by the rows, whatever their noise (Flegal and Jones, Batch means and spectral variance
estimators in Markov chain Monte Carlo, Ann. Stat. 38 (2010) 1034). What returns alike with every step is in no pull of
whole steps, and cancels between two loads; noise, impacts between samples, and friction that drifts are in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stadera.types import Array


@dataclass(frozen=True, eq=False)
class Batches:
    """Aᵀ W times all columns, summed up over successive parts of the rows, at most 16 that grow with the log.

    Attributes:
        parts: (10, columns) each, over their weight. weights: of their blocks [1]. The last one is not complete.
        length: weight of a part as it was completed [1]; the first ones take half a second, as long as a step.
    """

    MOST: ClassVar = 16  # number of parts

    parts: tuple[Array, ...] = ()
    weights: tuple[float, ...] = ()
    length: float = 25.0

    def add(self, columns: Array, weight: float, share: float, keep: float) -> Batches:
        """With one more block.

        Args:
            columns: (6, ...), of A and all others. weight: of the rows. share: of these that counts.
            keep: weight that everything before is left with.
        """
        product, own = weight * columns[:, :10].T @ columns, weight * share
        parts, weights, length = self.parts, [keep * each for each in self.weights], self.length
        if parts and self.weights[-1] < length:
            product += weights[-1] * parts[-1]
            own += weights[-1]
            parts, weights = parts[:-1], weights[:-1]
        elif len(parts) == self.MOST:
            # of a log longer than the memory, the oldest two have faded to less than one
            pairs = 1 if weights[0] + weights[1] < length else self.MOST // 2
            length = length if pairs == 1 else 2.0 * length
            both = [slice(k, k + 2) for k in range(0, 2 * pairs, 2)]
            means = [np.average(parts[two], axis=0, weights=weights[two]) for two in both]
            parts, weights = (
                (*means, *parts[2 * pairs :]),
                [*(sum(weights[two]) for two in both), *weights[2 * pairs :]],
            )
        return Batches((*parts, product / own), (*weights, own), length)

    def pulls(self, inverse: Array, combination: Array) -> tuple[Array, float]:
        """Pulls s (10, n) of the parts, and how many parts of equal weight would tell as much [1].

        Args:
            inverse: N⁻¹ (10, 10). combination: factors of the columns whose sum is the residual.
        """
        weights, pulls = np.array(self.weights), self.parts @ combination
        count = float(weights.sum() ** 2 / max(weights @ weights, 1e-300))
        return inverse @ (weights[:, None] * pulls).T, count
