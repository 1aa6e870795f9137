"""Reference of the trunk: poses, and smooth moves between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import pinocchio as pin

from stadera.errors import ModelError
from stadera.types import Array

_NOT_MOVING = [0.0, 0.0, 0.0]


@dataclass(frozen=True, eq=False)
class TrunkPose:
    """A pose of the trunk in the odometry frame, with its velocity and acceleration.

    Attributes:
        position: (3,) [m], of the trunk's origin.
        rotation: (3, 3), of the trunk in the world.
        velocity: (3,) [m/s].
        angular_velocity: (3,) [rad/s], in the pose's axes.
        acceleration: (3,) [m/s²].
    """

    position: Array
    rotation: Array
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    angular_velocity: Array = field(default_factory=lambda: np.zeros(3))
    acceleration: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def at_rest(self) -> bool:
        """True if it is not moving."""
        rates = (self.velocity, self.angular_velocity, self.acceleration)
        return all(rate.tolist() == _NOT_MOVING for rate in rates)

    def moved(self, shift: Array, turn: Array) -> TrunkPose:
        """The pose at rest, shifted by (3,) [m] in the odometry frame and rotated by the rotation vector (3,) [rad] in
        its own axes.
        """
        return TrunkPose(self.position + shift, self.rotation @ pin.exp3(turn))


class TrunkReference(Protocol):
    """Reference of the trunk over time."""

    def at(self, time: float) -> TrunkPose:
        """Reference at a time [s]."""
        ...


@dataclass(frozen=True, eq=False)
class Move:
    """A smooth move between two poses with given velocities, with zero acceleration at both ends.

    Position and rotation vector relative to the start follow the quintic with these ends; between poses at rest this is
    a straight line and a fixed axis. After the end the goal's velocity continues.

    Attributes:
        start, goal: the poses.
        begin: [s]. duration: [s], positive.

    Raises:
        ModelError: the duration is not positive.
    """

    start: TrunkPose
    goal: TrunkPose
    begin: float
    duration: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise ModelError(f"a move's duration must be positive, got {self.duration} s")
        turn = pin.log3(self.start.rotation.T @ self.goal.rotation)
        # rows: zero, way; rates at both ends, over the move's duration
        way = np.stack([self.goal.position - self.start.position, turn])
        first = np.stack([self.start.velocity, self.start.angular_velocity]) * self.duration
        last = np.stack([self.goal.velocity, np.linalg.solve(turning_map(turn), self.goal.angular_velocity)])
        object.__setattr__(self, "_ends", (way, first, last * self.duration))

    def at(self, time: float) -> TrunkPose:
        """Reference at a time [s]."""
        x = (time - self.begin) / self.duration
        if x >= 1.0:
            return self._after(time - self.begin - self.duration)
        x = max(x, 0.0)
        way, first, last = self._ends  # type: ignore[attr-defined]
        a, b = 10.0 * way - 6.0 * first - 4.0 * last, -15.0 * way + 8.0 * first + 7.0 * last
        c = 6.0 * way - 3.0 * (first + last)
        gone = x * first + x**3 * (a + x * (b + x * c))
        rate = (first + x**2 * (3.0 * a + x * (4.0 * b + 5.0 * x * c))) / self.duration
        rate_2 = x * (6.0 * a + x * (12.0 * b + 20.0 * x * c)) / self.duration**2
        return TrunkPose(
            self.start.position + gone[0],
            self.start.rotation @ pin.exp3(gone[1]),
            rate[0],
            turning_map(gone[1]) @ rate[1],
            rate_2[0],
        )

    def _after(self, late: float) -> TrunkPose:
        goal = self.goal
        if goal.at_rest:
            return goal
        turn = pin.exp3(late * goal.angular_velocity)
        return TrunkPose(
            goal.position + late * goal.velocity, goal.rotation @ turn, goal.velocity, goal.angular_velocity
        )


def turning_map(turn: Array) -> Array:
    """The map (3, 3) from a rotation vector's rate to the angular velocity in the turned axes (right Jacobian)."""
    return np.asarray(pin.Jexp3(turn))
