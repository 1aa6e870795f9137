"""Static detection: tests whether the robot is in equilibrium on its feet, as all methods that weigh at rest require.

Single samples are noisy, so motion is evaluated after a first-order low-pass. Values that are not finite are reported
and excluded from it. After a fault nothing counts as static until all conditions have held for a while.

The noise after the low-pass depends on the log's rate: for white noise σ, sampled every dt,

    σ √(α / (2 - α)),      α = dt / (T + dt)      (T: time constant)

So joint velocities are averaged for as long as needed to bring their noise (`VelocityNoise`) below the limit, but no
longer than the waiting time after a fault. The limit itself is the same for every log.

An acceleration a across the vertical changes the magnitude of the specific force by a² / 2g only, so its direction is
monitored as well, relative to the vertical v, which is propagated by the orientation, or else by the gyro, and
corrected towards the specific force,

    v̇ = -ω x v + (f / |f| - v) / T,      a ≈ |f x v|      (f: specific force, trunk axes)

so that a constant error of either does not appear as acceleration. Its magnitude is compared with its own mean over
the same time, since an accelerometer's scale is a constant error too: those of three Go2s read 3 to 3.5 % too little.

Without an IMU (`standing.forces`) ω = 0 and f is along the feet's forces: if the feet do not slip, joints at rest
hold the trunk at rest, and only the sway of the forces' direction is monitored.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite, sqrt

import numpy as np

from stadera.constants import GRAVITY, SATURATED
from stadera.errors import require_positive
from stadera.inertia import skew
from stadera.robot.model import Robot
from stadera.robot.shapes import FLAT
from stadera.trunk.measurement import Measurement, not_finite
from stadera.trunk.standing.forces import ContactForces
from stadera.types import Array, Bools


@dataclass(frozen=True)
class StaticLimits:
    """Limits for a robot at rest.

    Attributes:
        angular_velocity: of the trunk [rad/s].
        joint_velocity: of any joint [rad/s].
        specific_force: change of its magnitude, and its component across the vertical [m/s²].
        gravity: difference of its magnitude from gravity, share of it [1]: beyond what accelerometers are off.
        effort: share of a joint's limit from which its torque counts as saturated.
        slip: change of the distance between two feet in stance since the robot stood still [m].
        feet: least number of loaded feet; a flat foot holds the trunk alone and counts as three.
        smoothing: time constant of the low-pass [s]; for joint velocities the least one, `quiet` being the largest.
        quiet: time for which all conditions must have held [s].
        vertical_time: T [s], time constant with which the vertical follows the specific force; a trunk sways faster.
        interruption: time without a sample after which the low-passes restart [s].
        noise_share: standard deviations of the joint velocities' noise, after the low-pass, that must fit below their
            limit.
        slip_every: interval between checks for slip [s]; a slip does not disappear by itself.
    """

    angular_velocity: float = 0.02
    joint_velocity: float = 0.05
    specific_force: float = 0.25
    gravity: float = 0.05
    effort: float = SATURATED
    slip: float = 0.01
    feet: int = 3
    smoothing: float = 0.05
    quiet: float = 0.1
    vertical_time: float = 0.3
    interruption: float = 0.5
    noise_share: float = 4.5
    slip_every: float = 0.01

    def __post_init__(self) -> None:
        require_positive("static limit", self, (field.name for field in fields(self)))


_FIRST_TIME, _LATER_TIME = 0.2, 1.0  # s, averaging times of the velocities' noise: until its first use, and later


class VelocityNoise:
    """White noise of a log's joint velocities: the least value indicated by their second differences.

    White noise σ gives second differences with a mean square of 6 σ², while slow motion gives almost nothing. The mean
    is over all joints. Noise that is not white, such as that of filtered velocities, is underestimated.

    Attributes:
        variance: σ² [rad²/s²]; 0 before the third sample.
    """

    def __init__(self) -> None:
        self.variance = 0.0
        self._mean, self._count, self._time = 0.0, 0, 0.0
        self._last: tuple[Array, ...] = ()

    def update(self, velocity: Array, dt: float) -> None:
        """Adds velocities (n,) [rad/s], `dt` [s] after the previous ones."""
        if len(self._last) == 2:
            bent = velocity - 2.0 * self._last[1] + self._last[0]
            self._count, self._time = self._count + 1, self._time + dt
            share = max(1.0 / self._count, dt / (_LATER_TIME + dt))
            self._mean += share * (float(bent @ bent) / (6.0 * len(bent)) - self._mean)
            self.variance = min(self.variance, self._mean) if self._time > _FIRST_TIME else self._mean
        self._last = (*self._last[-1:], velocity)

    def interrupt(self) -> None:
        """Announces that the next velocities do not follow the previous ones."""
        self._last = ()


class StaticDetector:
    """Checks every sample for static equilibrium.

    Args:
        robot: the model of the legs.
        limits: None for the defaults.
    """

    def __init__(self, robot: Robot, limits: StaticLimits | None = None) -> None:
        self.limits, self._robot = limits or StaticLimits(), robot
        self._joints = robot.tree.joints
        self._holds = np.array([3 if leg.contact == FLAT else 1 for leg in robot.legs])
        self._pairs = np.triu_indices(len(robot.legs), 1)
        self._feet = tuple(leg.name for leg in robot.legs)
        most = np.array([robot.limits[joint].effort for joint in self._joints])
        self._effort = self.limits.effort * most
        self._smooth = np.zeros(len(self._joints) + 6)
        self._noise = VelocityNoise()
        self._vertical: Array | None = None
        self._size = GRAVITY  # of the specific force, where it is steady
        self._rotation: Array | None = None
        self._time = self._looked = np.nan
        self._seen = -np.inf
        self._well_since = np.inf
        self._reason = "the robot has not been seen at rest yet"
        self._distances = np.zeros(len(self._pairs[0]))
        self._stance = np.zeros(len(robot.legs), dtype=bool)

    def unusable(self, measurement: Measurement) -> str:
        """Reason why a measurement is skipped, in one sentence: values that are not finite, time that does not
        increase; empty if it is not. To be asked for every one, before its forces.
        """
        if reason := not_finite(measurement, self._joints):
            return reason
        if not measurement.time > self._seen:
            return f"time must increase, got {measurement.time:.6f} s after {self._seen:.6f} s"
        self._seen = measurement.time
        return ""

    def complaint(self, measurement: Measurement, forces: ContactForces) -> str:
        """Reason why this measurement is not in static equilibrium, in one sentence; empty if it is."""
        time, limits = measurement.time, self.limits
        self._smoothen(measurement)
        reason = stretched(forces, self._robot, measurement.stance) or self._fault(measurement, forces)
        if reason:  # moving or faulty samples do not indicate the vertical
            self._vertical = None
        else:
            reason = self._pushed(by_forces=measurement.vertical_by_forces)
        if reason:
            self._reason, self._well_since = reason, np.inf
            return reason
        if self._well_since == np.inf:
            self._well_since = time
        return "" if time - self._well_since >= limits.quiet - 1e-9 else self._reason

    def _smoothen(self, m: Measurement) -> None:
        values = np.concatenate([m.joint_velocity, m.angular_velocity, m.force_at_origin])
        dt, self._time = m.time - self._time, m.time
        before, self._rotation = self._rotation, m.rotation
        if not 0.0 < dt < self.limits.interruption:  # the first sample, or after a gap
            self._smooth, self._vertical = values, None
            self._noise.interrupt()
        else:
            if m.rotation is not None and before is not None:
                turned = m.rotation.T @ before
            else:
                turned = np.eye(3) - skew(dt * m.angular_velocity)
            self._smooth[-3:] = turned @ self._smooth[-3:]
            shares = np.full(len(values), dt / (self.limits.smoothing + dt))
            shares[:-6] = self._velocity_share(dt)
            self._smooth += shares * (values - self._smooth)
            if self._vertical is not None:
                self._vertical = turned @ self._vertical
        self._noise.update(m.joint_velocity, dt)
        size = sqrt(float(self._smooth[-3:] @ self._smooth[-3:]))
        force = self._smooth[-3:] / (size or 1.0)
        if self._vertical is None:
            self._vertical, self._size = force, size
        else:
            share = dt / (self.limits.vertical_time + dt)
            self._vertical = self._vertical + share * (force - self._vertical)
            self._size += share * (size - self._size)

    def _velocity_share(self, dt: float) -> float:
        """α for joint velocities, with which noise of `noise_share` standard deviations just reaches the limit."""
        limits, variance = self.limits, self._noise.variance
        least, most = dt / (max(limits.quiet, limits.smoothing) + dt), dt / (limits.smoothing + dt)
        if not variance:
            return most
        square = (limits.joint_velocity / limits.noise_share) ** 2 / variance
        return min(max(2.0 * square / (1.0 + square), least), most)

    def _fault(self, m: Measurement, forces: ContactForces) -> str:
        limits, n = self.limits, len(self._joints)
        if self._holds[forces.stance].sum() < limits.feet:
            carrying = [foot for foot, stands in zip(self._feet, forces.stance, strict=True) if stands]
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
        size = sqrt(ax * ax + ay * ay + az * az)
        off, push = size - GRAVITY, size - self._size
        if abs(off) > limits.gravity * GRAVITY and not m.vertical_by_forces:
            return f"the trunk accelerates: specific force {off:+.2f} m/s² off gravity"
        if abs(push) > limits.specific_force and not m.vertical_by_forces:
            return f"the trunk accelerates: specific force changes by {push:+.2f} m/s²"
        return self._slipped(m, forces)

    def _pushed(self, *, by_forces: bool) -> str:
        """Checks the acceleration across the vertical."""
        if self._vertical is None:
            return ""
        force, along = self._smooth[-3:], self._vertical
        square = float(force @ force) - float(force @ along) ** 2 / float(along @ along)
        across = sqrt(max(square, 0.0))
        if across <= self.limits.specific_force:
            return ""
        if by_forces:
            return f"the direction of the feet's forces sways by {np.degrees(across / GRAVITY):.1f}°"
        return f"the trunk accelerates: specific force {across:.2f} m/s² across the vertical"

    def _slipped(self, m: Measurement, forces: ContactForces) -> str:
        """Checks for slip at intervals, since a slip does not disappear by itself."""
        if m.time - self._looked < self.limits.slip_every and self._well_since < np.inf:
            return ""
        self._looked = m.time
        first, second = self._pairs
        lines = forces.feet[first] - forces.feet[second]
        distances = np.sqrt((lines * lines).sum(axis=1))
        if self._well_since == np.inf or not np.array_equal(forces.stance, self._stance):
            self._distances, self._stance = distances, forces.stance
            return ""
        change = np.abs(distances - self._distances) * (self._stance[first] & self._stance[second])
        if change.max(initial=0.0) <= self.limits.slip:
            return ""
        by_foot = [change[(foot == first) | (foot == second)].sum() for foot in range(len(self._feet))]
        return f"foot {self._feet[int(np.argmax(by_foot))]} slipped by {100 * change.max():.1f} cm"


def stretched(forces: ContactForces, robot: Robot, meant: Bools | None = None) -> str:
    """Names a leg, of those meant to stand, that is so near-singular that its foot's force is not determined."""
    if isfinite(forces.force.sum()):
        return ""
    lost = np.isnan(forces.force).any(axis=1) & (True if meant is None else meant)
    leg = robot.legs[int(np.argmax(lost))].name
    return f"leg {leg} is so stretched that its foot's force is not felt" if lost.any() else ""
