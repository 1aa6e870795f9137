"""Whether the robot is in static equilibrium on its feet: the condition of every law that weighs at rest.

Single samples are noisy, so motion is judged after a first-order low-pass. Once something was wrong, the gate stays
shut until all has been well for a while.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.errors import StaderaError
from stadera.estimate.contact import ContactForces
from stadera.estimate.legs import MeasuredLegs
from stadera.estimate.measurement import Measurement

Array = NDArray[np.float64]

GRAVITY = 9.81
"""[m/s²]."""

_LOOK_EVERY = 0.01  # s
_FIRST, _SECOND = np.array([0, 0, 0, 1, 1, 2]), np.array([1, 2, 3, 2, 3, 3])  # the pairs of feet


@dataclass(frozen=True)
class StillnessLimits:
    """What still counts as standing still.

    Attributes:
        angular_velocity: of the trunk [rad/s].
        joint_velocity: of any joint [rad/s].
        specific_force: how far its size may be from that of gravity [m/s²].
        effort: share of a joint's limit from which its torque counts as saturated.
        slip: by how much the distance of two feet in stance may have changed since the robot stood still [m].
        feet: least number of feet that carry.
        smoothing: time constant of the low-pass [s].
        quiet: for how long all must have been well [s].
    """

    angular_velocity: float = 0.02
    joint_velocity: float = 0.05
    specific_force: float = 0.25
    effort: float = 0.98
    slip: float = 0.01
    feet: int = 3
    smoothing: float = 0.05
    quiet: float = 0.1

    def __post_init__(self) -> None:
        for field in fields(self):
            if not (np.isfinite(getattr(self, field.name)) and getattr(self, field.name) > 0):
                raise StaderaError(f"stillness limit {field.name!r} must be positive, got {getattr(self, field.name)}")


class StillnessGate:
    """Tells, sample by sample, what speaks against static equilibrium.

    Args:
        legs: of the robot.
        limits: None for the defaults.
    """

    def __init__(self, legs: MeasuredLegs, limits: StillnessLimits | None = None) -> None:
        self.legs, self.limits = legs, limits or StillnessLimits()
        robot = legs.robot
        self._joints = robot.tree.joints
        self._feet = tuple(leg.name for leg in robot.legs)
        most = np.array([robot.limits[joint].effort for joint in self._joints])
        self._effort = self.limits.effort * most
        self._smooth = np.zeros(len(self._joints) + 6)
        self._time = self._looked = np.nan
        self._well_since = np.inf
        self._reason = "the robot has not been seen at rest yet"
        self._distances = np.zeros(6)
        self._stance = np.zeros(4, dtype=bool)

    def complaint(self, measurement: Measurement, forces: ContactForces) -> str:
        """Why this measurement is not one of static equilibrium, in one sentence; empty where it is."""
        time, limits = measurement.time, self.limits
        self._smoothen(measurement)
        reason = self._fault(measurement, forces)
        if reason:
            self._reason, self._well_since = reason, np.inf
            return reason
        if self._well_since == np.inf:
            self._well_since = time
        return "" if time - self._well_since >= limits.quiet - 1e-9 else self._reason

    def _smoothen(self, m: Measurement) -> None:
        values = np.concatenate([m.joint_velocity, m.angular_velocity, m.specific_force])
        dt, self._time = m.time - self._time, m.time
        if not dt > 0:  # the first one
            self._smooth = values
        else:
            self._smooth = self._smooth + (dt / (self.limits.smoothing + dt)) * (values - self._smooth)

    def _fault(self, m: Measurement, forces: ContactForces) -> str:
        limits, n = self.limits, len(self._joints)
        stance = forces.stance.tolist()
        if sum(stance) < limits.feet:
            carrying = [foot for foot, stands in zip(self._feet, stance, strict=True) if stands]
            return f"only {len(carrying)} feet carry ({', '.join(carrying) or 'none'}), {limits.feet} are needed"
        loads = np.abs(m.effort) / self._effort
        if loads.max() >= 1.0:
            joint = int(loads.argmax())
            return f"the torque of joint {self._joints[joint]!r} is at its limit ({m.effort[joint]:.1f} N·m)"
        wx, wy, wz, ax, ay, az = self._smooth[n:].tolist()
        spin = sqrt(wx * wx + wy * wy + wz * wz)
        if spin > limits.angular_velocity:
            return f"the trunk turns at {spin:.3f} rad/s, more than {limits.angular_velocity} rad/s"
        speed = np.abs(self._smooth[:n])
        if speed.max() > limits.joint_velocity:
            joint = int(speed.argmax())
            return f"joint {self._joints[joint]!r} moves at {speed[joint]:.3f} rad/s, more than {limits.joint_velocity}"
        push = sqrt(ax * ax + ay * ay + az * az) - GRAVITY
        if abs(push) > limits.specific_force:
            return f"the trunk accelerates: specific force {push:+.2f} m/s² off gravity"
        return self._slipped(m, forces)

    def _slipped(self, m: Measurement, forces: ContactForces) -> str:
        """Looked for now and then: a slip does not go away by itself."""
        if m.time - self._looked < _LOOK_EVERY and self._well_since < np.inf:
            return ""
        self._looked = m.time
        between = self.legs.at(m).feet
        lines = between[_FIRST] - between[_SECOND]
        distances = np.sqrt((lines * lines).sum(axis=1))
        if self._well_since == np.inf or not np.array_equal(forces.stance, self._stance):
            self._distances, self._stance = distances, forces.stance
            return ""
        change = np.abs(distances - self._distances) * (self._stance[_FIRST] & self._stance[_SECOND])
        if change.max() <= self.limits.slip:
            return ""
        by_foot = [change[(foot == _FIRST) | (foot == _SECOND)].sum() for foot in range(4)]
        return f"foot {self._feet[int(np.argmax(by_foot))]} slipped by {100 * change.max():.1f} cm"
