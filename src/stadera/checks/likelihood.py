"""Marginal likelihood of rows with nuisances: how well a log, as recorded or corrected, explains itself.

Rows b = H θ + C p + s · noise, θ another one in every second, p of usual size and the same in all. After θ is
eliminated from each second, products of b and C with themselves are all that is needed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from stadera.trunk.error_model import QUIETEST
from stadera.types import Array


class Products(NamedTuple):
    """Of b and C, with p in units of its usual size, by second.

    Attributes:
        squares: (seconds, 1 + p, 1 + p). counts: (seconds,), numbers of rows, less what θ has if that is free.
        spreads: (seconds,), ln |1 + Hᵀ H| of θ in units of its usual size; zero if it is free, or H the same in all.
    """

    squares: Array
    counts: Array
    spreads: Array

    def without(self, second: int) -> Products:
        """All but one second."""
        return Products(*(np.delete(part, second, axis=0) for part in self))

    def likelihood(self, repeated: float) -> Likelihood:
        """With `repeated` successive instants that share one error."""
        found = Likelihood.of(self.squares.sum(axis=0), int(self.counts.sum()), repeated)
        return replace(found, cost=found.cost + float(self.spreads.sum()))

    def gains_always(self, other: Products, least: float, repeated: float) -> bool:
        """True if another log costs less by so much, also without any one second."""
        pairs = ((self.without(k), other.without(k)) for k in range(len(self.counts)))
        return all(now.likelihood(repeated).cost - then.likelihood(repeated).cost > least for now, then in pairs)


def explained(matrix: Array, weak: float) -> Array:
    """A basis (n, k) of what a matrix (n, k) explains, with a prior of precision `weak`²."""
    prior = weak * np.eye(matrix.shape[1])
    return np.asarray(np.linalg.qr(np.vstack([matrix, prior]))[0][: len(matrix)])


def less(columns: Array, basis: Array) -> Array:
    """Products of columns after what a basis explains of them is taken out."""
    along = basis.T @ columns
    return np.asarray(columns.T @ columns - along.T @ along)


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Of rows from which θ was eliminated, with p in units of its usual size."""

    cost: float  # -2 log L
    variance: float  # s² k of a row
    # value, vector: eigenvalues and vectors of Cᵀ C, with p in units of its usual size
    value: Array
    vector: Array

    @classmethod
    def of(cls, products: Array, count: int, repeated: float) -> Likelihood:
        """From the products of b and C, (1 + p, 1 + p), over `count` rows, of which `repeated` share an error."""
        value, vector = np.linalg.eigh(products[1:, 1:])
        value, along = np.maximum(value, 0.0), (vector.T @ products[1:, 0]) ** 2
        scales = QUIETEST * 10.0 ** np.arange(0.0, 4.0, 0.125)  # s², the rows' unit is 1 % of a weight or a limit
        k = repeated * scales[:, None]
        squares = (products[0, 0] - (along / (k + value)).sum(axis=1)) / k[:, 0]
        costs = squares + count / repeated * np.log(scales) + np.log1p(value / k).sum(axis=1)
        best = int(np.argmin(costs))
        return cls(float(costs[best]), float(k[best, 0]), value, vector)
