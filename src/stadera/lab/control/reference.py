"""References of the trunk: poses, smooth moves between them, and small motions around one.

A shake moves a standing robot's body, which makes height and inertia observable without stepping. Each of the three
rotations and three shifts is a sum of sines with separate frequencies, none a multiple of another, with smaller
amplitudes at higher frequencies; all start from rest::

    x(t) = e(t) A Σ_k w_k sin(2π f_k (t - t_0)),      w_k ∝ 1 / f_k,  Σ_k w_k = 1

with A the amplitude and e the smooth step from 0 to 1 within the first second.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isnan
from typing import Protocol

import numpy as np
import pinocchio as pin

from stadera.errors import ModelError, StaderaError
from stadera.robot.model import Robot
from stadera.robot.stance import nominal_feet
from stadera.types import Array


class ControlError(StaderaError):
    """The controller cannot do what was requested, or received unusable measurements."""


_NOT_MOVING = [0.0, 0.0, 0.0]


@dataclass(frozen=True, eq=False)
class TrunkPose:
    """A pose of the trunk in the odometry frame, with its velocity and acceleration."""

    position: Array  # (3,) [m], of the trunk's origin
    rotation: Array  # (3, 3), of the trunk in the world
    velocity: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m/s]
    angular_velocity: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [rad/s], in the pose's axes
    acceleration: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m/s²]

    @property
    def at_rest(self) -> bool:
        """True if it is not moving."""
        rates = (self.velocity, self.angular_velocity, self.acceleration)
        return all(rate.tolist() == _NOT_MOVING for rate in rates)

    def moved(self, shift: Array, turn: Array) -> TrunkPose:
        """The pose at rest, shifted by (3,) [m] in the odometry frame and rotated by (3,) [rad] in its axes."""
        return TrunkPose(self.position + shift, self.rotation @ pin.exp3(turn))


class TrunkReference(Protocol):
    """Reference of the trunk over time."""

    def at(self, time: float) -> TrunkPose:
        """Reference at a time [s]."""


@dataclass(frozen=True, eq=False)
class Move:
    """A smooth move between two poses with given velocities, with zero acceleration at both ends.

    Position and rotation vector relative to the start follow the quintic with these ends; between poses at rest this is
    a straight line and a fixed axis. After the end the goal's velocity continues.
    """

    start: TrunkPose
    goal: TrunkPose
    begin: float  # [s]
    duration: float  # [s], positive

    def __post_init__(self) -> None:
        turn = pin.log3(self.start.rotation.T @ self.goal.rotation)
        # rows: zero, way; rates at both ends, over the move's duration
        way = np.stack([self.goal.position - self.start.position, turn])
        first = np.stack([self.start.velocity, self.start.angular_velocity]) * self.duration
        last = np.stack([self.goal.velocity, np.linalg.solve(turning_map(turn), self.goal.angular_velocity)])
        object.__setattr__(self, "_ends", (way, first, last * self.duration))

    def at(self, time: float) -> TrunkPose:
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


class Follower:
    """What follows a reference of the trunk: `time` [s] of the last update, NaN before the first."""

    time = np.nan
    _reference: TrunkReference

    @property
    def reference(self) -> TrunkPose:
        """Reference of the trunk: the goal of a `move`, even while it is in progress; else the present reference."""
        self._require_update("the reference is where the trunk is then")
        return self._reference.goal if isinstance(self._reference, Move) else self._reference.at(self.time)

    def move(self, goal: TrunkPose, duration: float) -> None:
        """Moves the reference to a pose within a duration [s], from its present pose and velocity."""
        self._require_update("it says where the trunk is")
        self._reference = Move(self._reference.at(self.time), goal, self.time, duration)

    def follow(self, reference: TrunkReference) -> None:
        """Follows a reference from now on."""
        self._require_update("a reference is in the odometry frame, which begins with it")
        self._reference = reference

    def _require_update(self, why: str) -> None:
        if isnan(self.time):
            raise ControlError(f"the controller needs a first update: {why}")


def turning_map(turn: Array) -> Array:
    """The map (3, 3) from a rotation vector's rate to the angular velocity in the turned axes (right Jacobian)."""
    return np.asarray(pin.Jexp3(turn))


_ANGLE = np.deg2rad(3.0)
# Hz, of roll, pitch, yaw, x, y, z: within 0.5 to 2 Hz
_FREQUENCIES = np.array([[0.61, 1.37], [0.73, 1.61], [0.53, 1.13], [0.67, 1.49], [0.79, 1.27], [0.57, 1.87]])

_OMEGA, _ONES = 2.0 * np.pi * _FREQUENCIES, np.ones(2)


@dataclass(frozen=True, eq=False)
class Shake:
    """A motion around a pose; a `TrunkReference`."""

    centre: TrunkPose  # the pose, at rest
    begin: float  # [s]
    angle: Array  # amplitudes of roll, pitch and yaw, (3,) [rad]
    shift: Array  # amplitudes along x, y and z of the odometry frame, (3,) [m]
    ease: float = 1.0  # time over which the motion grows [s]

    def __post_init__(self) -> None:
        amplitudes = np.concatenate([np.broadcast_to(self.angle, 3), np.broadcast_to(self.shift, 3)])
        if not (np.isfinite(amplitudes).all() and (amplitudes >= 0).all() and (amplitudes[:3] <= 0.5).all()):
            raise ModelError(f"a shake's amplitudes must lie within 0 and 0.5 rad, got {self.angle} and {self.shift}")
        weights = 1.0 / _FREQUENCIES
        weights *= (amplitudes / weights.sum(axis=1))[:, None]
        object.__setattr__(self, "_weights", weights)

    @classmethod
    def of(cls, robot: Robot, centre: TrunkPose, begin: float, amplitude: float = 1.0, shift: float = 0.03) -> Shake:
        """Rotations of 3° and shifts of a share of the robot's height, times an amplitude."""
        height = -float(nominal_feet(robot)[:, 2].mean())
        return cls(centre, begin, np.full(3, amplitude * _ANGLE), np.full(3, amplitude * shift * height))

    def at(self, time: float) -> TrunkPose:
        late = max(time - self.begin, 0.0)
        weights = self._weights  # type: ignore[attr-defined]
        phase = _OMEGA * late
        sine, cosine = weights * np.sin(phase), weights * np.cos(phase)
        x, rate, rate_2 = sine @ _ONES, (_OMEGA * cosine) @ _ONES, (-_OMEGA * _OMEGA * sine) @ _ONES
        if late < self.ease:
            e, e_1, e_2 = eased(late, self.ease)
            rate_2 = e * rate_2 + 2.0 * e_1 * rate + e_2 * x
            rate, x = e * rate + e_1 * x, e * x
        return TrunkPose(
            self.centre.position + x[3:],
            self.centre.rotation @ pin.exp3(x[:3]),
            rate[3:],
            turning_map(x[:3]) @ rate[:3],
            rate_2[3:],
        )


def eased(late: float, ease: float) -> tuple[float, float, float]:
    """The smooth step e from 0 to 1 within a time `ease` [s], and its first two derivatives, `late` [s] in it."""
    x = late / ease
    return (
        x**3 * (10.0 - 15.0 * x + 6.0 * x * x),
        30.0 * (x * (1.0 - x)) ** 2 / ease,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / ease**2,
    )
