"""The log's times at rest, as blocks: the mass of each by eq. 7, and what it would feel of constant errors.

In static equilibrium the ground carries the weight along the vertical u (trunk axes),

    m_tr = u · Σ f_i / g - m_l                                                    (eq. 7)

Constant errors n of torques and feet move it by s n with s = uᵀ (∂F/∂n) / g. Two blocks of one pose feel them alike,
so that of their difference, (s_2 - s_1) C (s_2 - s_1)ᵀ, next to nothing is left: a change is told much better than
a mass.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.contact import ContactForces
from stadera.estimate.equilibrium import ConstantErrors, wrench_slope
from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.measurement import Measurement
from stadera.estimate.stillness import GRAVITY, StillnessGate
from stadera.weigh.result import Refusal

Array = NDArray[np.float64]

BLOCK = 0.25
"""Length of a block [s]."""

_FEWEST = 3  # samples of a block
_FELT = 24  # of the constant errors: torques and feet


@dataclass(frozen=True, eq=False)
class Block:
    """A quarter of a second at rest, or what there was of one.

    Attributes:
        begin, end: [s], of its samples.
        count: of samples.
        mass: [kg], their mean.
        variance: [kg²], of the mean by white noise alone.
        felt: (24,), s of constant errors of torques and feet.
        load: (4,) [N], vertical forces, mean.
    """

    begin: float
    end: float
    count: int
    mass: float
    variance: float
    felt: Array
    load: Array

    @property
    def time(self) -> float:
        """Its middle [s]."""
        return 0.5 * (self.begin + self.end)


@dataclass(frozen=True, eq=False)
class Rest:
    """When a robot stood still.

    Attributes:
        blocks: in order.
        refusals: times in between.
        begin, end: of the log [s].
    """

    blocks: tuple[Block, ...]
    refusals: tuple[Refusal, ...]
    begin: float
    end: float

    @property
    def usual_reason(self) -> str:
        """What spoke against rest for longest."""
        longest = max(self.refusals, key=lambda r: r.end - r.begin, default=None)
        return "" if longest is None else longest.reason


@dataclass
class _Gathering:
    begin: float
    count: int = 0
    mass: float = 0.0
    load: Array = field(default_factory=lambda: np.zeros(4))
    end: float = 0.0
    forces: ContactForces | None = None
    up: Array = field(default_factory=lambda: np.zeros(3))

    def add(self, time: float, mass: float, load: Array, forces: ContactForces, up: Array) -> None:
        self.count, self.mass, self.load = self.count + 1, self.mass + mass, self.load + load
        self.end, self.forces, self.up = time, forces, up

    def block(self) -> Block | None:
        if self.forces is None or self.count < _FEWEST:
            return None
        slope = self.up @ wrench_slope(self.forces)[:3] / GRAVITY
        white = float(slope[:12] ** 2 @ self.forces.noise.torque_white.ravel() ** 2)
        n = self.count
        return Block(self.begin, self.end, n, self.mass / n, white / n, slope, self.load / n)


def times_at_rest(measurements: Iterable[Measurement], forces_of: ContactForceEstimator) -> Rest:
    """Blocks at rest of a log, and why the rest of it is none. Flat in memory but for the blocks themselves."""
    gate = StillnessGate(forces_of.legs)
    blocks: list[Block] = []
    refusals: list[Refusal] = []
    open_block: _Gathering | None = None
    refused_since, reason, begin, time = np.nan, "", np.nan, np.nan

    def closed() -> None:
        nonlocal open_block
        if open_block is not None and (block := open_block.block()) is not None:
            blocks.append(block)
        open_block = None

    for m in measurements:
        begin, time = (m.time if np.isnan(begin) else begin), m.time
        forces = forces_of.at(m)
        felt = bool(np.isfinite(forces.force[forces.stance]).all())
        complaint = gate.complaint(m, forces) or ("" if felt else "a leg is so stretched that its force is not felt")
        if complaint:
            closed()
            if np.isnan(refused_since):
                refused_since, reason = time, complaint
            continue
        if not np.isnan(refused_since):
            refusals.append(Refusal(refused_since, time, reason))
            refused_since = np.nan
        if open_block is not None and time - open_block.begin >= BLOCK:
            closed()
        if open_block is None:
            open_block = _Gathering(time)
        up = m.up
        load = np.where(forces.stance, np.nan_to_num(forces.force) @ up, 0.0)
        open_block.add(time, float(load.sum()) / GRAVITY - forces_of.legs.mass, load, forces, up)
    closed()
    if not np.isnan(refused_since):
        refusals.append(Refusal(refused_since, time, reason))
    return Rest(tuple(blocks), tuple(refusals), begin, time)


@dataclass(frozen=True, eq=False)
class MeanMass:
    """The mean over blocks of one load.

    Attributes:
        begin: [s], of the first block.
        count: of samples.
        mass: [kg]. variance: by white noise alone [kg²].
        felt: (24,), as for a block.
    """

    begin: float
    count: int
    mass: float
    variance: float
    felt: Array

    @classmethod
    def of(cls, block: Block) -> MeanMass:
        """The mean over one block."""
        return cls(block.begin, block.count, block.mass, block.variance, block.felt)

    def with_block(self, block: Block) -> MeanMass:
        """The mean over one more."""
        count = self.count + block.count
        old, new = self.count / count, block.count / count
        variance = old**2 * self.variance + new**2 * block.variance
        return MeanMass(
            self.begin, count, old * self.mass + new * block.mass, variance, old * self.felt + new * block.felt
        )

    def std(self, errors: ConstantErrors) -> float:
        """Of the mass, constant errors included [kg]."""
        return sqrt(self.variance + felt_variance(self.felt, errors))


def felt_variance(felt: Array, errors: ConstantErrors) -> float:
    """s C sᵀ of constant errors of torques and feet [kg²]."""
    return float(felt @ errors.covariance[:_FELT, :_FELT] @ felt)
