"""Rows of one block: as `stadera.trunk.rows` makes them, and weighted, as they are summed up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import sqrt

import numpy as np

from stadera.body.rows import discounted
from stadera.constants import GRAVITY
from stadera.robot.model import Robot
from stadera.trunk.error_model import ErrorLayout, limb_limits
from stadera.trunk.settings import ModelErrors, TrunkSettings
from stadera.types import Array, Bools


class Equations:
    """Six rows A θ + C p = b, and those of the limbs.

    Attributes:
        columns: (6, 10 + 1 + errors + 10 loads), of A, b, C and of what a load elsewhere does (`stadera.trunk.limbs`).
        limbs: (joints, the same), of the limbs' joints.
    """

    columns: Array
    limbs: Array | None

    @property
    def matrix(self) -> Array:
        """A (6, 10)."""
        return self.columns[:, :10]

    @property
    def target(self) -> Array:
        """b (6,)."""
        return self.columns[:, 10]

    @property
    def errors(self) -> Array:
        """C (6, errors), then what loads do."""
        return self.columns[:, 11:]


@dataclass(frozen=True, eq=False)
class SwingRows:
    """A window's rows in joint space, for legs in the air: see `stadera.trunk.swing.SwingJoints.add`; `white` is the
    variance, `slides` (2, J) tells joints that slide forward, and backward, throughout the window, `unsure` is with s
    of the mean velocity and, as wide as that, its noise, `stepping` and `swings` (legs,) are as of `Lifted`, `pauses`
    (J,) tells joints at rest for some blocks of a robot that steps.
    """

    air: Bools
    terms: Array
    rate: Array
    residual: Array
    white: Array
    slides: Bools
    unsure: Array
    stepping: bool = False
    pauses: Bools = field(default_factory=lambda: np.zeros(1, dtype=bool))
    swings: Bools = field(default_factory=lambda: np.zeros(1, dtype=bool))


@dataclass(frozen=True, eq=False)
class BlockRows(Equations):
    """Six rows A θ + C p = b from two neighbouring blocks.

    Attributes:
        time: of the last sample [s]. elapsed: since the previous block [s].
        columns: (6, ...), of A, b [N, N·m], C and loads. limbs: (joints, ...), None if there are none.
        white: (6,), variances of the white noise.
        swing: rows in joint space.
    """

    time: float
    elapsed: float
    columns: Array
    white: Array
    swing: SwingRows
    limbs: Array | None = None


@dataclass(frozen=True, eq=False)
class WeightedRows(Equations):
    """Six rows of one block and those of its limbs, in the unit of `Weighting`.

    Attributes:
        time: of the last sample [s].
        columns: (6, ...), of A, b, C and loads. limbs: (joints, ...), means over several blocks in the unit of their
            residuals, None in blocks that do not complete them.
        white: variance of the white noise, summed over the six rows [1].
        weight, limb_weight: of the rows in sums [1], see `stadera.trunk.history.RobustWeights`.
        share: of the six rows that friction does not hide [1].
        slides: (2, joints), joints that slide forward, and backward.
        hidden: (6, joints), √n H of `stadera.trunk.segment`; None if it is taken into account.
        rests: see `ModelErrors`.
        pauses: (joints,), joints at rest for some blocks of a robot that steps.
        stepping: a foot moves relative to the others.
    """

    time: float
    columns: Array
    white: float
    weight: float = 1.0
    share: float = 1.0
    slides: Bools = field(default_factory=lambda: np.ones((2, 1), dtype=bool))
    hidden: Array | None = None
    rests: float = 1.0
    pauses: Bools = field(default_factory=lambda: np.zeros(1, dtype=bool))
    stepping: bool = False
    limbs: Array | None = None
    limb_weight: float = 1.0

    @cached_property
    def sliding(self) -> float:
        """Share of the joints that slide, whose direction of friction is known [1]."""
        return float(np.count_nonzero(self.slides.any(axis=0)) / self.slides.shape[1])


def unit_of_rows(robot: Robot) -> Array:
    """Unit of the rows (6,): 1 % of the robot's weight [N], of moments that with the leg's length as lever [N·m].

    It is the same for all blocks. Weights that follow the white noise of each block would be optimal if that were the
    only error. On real robots they are worse: the apparent momentum from late torques, rotor inertia and friction
    cancels over whole steps, but only if all phases of a step count about equally.
    """
    return np.asarray(0.01 * GRAVITY * robot.mass * np.array([1.0, 1.0, 1.0, *3 * [robot.leg_length]]))


def noise_of_limbs(sizes: ModelErrors) -> float:
    """Standard deviation of the torques of joints in arms and other limbs, share of their effort limits [1]."""
    return float(np.hypot(sizes.limbs * sizes.coulomb, sizes.offset))


@dataclass(frozen=True, eq=False)
class Weighting:
    """How the rows of one robot's blocks are scaled and discounted.

    Attributes:
        unit: (6,), see `unit_of_rows`. of_limbs: (joints,) [N·m], that of the limbs' rows; None to leave these out.
        unfelt: places of the errors of that name, and their standard deviations; rows count the less, the more these
            hide them.
        friction: places of errors of the joints' torques, and standard deviations of the friction of joints that hardly
            move [N·m], of whichever direction: it counts as white noise.
        static: places of errors by static friction, of which each joint has one, and their standard deviations [N·m],
            times the root of the number of rows that share them.
        rests: see `ModelErrors`.
    """

    unit: Array
    of_limbs: Array | None = None
    unfelt: tuple[slice, Array] | None = None
    friction: tuple[slice, Array] | None = None
    static: tuple[Sequence[slice], Array] | None = None
    rests: float = 1.0

    @classmethod
    def of(
        cls, robot: Robot, layout: ErrorLayout, settings: TrunkSettings, friction: Array | None, static: Array | None
    ) -> Weighting:
        """Of a robot, with standard deviations `friction` and `static` (joints,) [N·m]; None for none."""
        sizes, places, few = settings.model, layout.places, robot.unfelt_std[list(layout.unfelt)]
        found = cls(
            unit_of_rows(robot),
            noise_of_limbs(sizes) * limb_limits(robot),
            (places["unfelt"], few) if len(few) else None,
            None if friction is None else (places["offset"], friction),
        )
        if static is None or settings.outliers.held >= 1.0:  # all rows count, whether joints slide or not
            return found
        holding = (places["stiction"], places["standstill"]), sqrt(settings.swing.repeated) * static
        return replace(found, static=holding, rests=sizes.rests)

    def weighted(self, rows: BlockRows) -> WeightedRows:
        """Rows in their unit."""
        unit = self.unit
        white, columns = float((rows.white / (unit * unit)).sum()), rows.columns / unit[:, None]
        if self.unfelt is not None:
            hidden = columns[:, 11:][:, self.unfelt[0]] * self.unfelt[1]
            white = float((discounted(np.diag(np.sqrt(rows.white) / unit), hidden) ** 2).sum())
            columns = discounted(columns, hidden)
        if self.friction is not None:
            white += float(((columns[:, 11:][:, self.friction[0]] * self.friction[1]) ** 2 @ rows.swing.unsure).sum())
        held: Array | None = None
        if self.static is not None:
            held = self.static[1] * sum(columns[:, 11:][:, place] for place in self.static[0])
        return WeightedRows(
            rows.time,
            columns,
            white,
            slides=rows.swing.slides,
            hidden=held,
            rests=self.rests,
            pauses=rows.swing.pauses,
            stepping=rows.swing.stepping,
            limbs=None if rows.limbs is None or self.of_limbs is None else rows.limbs / self.of_limbs[:, None],
        )
