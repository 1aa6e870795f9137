"""Loads elsewhere than on the trunk: what rows tell of one on a given link, and how likely it is to be there.

Before the load came, rows were summed up to R₀ θ + G₀ p = z₀, and since then to the triangle of
`stadera.trunk.segment`. With Y the columns of those links of Q and L on which the load is, one least squares has all:

    [ R₀     ]       [G₀]     [z₀]
    [ R   Q_Y] [θ]   [G ]     [z ]
    [     L_Y] [φ] + [H ] p = [y ]
    [     N_Y]       [J ]     [x ]

the last rows, of the limbs alone, times the root of `Segment.louder`. Their rows of before tell errors only. A load on
the trunk has the columns R themselves. What remains after θ and φ are eliminated, E = |z'' - G'' p|², is compared
between places. With p normally distributed about zero, of covariance Σ₀, and rows of variance σ²,

    -2 ln P = min_p (E/σ² + φᵀ (σ² V + Ψ)⁻¹ φ + pᵀ Σ₀⁻¹ p) + ln |1 + Σ₀ Gᵀ G/σ²| + ln |1 + Ψ V⁻¹/σ²|

up to a constant: φ is what the rows tell of the load given p, and V = (R_φᵀ R_φ)⁻¹ its covariance by unit noise; G are
the columns of p in what remains, E's rows and φ's. A load has the covariance Ψ, the usual one, wherever it is: a place
where rows tell more of it is the less likely the wider that is. R_φ contains a prior that is so wide that it tells
nothing. σ² is the same for all places: that of the best one, times the number of rows that share one error. Static
friction, which may change with the load, counts as two errors in p, one before it came and one since; scales of torques
are left out: target and their columns have the same noise, which a scale of nothing would explain. What rows at rest
leave beyond the triangles is noise, and left out too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from stadera.trunk.error_model import QUIETEST
from stadera.trunk.swing import root_of
from stadera.types import Array

if TYPE_CHECKING:
    from stadera.trunk.segment import Segment

Blocks = tuple[int, ...]
"""Where a load is: 0 for the trunk, k for the k-th place; two of them if it is held at both."""


@dataclass(frozen=True, eq=False)
class Held:
    """A load at some places, and the trunk as it was before it came."""

    at: Blocks
    before: Segment


@dataclass(frozen=True, eq=False)
class Solved:
    """What rows tell of n unknowns.

    Attributes:
        inverse: (n, m), a root of their covariance by the rows' unit noise. solution: (n, 1 + errors), their values and
            what errors do to them.
        before: (n, changing), the part of that by rows before the load came, of errors that may have changed since.
    """

    inverse: Array
    solution: Array
    before: Array

    @property
    def sensitivity(self) -> Array:
        """K (n, errors)."""
        return self.solution[..., 1:]

    @classmethod
    def stack(cls, known: Sequence[Solved | Segment], few: slice) -> Solved:
        """A few of the unknowns of W ones at once, (W, ...); no error changes."""
        inverse, solution = (np.array([getattr(each, name)[few] for each in known]) for name in ("inverse", "solution"))
        return cls(inverse, solution, np.empty((10, 0)))

    def mean(self, errors: Array) -> Array:
        """The unknowns (n,), given errors p̂ (errors,)."""
        return np.asarray(self.solution[:, 0] - self.sensitivity @ errors)

    def part(self, begin: int, end: int) -> Solved:
        """Some of the unknowns."""
        return Solved(self.inverse[begin:end], self.solution[begin:end], self.before[begin:end])

    def plus(self, other: Solved) -> Solved:
        """The sums of as many unknowns."""
        return Solved(self.inverse + other.inverse, self.solution + other.solution, self.before + other.before)


@dataclass(frozen=True, eq=False)
class TrunkAndLoad:
    """What rows tell of the trunk and of a load, ten unknowns each; of a load held at two places, 20.

    Attributes:
        trunk, load: each alone. whole: both together, mass by mass.
        left: (..., 1 + errors), rows that are left; before: (..., changing), as of `Solved`.
        columns: places of the load's columns among those of all loads.
    """

    trunk: Solved
    load: Solved
    left: Array
    before: Array
    columns: Array

    @property
    def whole(self) -> Solved:
        """All together."""
        out = self.trunk
        for begin in range(0, len(self.load.solution), 10):
            out = out.plus(self.load.part(begin, begin + 10))
        return out

    def of_usual(self, size: Array, loud: float) -> tuple[Array, Array, float]:
        """Rows that are left, (k, 1 + errors) and (k, changing), with those of a load of usual `size` (10,) at each
        place, in units of noise of variance `loud`; and ln |1 + Ψ V⁻¹/σ²|.
        """
        inverse, size = self.load.inverse, np.tile(size, len(self.load.inverse) // 10)
        lower = np.linalg.cholesky(inverse @ inverse.T + np.diag(size**2 / loud))
        alone = np.abs(inverse[:, -len(inverse) :].diagonal())  # V's root is a triangle
        value, before = (lapack.dtrtrs(lower, x, lower=1)[0] for x in (self.load.solution, self.load.before))
        determined = 2.0 * float(np.log(lower.diagonal() / alone).sum())
        return np.vstack([self.left, value]), np.vstack([self.before, before]), determined


def solve(since: Segment, held: Held, louder: float) -> TrunkAndLoad:
    """What the rows since a load came tell of it and of the trunk, together with those before.

    Args:
        louder: as of `Segment`, with which the limbs' rows count.
    """
    layout, T, before = since.layout, since.triangle, held.before
    end, loads, count = 11 + layout.count, len(since.below), 10 + 10 * len(held.at)
    below = np.vstack([since.below, sqrt(louder) * since.limbs])
    of_trunk = np.vstack([T[:, :10], np.zeros((len(below), 10))])
    elsewhere = np.vstack([T[:, end:], below[:, :loads]])
    columns = np.concatenate([10 * (k - 1) + np.arange(10) for k in held.at])
    at = [of_trunk if k == 0 else elsewhere[:, 10 * (k - 1) : 10 * k] for k in held.at]
    changing = layout.changing_at
    earlier = before.triangle[:, 10:end]
    rows = np.vstack(
        [
            np.hstack([before.triangle[:, :10], np.zeros((10, count - 10)), earlier, earlier[:, 1 + changing]]),
            np.hstack(
                [of_trunk, *at, np.vstack([T[:, 10:end], below[:, loads:]]), np.zeros((len(of_trunk), len(changing)))]
            ),
        ]
    )
    triangle, left = folded(np.empty((0, rows.shape[1])), rows, 1.0, count)
    inverse = lapack.dtrtri(triangle[:, :count])[0]
    solved, width = inverse @ triangle[:, count:], 1 + layout.count
    whole = Solved(inverse, solved[:, :width], solved[:, width:])
    return TrunkAndLoad(whole.part(0, 10), whole.part(10, count), left[:, :width], left[:, width:], columns)


def log_odds(
    since: Segment,
    before: Segment,
    places: Sequence[Blocks],
    covariance: Array,
    repeats: float,
    usual: Array,
) -> Array:
    """ln P of a load at each of some places, up to a constant, (places,); see the module's text.

    Args:
        since: rows since the load came. before: those before it.
        covariance: Σ₀ (errors, errors), of the errors before any row.
        repeats: number of rows that share one error.
        usual: (10,), roots of Ψ's diagonal, of a load at one place.
    """
    root, changing = root_of(covariance), since.layout.changing_at
    # of errors since the load came, and of those before it that may have changed; scales of torques explain nothing
    shown = root[:, np.union1d(np.arange(since.layout.learnt.stop), changing)]
    here = np.pad(shown, ((0, 0), (0, len(changing))))
    then = np.zeros((len(changing), here.shape[1]))
    then[:, shown.shape[1] :] = root[np.ix_(changing, changing)]
    earlier = here.copy()
    earlier[changing] = then
    base, limbs = since.beyond, since.louder * before.of_limbs
    normal = here.T @ base[1:, 1:] @ here + earlier.T @ limbs[1:, 1:] @ earlier
    along = here.T @ base[1:, 0] + earlier.T @ limbs[1:, 0]
    rows = since.count + since.limb_count + before.limb_count
    found = [solve(since, Held(at, before), since.louder) for at in places]

    def evaluated(loud: float, size: Array) -> list[tuple[float, float]]:
        """Of each place, the minimum times σ² and both ln, with a load's usual `size`: of the rows that all have in
        common, and what the place's own ones and its load add, given those.
        """
        system = normal.copy()
        system.flat[:: len(system) + 1] += loud
        factor = lapack.dpotrf(system, lower=1)[0]
        half, sizes = lapack.dtrtrs(factor, along, lower=1)[0], factor.diagonal() / sqrt(loud)
        out = []
        for each in found:
            rows_left, before_left, determined = each.of_usual(size, loud)
            errors = rows_left[:, 1:] @ here + before_left @ (then - here[changing])
            moved = lapack.dtrtrs(factor, errors.T, lower=1)[0]
            away, own = rows_left[:, 0] - half @ moved, moved.T @ moved
            own.flat[:: len(own) + 1] += 1.0
            lower = lapack.dpotrf(own, lower=1)[0]
            away = lapack.dtrtrs(lower, away, lower=1)[0]
            spread = 2.0 * float(np.log(sizes).sum() + np.log(lower.diagonal()).sum())
            out.append((float(base[0, 0] + limbs[0, 0] - half @ half + away @ away), spread + determined))
        return out

    least = min(energy for energy, _ in evaluated(repeats, 1e6 * usual))  # noise is what any load leaves
    loud = repeats * max(least / max(rows, 1.0), QUIETEST)
    return np.array([-0.5 * (energy / loud + spread) for energy, spread in evaluated(loud, usual)])


def folded(triangle: Array, columns: Array, root: float, unknowns: int) -> tuple[Array, Array]:
    """A triangle [R z G], multiplied by `root`, with the rows [A b C] added, and the rows [b C] that these leave, up to
    an orthogonal matrix; R and A have so many `unknowns`.
    """
    kept = len(triangle)
    stacked = np.empty((kept + len(columns), triangle.shape[1]), order="F")
    np.multiply(root, triangle, out=stacked[:kept])
    stacked[kept:] = columns
    factor = lapack.dgeqrf(stacked, overwrite_a=True)[0]
    factor[_below(factor.shape)] = 0.0
    return factor[:unknowns], factor[unknowns:, unknowns:]


@lru_cache(maxsize=64)
def _below(shape: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Places below the diagonal."""
    return np.tril_indices(shape[0], -1, shape[1])
