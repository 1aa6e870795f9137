"""The log's times at rest, as blocks: the mass of each by eq. 7, and what it would feel of constant errors.

In static equilibrium the ground carries the weight along the vertical u (trunk axes),

    m_tr = u · Σ f_i / g - m_l                                                    (eq. 7)

Constant errors n of torques, feet and the legs' masses move it by s n with s = uᵀ (∂F/∂n) / g. Two blocks of one pose
feel them alike, so that of their difference, (s_2 - s_1) C (s_2 - s_1)ᵀ, next to nothing is left: a change is told much
better than a mass.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.contact import ContactForces
from stadera.estimate.equilibrium import ConstantErrors
from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.mass import felt_by_mass
from stadera.estimate.measurement import Measurement
from stadera.estimate.stillness import GRAVITY, StillnessGate
from stadera.robot.model import Robot
from stadera.weigh.result import Refusal

Array = NDArray[np.float64]

BLOCK = 0.25
"""Length of a block [s]."""

_FEWEST = 3  # samples of a block
_FIGURES = re.compile(r"[-+]?\d[\d.]*|'[^']*'")  # what differs between reasons of one kind


@dataclass(frozen=True, eq=False)
class Block:
    """A quarter of a second at rest, or what there was of one.

    Attributes:
        begin, end: [s], of its samples.
        count: of samples.
        mass: [kg], their mean.
        variance: [kg²], of the mean by white noise, as stated or as the samples scatter, whatever is more.
        felt: (39,), s of constant errors.
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
    squares: float = 0.0
    load: Array = field(default_factory=lambda: np.zeros(4))
    end: float = 0.0
    last: tuple[ContactForces, Measurement] | None = None

    def add(self, m: Measurement, forces: ContactForces, leg_mass: float) -> None:
        up = m.up
        load = np.where(forces.stance, np.nan_to_num(forces.force) @ up, 0.0)
        self.count += 1
        away = float(load.sum()) / GRAVITY - leg_mass - self.mass
        self.mass += away / self.count
        self.squares += away**2 * (1.0 - 1.0 / self.count)
        self.load = self.load + load
        self.end, self.last = m.time, (forces, m)

    def block(self, robot: Robot) -> Block | None:
        if self.last is None or self.count < _FEWEST:
            return None
        felt, noise = felt_by_mass(*self.last, robot), self.last[0].noise
        white = float(felt[:12] ** 2 @ noise.torque_white.ravel() ** 2)
        n = self.count
        scatter = self.squares / (n - 1)
        return Block(self.begin, self.end, n, self.mass, max(white, scatter) / n, felt, self.load / n)


class _Refusing:
    """A time that cannot be weighed by, and what spoke against it most often."""

    def __init__(self, begin: float) -> None:
        self._begin = begin
        self._count: Counter[str] = Counter()
        self._said: dict[str, str] = {}

    def add(self, reason: str) -> None:
        kind = _FIGURES.sub("#", reason)
        self._count[kind] += 1
        self._said.setdefault(kind, reason)

    def until(self, end: float) -> Refusal:
        return Refusal(self._begin, end, self._said[self._count.most_common(1)[0][0]])


def times_at_rest(measurements: Iterable[Measurement], forces_of: ContactForceEstimator) -> Rest:
    """Blocks at rest of a log, and why the rest of it is none. Flat in memory but for the blocks themselves."""
    gate = StillnessGate(forces_of.legs)
    blocks: list[Block | None] = []
    refusals: list[Refusal] = []
    gathering: _Gathering | None = None
    refusing: _Refusing | None = None
    begin = time = np.nan
    for m in measurements:
        begin, time = (m.time if np.isnan(begin) else begin), m.time
        forces = forces_of.at(m)
        if reason := _complaint(gate, m, forces):
            if gathering is not None:
                blocks.append(gathering.block(forces_of.robot))
                gathering = None
            refusing = refusing or _Refusing(time)
            refusing.add(reason)
            continue
        if refusing is not None:
            refusals.append(refusing.until(time))
            refusing = None
        if gathering is not None and time - gathering.begin >= BLOCK:
            blocks.append(gathering.block(forces_of.robot))
            gathering = None
        gathering = gathering or _Gathering(time)
        gathering.add(m, forces, forces_of.legs.mass)
    if gathering is not None:
        blocks.append(gathering.block(forces_of.robot))
    if refusing is not None:
        refusals.append(refusing.until(time))
    return Rest(tuple(b for b in blocks if b is not None), tuple(refusals), begin, time)


def _complaint(gate: StillnessGate, m: Measurement, forces: ContactForces) -> str:
    reason = gate.complaint(m, forces)
    if not reason and not np.isfinite(forces.force[forces.stance]).all():
        return "a leg is so stretched that its foot's force is not felt"
    return reason


@dataclass(frozen=True, eq=False)
class MeanMass:
    """The mean over blocks of one load.

    Attributes:
        begin: [s], of the first block.
        count: of samples.
        mass: [kg]. variance: by white noise alone [kg²].
        felt: (39,), as for a block.
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
    """s C sᵀ of constant errors [kg²]."""
    return float(felt @ errors.covariance @ felt)
