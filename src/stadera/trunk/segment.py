"""Information on the trunk and on the model errors, summed up over the blocks since the last change of the load.

Rows A θ + C p = b, weighted by a constant W, are summed up to R θ + G p = z. With p of mean p̂ and covariance Σ,

    θ̂ = R⁻¹ (z - G p̂),      cov θ̂ = v R⁻¹ R⁻ᵀ + K Σ Kᵀ,      K = R⁻¹ G

with v the rows' variance in their unit (`stadera.trunk.joint_errors`).

The rows that remain after θ is eliminated tell p (`stadera.trunk.joint_errors`).

A load elsewhere than on the trunk, of parameters φ in the links on which it may be, and the rows of the limbs, which
have no θ, make the triangle go on below:

    [ R  Q ] [θ]   [G]     [z]
    [    L ]       [H]     [y]
    [    N ] [φ] + [J] p = [x]

the last rows are those of the limbs alone, in the unit of each joint's residual in the log. Legs and limbs err by
different amounts, of which a model says nothing: friction of a humanoid's knees that hold in a sway is 10 % of its
weight in single rows, while its arms' torques follow. So both are summed up apart, and the rows of the limbs count with
the variance of the trunk's rows, `Segment.louder`. Without a load elsewhere φ is zero. With one, see
`stadera.trunk.placed`.

A robot that is loaded sags a little, and then static friction holds a part of the load until the joints have moved
again, by a step or a sway: a crawl seems to carry 3 to 10 % of the robot less than it does for two seconds. Friction of
a joint that has slid forward and backward under the load no longer depends on how the load came. So with H what the
friction of all others may do to a block's rows, one standard deviation of it, and n the number of rows that share it,

    rows ← (1 + n H Hᵀ)^-1/2 rows

Its friction at rest is another one each time: a mean, as of any joint at standstill, and a deviation from it, whose
mean over some rests is `ModelErrors.rests` of what holds a joint that has not moved. A joint that pauses in its
stances, as knees of a trot may, comes to rest in the same way in each, and in another way under a load: there the
deviation is whole. Payloads of 25 simulated trots are at most 1.6 standard deviations off with it, 3.4 without, and
those of three others, whose knees pause for a fifth to a half of each stance, 2.4 in place of 6.6; of eleven fresh ones
one is 3.4. Knees of a real Mini Cheetah do not pause: its bars are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf, sqrt

import numpy as np
from scipy.linalg import lapack

from stadera.body.rows import discounted
from stadera.trunk.batches import Batches
from stadera.trunk.block_rows import WeightedRows
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.placed import Held, Solved, TrunkAndLoad, folded, solve
from stadera.types import Array

_KINDS = 3  # of residues: of blocks at rest, of blocks in motion, and of limbs
_OF_LIMBS = 2
_SUMMED = ("remainder", "in_motion", "moved", "white", "stepped", "limb_count", "of_limbs")  # over segments


class Residues:
    """Rows that are left by blocks, of each kind.

    Their products are summed on first use, over all blocks since the last sums that are known: one product of stacked
    rows instead of one a block.

    Args:
        width: columns of the rows. before: of the blocks before the last one, None before any, which count `keep`
            times. rows: of the last block, by kind.
    """

    def __init__(
        self, width: int, before: Residues | None = None, keep: float = 1.0, rows: Sequence[tuple[int, Array]] = ()
    ) -> None:
        self._width, self._before, self._keep, self._rows = width, before, keep, rows

    @cached_property
    def products(self) -> list[Array]:
        """(1 + errors, 1 + errors), of blocks at rest, of blocks in motion, and of limbs."""
        scale, at, stacked = 1.0, self, [[] for _ in range(_KINDS)]  # type: float, Residues, list[list[Array]]
        while at._before is not None and "products" not in at.__dict__:
            for kind, rows in at._rows:
                stacked[kind].append(sqrt(scale) * rows)
            scale, at = scale * at._keep, at._before
        known = at.__dict__.get("products", _KINDS * [np.zeros((self._width, self._width))])
        self._before, self._rows = None, ()
        rows_of = [np.concatenate(rows) if rows else np.zeros((0, self._width)) for rows in stacked]
        return [rows.T @ rows + scale * total for rows, total in zip(rows_of, known, strict=True)]


@dataclass(frozen=True, eq=False)
class Segment:
    """Summed rows.

    Attributes:
        layout: places of the errors.
        triangle: (10, 10 + 1 + errors + loads), R, z, G and Q.
        count, limb_count: number of rows, with forgetting.
        white: Σ of the rows' white variance [1].
        blocks: number of blocks.
        moved: sum of the weights of blocks in which the robot moves [1]. stepped: of those in which it walks.
        below, limbs: (loads, loads + 1 + errors), L, y and H, and N, x and J.
        louder: variance of the trunk's rows in their unit [1]; that of the limbs' is one.
        held: where a load is that the trunk does not contain, and the trunk without it; None if there is none.
        slid: (2, joints), sums of the weights of blocks in which joints slide forward, and backward [1].
        batches: what parts of the rows tell, one after the other.
        residues: rows that blocks leave beyond the triangles.
    """

    layout: ErrorLayout
    triangle: Array
    residues: Residues
    count: float = 0.0
    white: float = 0.0
    blocks: int = 0
    moved: float = 0.0
    stepped: float = 0.0
    below: Array = field(default_factory=lambda: np.zeros((0, 0)))
    held: Held | None = None
    slid: Array = field(default_factory=lambda: np.zeros((2, 1)))
    limbs: Array = field(default_factory=lambda: np.zeros((0, 0)))
    limb_count: float = 0.0
    louder: float = 1.0
    batches: Batches = field(default_factory=Batches)

    @classmethod
    def prior(cls, mean: Array, std: Array, layout: ErrorLayout, places: int = 0, held: Held | None = None) -> Segment:
        """The prior of the trunk, mean and standard deviation (10,), and of loads at so many `places`, before any
        row.
        """
        width = 11 + layout.count
        triangle, below = np.zeros((10, width + 10 * places)), np.zeros((10 * places, 10 * places + width - 10))
        triangle[:, :10], triangle[:, 10] = np.diag(1.0 / std), mean / std
        below[:, : 10 * places] = np.diag(np.tile(1.0 / std, places))
        return cls(layout, triangle, Residues(width - 10), below=below, held=held, limbs=np.zeros_like(below))

    def add(self, rows: WeightedRows, keep: float = 1.0, louder: float | None = None) -> Segment:
        """Returns the segment with one more block, the weight of everything before it multiplied by `keep`.

        Args:
            louder: see `Segment`; None as it is.
        """
        moving, rows = self.moves(rows), self.felt(rows)
        weight = rows.weight * rows.share
        triangle, residue = folded(self.triangle, sqrt(rows.weight) * rows.columns, sqrt(keep), 10)
        below, residue = _folded_loads(self.below, residue, keep)
        limbs, limb_count = sqrt(keep) * self.limbs, keep * self.limb_count
        left: tuple[tuple[int, Array], ...] = ((int(moving), residue),)
        if rows.limbs is not None:
            limbs, residue = _folded_loads(limbs, sqrt(rows.limb_weight) * rows.limbs[:, 10:], 1.0)
            left = (*left, (_OF_LIMBS, residue))
            limb_count += rows.limb_weight * float(np.count_nonzero(rows.limbs.any(axis=1)))
        return Segment(
            self.layout,
            triangle,
            Residues(1 + self.layout.count, self.residues, keep, left),
            keep * self.count + 6.0 * weight,
            keep * self.white + weight * rows.white,
            self.blocks + 1,
            keep * self.moved + weight * moving,
            keep * self.stepped + weight * (moving and rows.stepping),
            below,
            self.held,
            keep * self.slid + weight * rows.slides,
            limbs,
            limb_count,
            self.louder if louder is None else louder,
            self.batches.add(rows.columns, rows.weight, rows.share, keep),
        )

    def felt(self, rows: WeightedRows) -> WeightedRows:
        """The rows without what friction may hide in them, see the module's text. While a robot has only stood all are
        alike, and left as they are.
        """
        if rows.hidden is None or not ((moves := self.moves(rows)) or self.moved):
            return rows
        free = (self.slid > 0.0).all(axis=0)
        columns = rows.columns.copy()
        if moves:  # what a robot that has stopped holds lasts
            C, place = columns[:, 11:], self.layout.places
            lifts = np.sign(columns[:3, 0] @ C[:3, place["offset"]])  # the sign of `stiction`, see `stadera.trunk.rows`
            C[:, place["standstill"]] -= free * lifts * C[:, place["stiction"]]
            C[:, place["stiction"]] *= np.where(free, rows.rests, 1.0)
            C[:, place["stiction"]] -= rows.pauses * lifts * C[:, place["standstill"]]  # of joints that do not stand
        if free.all():
            return replace(rows, columns=columns, hidden=None)
        felt = discounted(np.hstack([columns, np.eye(6)]), rows.hidden * ~free)
        share = float((felt[:, -6:] ** 2).sum()) / 6.0
        return replace(rows, columns=felt[:, :-6], share=share, hidden=None)

    def moves(self, rows: WeightedRows) -> bool:
        """True if at least half of the joints move in a block. The columns of a robot at rest are noise, and its
        friction holds what it likes: they tell nothing about the errors of its model.
        """
        place = self.layout.sticking
        sticking = rows.columns[:, 11 + place.start : 11 + place.stop].any(axis=0)
        return 2 * int(np.count_nonzero(sticking)) <= self.layout.joints

    def with_load(self, held: Held | None) -> Segment:
        """The same rows with a load elsewhere; itself if it is the same."""
        return self if held is self.held else replace(self, held=held)

    @property
    def steps(self) -> bool:
        """True if feet move relative to each other in a tenth of all blocks: a third in a crawl, 2 % in a sway."""
        return self.stepped > 0.1 * self.weight

    @property
    def weight(self) -> float:
        """Sum of the weights of the blocks, with forgetting [1]."""
        return self.count / 6.0

    @property
    def remainder(self) -> Array:
        """(1 + errors, 1 + errors), products of targets and errors, summed over the trunk's rows after eliminating θ,
        and φ if there is a load elsewhere.
        """
        left, (rest, moving, _) = self._left(0.0), self.residues.products
        return rest + moving + left.T @ left

    @property
    def of_limbs(self) -> Array:
        """The same of the limbs' rows, after eliminating φ if there is a load elsewhere."""
        left = self.limbs[:, len(self.below) :] if self.held is None else np.zeros((0, 1 + self.layout.count))
        return self.residues.products[2] + left.T @ left

    @property
    def in_motion(self) -> Array:
        """The same as `remainder` of blocks in which the legs move; with a load elsewhere what is left of the triangle
        is of limbs too.
        """
        left = self._left(0.0 if self.held is None else self.louder)
        return self.residues.products[1] + left.T @ left

    @property
    def beyond(self) -> Array:
        """The same of blocks in which the legs move, and of limbs, without what a load somewhere may explain."""
        return self.residues.products[1] + self.louder * self.residues.products[2]

    def _left(self, louder: float) -> Array:
        """(..., 1 + errors), rows of the triangle that are left."""
        if self.held is not None:
            return self._load.left if self._load and louder == self.louder else solve(self, self.held, louder).left
        loads = len(self.below)
        return np.vstack([self.below[:, loads:], sqrt(louder) * self.limbs[:, loads:]])

    @cached_property
    def _load(self) -> TrunkAndLoad | None:
        return None if self.held is None else solve(self, self.held, self.louder)

    @property
    def whole(self) -> Solved | Segment:
        """What is known of all that the robot carries and its trunk together."""
        return self if self._load is None else self._load.whole

    @property
    def load(self) -> Solved | None:
        """What is known of a load elsewhere than on the trunk."""
        return None if self._load is None else self._load.load

    @cached_property
    def trunk(self) -> Solved:
        """What is known of the trunk, without a load elsewhere."""
        if self._load is not None:
            return self._load.trunk
        inverse = lapack.dtrtri(self.triangle[:, :10])[0]
        return Solved(inverse, inverse @ self.triangle[:, 10 : 11 + self.layout.count], np.empty((10, 0)))

    @property
    def inverse(self) -> Array:
        """R⁻¹, (10, 10); (10, more) with a load elsewhere."""
        return self.trunk.inverse

    @property
    def solution(self) -> Array:
        """R⁻¹ z and K, (10, 1 + errors)."""
        return self.trunk.solution

    @property
    def sensitivity(self) -> Array:
        """K (10, errors): errors p that are not subtracted move the estimate by K p."""
        return self.trunk.sensitivity

    def mean(self, errors: Array) -> Array:
        """θ̂ (10,), given errors p̂ (errors,)."""
        return -self.combination(errors)[:10]

    def combination(self, errors: Array) -> Array:
        """Factors of a block's columns whose sum is its residual b - A θ̂ - C p - Y φ̂, given errors p (errors,)."""
        last = self.__dict__.get("_combination")
        if last is None or last[0] is not errors:
            last = self.__dict__["_combination"] = errors, self._combined(errors)
        return np.asarray(last[1])

    def _combined(self, errors: Array) -> Array:
        out, end = np.zeros(self.triangle.shape[1]), 11 + self.layout.count
        out[10], out[11:end] = 1.0, -errors
        if self._load is None:
            out[:10] = -self.solution @ out[10:end]
        else:
            out[:10], out[end + self._load.columns] = -self._load.trunk.mean(errors), -self._load.load.mean(errors)
        return out

    def by_errors(self, columns: Array) -> Array:
        """What errors do to the residual of rows (..., columns): C - A K - Y K_φ, (..., errors)."""
        end = 11 + self.layout.count
        moved = columns[..., 11:end] - columns[..., :10] @ self.sensitivity
        if self._load is not None:
            moved = moved - columns[..., end + self._load.columns] @ self._load.load.sensitivity
        return np.asarray(moved)

    def by_noise(self, columns: Array) -> Array:
        """What rows of unit noise that the estimate has do to the residual of rows (..., columns): A R⁻¹ + Y R_φ⁻¹."""
        moved = columns[..., :10] @ self.inverse
        if self._load is not None:
            moved = moved + columns[..., 11 + self.layout.count + self._load.columns] @ self._load.load.inverse
        return np.asarray(moved)


def _folded_loads(triangle: Array, rows: Array, keep: float) -> tuple[Array, Array]:
    """`folded` by the columns of loads, which are the last ones of `rows` and the first of the triangle."""
    loads = len(triangle)
    if not loads:
        return triangle, rows
    return folded(triangle, np.hstack([rows[:, -loads:], rows[:, :-loads]]), sqrt(keep), loads)


@dataclass(frozen=True, eq=False)
class RowSums:
    """Sums over the rows of all loads, with θ eliminated.

    Attributes:
        remainder: see `Segment.remainder`, over all blocks. in_motion: the same over blocks in which the robot moves.
            of_limbs: the same of the limbs' rows.
        moved: sum of the weights of the blocks in motion [1]. stepped: of those in which the robot walks.
        repeated: number of successive rows with the same error [1], which persists through a swing or a stance.
        limb_count: number of rows of the limbs.
        returning, strides: number of rows after which such errors have returned, so that further rows tell nothing new,
            and the same of rows of a walk [1].
        white: Σ of all rows' white variance [1].
    """

    remainder: Array
    in_motion: Array
    moved: float
    repeated: float
    white: float = 0.0
    returning: float = inf
    strides: float = inf
    stepped: float = 0.0
    limb_count: float = 0.0
    of_limbs: Array = field(default_factory=lambda: np.zeros((1, 1)))

    @classmethod
    def of(cls, segments: Sequence[Segment], repeated: float, returning: float = inf, strides: float = inf) -> RowSums:
        """Sums up segments of the same robot."""
        sums = ([getattr(each, name) for each in segments] for name in _SUMMED)
        totals = {name: sum(more, first) for name, (first, *more) in zip(_SUMMED, sums, strict=True)}
        return cls(repeated=repeated, returning=returning, strides=strides, **totals)

    def __add__(self, other: RowSums) -> RowSums:
        return replace(self, **{name: getattr(self, name) + getattr(other, name) for name in _SUMMED})

    @property
    def repeats(self) -> float:
        """Number of rows that share one error [1]."""
        returned = (self.moved - self.stepped) / self.returning + self.stepped / self.strides
        return self.repeated * max(returned, 1.0)
