"""Notices that the load changed, from innovations alone, while the robot goes on moving.

Two hypotheses about the last n blocks of rows, given all before them: the trunk is as it was, or it jumped before the
first of them by something of the size of a payload. With ν the rows' innovations stacked, S0 their covariance and M
what a jump of unit size does to them::

    S1 = S0 + M Mᵀ,     log B = ½ (νᵀ S0⁻¹ ν - νᵀ S1⁻¹ ν) - ½ log (det S1 / det S0)

B is the Bayes factor, the generalised likelihood ratio with the jump averaged over instead of maximised. Where nothing
changed and the noise is as stated its mean is one, so by Markov's inequality a look exceeds B* with a chance of 1 / B*
at most. With seven lengths, 50 blocks a second and B* = 1e15 that is less than once in a hundred thousand years; the
margin is for noise that is neither white nor Gaussian, and for what is simplified: what joints let go of in the middle
of a stretch counts as let go before it. `scale` is of the noise as it proves to be, louder than stated or quieter. A
push that lasts is a change too: nothing tells it from a load, until it is over.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from math import log

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from stadera.estimate.square_root import SquareRoot

Array = NDArray[np.float64]


_OFTEN = 8  # places of a jump in the length of a stretch
_LOOKS = 4  # at a stretch in its own length
_NONE = slice(0, 0)


@dataclass(frozen=True)
class ChangeLimits:
    """When a change counts.

    Attributes:
        bayes_factor: B*, above which it does.
        lengths: of the stretches looked at, in blocks, long ones four times in their own length; the longest is how
            far back a jump is looked for.
        spoilt: how many blocks from the jump on are left out afterwards, for they saw both loads.
    """

    bayes_factor: float = 1e15
    lengths: tuple[int, ...] = (3, 6, 12, 24, 48, 96, 192)
    spoilt: int = 2


@dataclass(frozen=True, eq=False)
class Step:
    """One block.

    Attributes:
        time: [s], of its end.
        before: what was known before it.
        matrix, target, considered: its rows, whitened; `considered` is what errors that are not sought do to them.
        squared: νᵀ S⁻¹ ν of its own innovations.
    """

    time: float
    before: SquareRoot
    matrix: Array
    target: Array
    considered: Array
    squared: float


@dataclass(frozen=True, eq=False)
class Jump:
    """The trunk jumped before the first of `after`, of which those that saw both loads are left out already."""

    time: float
    before: SquareRoot
    after: tuple[Step, ...]
    log_bayes_factor: float


class ChangeDetector:
    """Looks at each block as it comes.

    Args:
        which: the unknowns that jump.
        std: of a jump, (k,).
        limits: None for the defaults.
        loose: the unknowns that `loosen` speaks of.
    """

    def __init__(self, which: slice, std: Array, limits: ChangeLimits | None = None, loose: slice = _NONE) -> None:
        self.limits = limits or ChangeLimits()
        self._which, self._std, self._loose = which, std, loose
        self._steps: deque[tuple[Step, Array]] = deque(maxlen=max(self.limits.lengths))
        self._loosened = np.zeros(1)
        self._count = 0

    def restart(self) -> None:
        """Forgets the blocks so far."""
        self._steps.clear()

    def loosen(self, std: Array) -> None:
        """Tells that the loose unknowns, (m,), have changed by so much: no jump of the others is to be read from it."""
        self._loosened = self._loosened + std**2

    def look(self, step: Step, scale: float = 1.0) -> Jump | None:
        """A jump, if this block makes it believable; `scale` multiplies the rows' stated variances."""
        self._steps.append((step, self._loosened))
        self._count += 1
        due = (n for n in self.limits.lengths if self._count % max(n // _LOOKS, 1) == 0)
        if not any(self._jumped(n, scale) for n in due):
            return None
        factors = {n: self.log_bayes_factor(n, scale) for n in self._candidates()}
        best = max(factors, key=lambda n: factors[n])
        steps = tuple(step for step, _ in self._steps)[-best:]
        before = steps[0].before
        if (loosened := self._since(best)).any():
            before = before.diffuse(self._loose, loosened)
        return Jump(steps[0].time, before, steps[self.limits.spoilt :], factors[best])

    def _candidates(self) -> Iterator[int]:
        """How many blocks ago it may have jumped: each of the last ones, further back more coarsely."""
        blocks = 1
        while blocks <= len(self._steps):
            yield blocks
            blocks += max(1, blocks // _OFTEN)

    def _since(self, blocks: int) -> Array:
        """By how much loose unknowns have changed in the last so many blocks, 1 σ."""
        return np.asarray(np.sqrt(self._loosened - self._steps[-blocks][1]))

    def _jumped(self, blocks: int, scale: float) -> bool:
        """Whether the last so many blocks speak for a jump. Cheap first: log B is hardly more than half of what their
        own innovations come to; with errors considered, which tie blocks together, and louder noise that is no bound.
        """
        if blocks > len(self._steps):
            return False
        least = log(self.limits.bayes_factor)
        most = 0.5 * sum(step.squared for step, _ in islice(reversed(self._steps), blocks)) / scale
        return most > least and self.log_bayes_factor(blocks, scale) > least

    def log_bayes_factor(self, blocks: int, scale: float) -> float:
        """log B of a jump before the last so many blocks."""
        steps = [step for step, _ in self._steps][-blocks:]
        known, loosened = steps[0].before, self._since(blocks)
        H, y = np.vstack([s.matrix for s in steps]), np.concatenate([s.target for s in steps])
        T, M = H @ known.root, H[:, self._which] * self._std
        T[:, len(known) :] += np.vstack([s.considered for s in steps])
        if loosened.any():
            T = np.hstack([T, H[:, self._loose] * loosened])
        # S0 = scale + T Tᵀ: by the Woodbury identity all is in the dimensions of T's columns and the jump's own
        inner = lapack.dpotrf(scale * np.eye(T.shape[1]) + T.T @ T, lower=1)[0]
        both = np.column_stack((M, y - H @ known.mean))
        seen = lapack.dtrtrs(inner, T.T @ both, lower=1)[0]
        felt = (M.T @ both - seen[:, :-1].T @ seen) / scale
        volume = lapack.dpotrf(np.eye(M.shape[1]) + felt[:, :-1], lower=1)[0]
        jumped = lapack.dtrtrs(volume, felt[:, -1], lower=1)[0]
        return float(0.5 * jumped @ jumped - np.log(np.diag(volume)).sum())
