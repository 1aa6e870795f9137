"""What a weighing found, as plain values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stadera.robot.model import Robot
from stadera.weigh.payload import PayloadEstimate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Change:
    """The load changed.

    Attributes:
        time: [s], the first time at rest after it.
        mass: [kg], by how much; negative where something was taken off.
        mass_std: [kg].
    """

    time: float
    mass: float
    mass_std: float


@dataclass(frozen=True)
class Refusal:
    """A time in which the log could not be weighed by.

    Attributes:
        begin, end: [s].
        reason: one sentence.
    """

    begin: float
    end: float
    reason: str


@dataclass(frozen=True, eq=False)
class Timeline:
    """One entry for every block of time at rest; trunk frame.

    Attributes:
        time: (blocks,) [s], the blocks' middles.
        mass, mass_std: (blocks,) [kg], of the block alone (eq. 7).
        com, com_std: (blocks, 3) [m], as the method has it at that time; NaN where not observed.
        load: (blocks, 4) [N], the feet's vertical forces, legs in the robot's order.
        level: (blocks,) number of changes before it.
    """

    time: Array
    mass: Array
    mass_std: Array
    com: Array
    com_std: Array
    load: Array
    level: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Balance:
    """How the robot stands at the end, in the level plane through the trunk's origin, x where the trunk's x points.

    Attributes:
        to_level: (3, 3), from trunk axes to level ones.
        feet: (4, 3) [m], contacts, trunk frame.
        stance: (4,) bool.
        force: (4,) [N], vertical.
        pressure: (2,) [m], centre of pressure: the feet's places weighed by their forces.
        robot_com: (2,) [m], of the whole robot as found; NaN where not observed.
    """

    to_level: Array
    feet: Array
    stance: NDArray[np.bool_]
    force: Array
    pressure: Array
    robot_com: Array

    def level(self, point: Array) -> Array:
        """A point of the trunk frame (..., 3) in the level plane, (..., 2) [m]."""
        return np.asarray((point @ self.to_level.T)[..., :2])


@dataclass(frozen=True, eq=False)
class Vertical:
    """Where up was in the trunk at the end, and who says so.

    Attributes:
        source: "imu", or "forces" of the feet where there is no IMU.
        up: (3,), unit vector, trunk axes.
        std: (3,), of its components, constant errors included.
    """

    source: Literal["imu", "forces"]
    up: Array
    std: Array

    @property
    def tilt_std(self) -> float:
        """By how much it may be tilted, root of the mean square of both directions [rad]."""
        return float(np.linalg.norm(self.std) / np.sqrt(2.0))


@dataclass(frozen=True, eq=False)
class Weighing:
    """What a weighing found. Trunk: with all that is on it, as it was at the end of the log.

    Attributes:
        robot: that was believed in.
        source: the log.
        method: of the centre of mass.
        status: of the method at the end.
        mass, mass_std: of the trunk [kg].
        com, covariance: of the trunk, (3,) [m] and (3, 3) [m²], trunk frame; NaN where not observed.
        payload: added since the tare, None without a tare.
        changes: of the load, in order.
        timeline: see `Timeline`.
        refusals: when the log could not be weighed by, and why, in order.
        begin, end: of the log [s].
        balance: see `Balance`.
        vertical: see `Vertical`.
        notes: one sentence each.
    """

    robot: Robot
    source: str
    method: str
    status: str
    mass: float
    mass_std: float
    com: Array
    covariance: Array
    payload: PayloadEstimate | None
    changes: tuple[Change, ...]
    timeline: Timeline
    refusals: tuple[Refusal, ...]
    begin: float
    end: float
    balance: Balance
    vertical: Vertical
    notes: tuple[str, ...] = ()

    @property
    def com_std(self) -> Array:
        """(3,) [m], NaN where not observed."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def refused(self) -> float:
        """For how long the log could not be weighed by [s]."""
        return sum(refusal.end - refusal.begin for refusal in self.refusals)
