"""Finds the log's times at rest and the trunk's mass in each by eq. 7, with its sensitivity to constant errors.

In static equilibrium the ground carries the weight along the vertical u (trunk axes),

    m_tr = u · Σ f_i / g - m_l                                                    (eq. 7)

Constant errors n of torques, feet and the legs' masses change it by s n with s = uᵀ (∂F/∂n) / g. Two blocks in one pose
have nearly the same s, so the variance of their difference, (s_2 - s_1) C (s_2 - s_1)ᵀ, is small: a change is known
much better than a mass.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from math import sqrt

import numpy as np

from stadera.constants import GRAVITY
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.standing.detection import StaticDetector
from stadera.trunk.standing.equilibrium import ConstantErrors, felt_by_mass
from stadera.trunk.standing.forces import ContactForceEstimator, ContactForces
from stadera.types import Array
from stadera.weigh.result import Refusal

_FEWEST = 3  # samples in a block
_FIGURES = re.compile(r"[-+]?\d[\d.]*|'[^']*'")  # the parts that differ between reasons of one kind


@dataclass(frozen=True, eq=False)
class RestBlock:
    """A short period at rest, or several of one load, from the first to the last sample [s]."""

    begin: float
    end: float
    count: int
    mass: float  # mean over `count` samples [kg]
    # of the mean due to white noise [kg²]: the larger of the stated one and that of the samples' scatter
    variance: float
    sensitivity: Array  # (39,), s: of the mass to constant errors
    load: Array  # (4,) [N], mean vertical forces
    noticed: float = np.nan  # end of the block that confirmed the change to this load [s]; NaN for the first load

    @property
    def time(self) -> float:
        """Its middle [s]."""
        return 0.5 * (self.begin + self.end)

    def joined(self, later: RestBlock) -> RestBlock:
        """This block and a later one of the same load."""
        count = self.count + later.count
        old, new = self.count / count, later.count / count
        return replace(
            self,
            end=later.end,
            count=count,
            mass=old * self.mass + new * later.mass,
            variance=old**2 * self.variance + new**2 * later.variance,
            sensitivity=old * self.sensitivity + new * later.sensitivity,
            load=old * self.load + new * later.load,
        )

    def std(self, errors: ConstantErrors) -> float:
        """Standard deviation of the mass, constant errors included [kg]."""
        return sqrt(self.variance + constant_variance(self.sensitivity, errors))


@dataclass(frozen=True, eq=False)
class Rest:
    """The periods in which the robot stood still, in order, the times between them, and begin and end of the log."""

    blocks: tuple[RestBlock, ...]
    refusals: tuple[Refusal, ...]
    begin: float
    end: float

    @property
    def usual_reason(self) -> str:
        """The reason against rest that applied for the longest time."""
        longest = max(self.refusals, key=lambda r: r.end - r.begin, default=None)
        return "" if longest is None else longest.reason


@dataclass
class _OpenBlock:
    """A block that is still being filled."""

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

    def closed(self, robot: Robot) -> Iterator[RestBlock]:
        """Yields the block, unless it has too few samples."""
        if self.last is None or self.count < _FEWEST:
            return
        sensitivity, noise = felt_by_mass(*self.last, robot), self.last[0].noise
        white = float(sensitivity[:12] ** 2 @ noise.torque_white.ravel() ** 2)
        n = self.count
        scatter = self.squares / (n - 1)
        yield RestBlock(self.begin, self.end, n, self.mass, max(white, scatter) / n, sensitivity, self.load / n)


class _RestFinder:
    """Sorts measurements into blocks at rest and the periods between them."""

    def __init__(self, forces_of: ContactForceEstimator, length: float) -> None:
        self._forces_of, self._length = forces_of, length
        self._gate = StaticDetector(forces_of.legs)
        self.blocks: list[RestBlock] = []
        self.refusals: list[Refusal] = []
        self._block: _OpenBlock | None = None
        self._moves_since: float | None = None
        self._reasons: Counter[str] = Counter()  # against rest since then, by kind
        self._first: dict[str, str] = {}  # of each kind

    def add(self, m: Measurement) -> None:
        forces = self._forces_of.at(m)
        if reason := _complaint(self._gate, m, forces):
            self._close_block()
            self._moves_since = m.time if self._moves_since is None else self._moves_since
            kind = _FIGURES.sub("#", reason)
            self._reasons[kind] += 1
            self._first.setdefault(kind, reason)
            return
        self._close_refusal(m.time)
        if self._block is not None and m.time - self._block.begin >= self._length:
            self._close_block()
        self._block = self._block or _OpenBlock(m.time)
        self._block.add(m, forces, self._forces_of.legs.mass)

    def finish(self, end: float) -> None:
        self._close_block()
        self._close_refusal(end)

    def _close_block(self) -> None:
        if self._block is not None:
            self.blocks += self._block.closed(self._forces_of.robot)
            self._block = None

    def _close_refusal(self, end: float) -> None:
        if self._moves_since is not None:
            usual = self._first[self._reasons.most_common(1)[0][0]]
            self.refusals.append(Refusal(self._moves_since, end, usual))
            self._moves_since, self._reasons, self._first = None, Counter(), {}


def times_at_rest(measurements: Iterable[Measurement], forces_of: ContactForceEstimator, length: float) -> Rest:
    """Finds blocks at rest of up to `length` [s] each, and why there is none in the remaining time. Keeps only the
    blocks in memory.
    """
    finder = _RestFinder(forces_of, length)
    begin = time = np.nan
    for m in measurements:
        begin, time = (m.time if np.isnan(begin) else begin), m.time
        finder.add(m)
    finder.finish(time)
    return Rest(tuple(finder.blocks), tuple(finder.refusals), begin, time)


def _complaint(gate: StaticDetector, m: Measurement, forces: ContactForces) -> str:
    reason = gate.complaint(m, forces)
    if not reason and not np.isfinite(forces.force[forces.stance]).all():
        return "a leg is near-singular, so that its foot's force is not determined"
    return reason


def constant_variance(sensitivity: Array, errors: ConstantErrors) -> float:
    """Variance of a mass due to constant errors, s C sᵀ [kg²]."""
    return float(sensitivity @ errors.covariance @ sensitivity)


def difference_variance(before: RestBlock, after: RestBlock, errors: ConstantErrors) -> float:
    """Variance of the difference of two masses under one load [kg²]: white noise of both, and the part of constant
    errors that does not cancel.
    """
    return before.variance + after.variance + constant_variance(after.sensitivity - before.sensitivity, errors)


def change_variance(before: RestBlock, after: RestBlock, errors: ConstantErrors) -> float:
    """Variance of the difference of two loads [kg²]: static friction of each is its own."""
    apart = after.sensitivity - before.sensitivity
    own = sum(float(s[:12] @ errors.sticking @ s[:12]) for s in (before.sensitivity, after.sensitivity))
    return before.variance + after.variance + float(apart @ errors.lasting @ apart) + own
