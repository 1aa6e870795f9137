"""Finds moments near rest while a robot walks, and the trunk's mass in each.

Whenever velocity and acceleration approach zero with all four feet on the ground (the paper's section V.C), Newton's
law along the vertical u (trunk axes) gives the trunk's mass. With F = u · Σ f_i over the feet and a = u · (specific
force), g at rest,

    m_tr = mean F / mean a - m_l

which is the paper's eq. 7 with a in place of g: a common acceleration of trunk and legs cancels, so a trunk that moves
evenly over its feet can be weighed as well as one at rest. A moment is the mean over a quiet window. Constant torque
offsets n (12) change it by s n with s = uᵀ (∂F/∂n) / a, and s varies from moment to moment, since the legs' pose does.
For k samples, white noise and legs that accelerate half as much as the trunk give

    σ² = Σ_j s_j² σ_τ² / k + (m_r σ_a / a)² / k + (m_l (a - g) / 2g)²

The constant error of the accelerometer acts like an error of the mass.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import sqrt

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import StaderaError, require_positive
from stadera.trunk.measurement import Measurement
from stadera.trunk.standing.contact import ContactForces
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.types import Array

_TORQUES = 12


@dataclass(frozen=True)
class RestLimits:
    """Limits for a moment near rest."""

    angular_velocity: float = 0.25  # of the trunk [rad/s]
    joint_velocity: float = 0.8  # of any joint [rad/s]
    specific_force: float = 0.6  # difference of its magnitude from gravity [m/s²]
    smoothing: float = 0.02  # time constant of the low-pass on the motion [s]
    shortest: float = 0.05  # of a window [s]
    longest: float = 0.12  # of a window; longer rest is split [s]
    accelerometer: float = 0.05  # white noise of one sample [m/s²]

    def __post_init__(self) -> None:
        require_positive("rest limit", self, (field.name for field in fields(self)))
        if self.shortest > self.longest:
            raise StaderaError(f"the shortest rest, {self.shortest} s, is longer than the longest, {self.longest} s")


@dataclass(frozen=True, eq=False)
class RestMoment:
    """The trunk's mass from a moment near rest."""

    begin: float  # [s]
    end: float  # [s]
    mass: float  # [kg], of trunk and load
    variance: float  # [kg²], without constant errors
    slope: Array  # (12,) [kg/(N·m)], s: derivative of the mass with respect to the torque offsets, leg by leg


class RestWatch:
    """Finds moments near rest, sample by sample."""

    def __init__(self, forces: ContactForceEstimator, limits: RestLimits | None = None) -> None:
        self.forces, self.limits = forces, limits or RestLimits()
        self._smooth = np.zeros(len(forces.robot.tree.joints) + 6)
        self._time = np.nan
        self._begin = self._end = np.nan
        self._count, self._force, self._specific = 0, 0.0, 0.0
        self._last: tuple[ContactForces, Array] | None = None

    def update(self, measurement: Measurement) -> RestMoment | None:
        """Processes one measurement; returns a moment when it has ended or lasted long enough."""
        m = measurement
        self._smoothen(m)
        if not self._quiet(m):
            return self._finished()
        forces = self.forces.at(m)
        # all feet in stance are used, however small their load
        stance = np.ones(4, dtype=bool) if m.stance is None else m.stance
        forces = replace(forces, stance=stance)
        up = m.up
        force = float(up @ forces.total_force)
        if not np.isfinite(force):
            return self._finished()
        if not self._count:
            self._begin = m.time
        self._end, self._last = m.time, (forces, up)
        self._count += 1
        self._force += force
        self._specific += float(up @ m.force_at_origin)
        return self._finished() if m.time - self._begin >= self.limits.longest else None

    def restart(self) -> None:
        """Discards the current moment."""
        self._count, self._force, self._specific, self._last = 0, 0.0, 0.0, None

    def _smoothen(self, m: Measurement) -> None:
        values = np.concatenate([m.joint_velocity, m.angular_velocity, m.force_at_origin])
        dt, self._time = m.time - self._time, m.time
        share = dt / (self.limits.smoothing + dt) if dt > 0 else 1.0
        self._smooth = self._smooth + share * (values - self._smooth)

    def _quiet(self, m: Measurement) -> bool:
        if m.stance is not None and not m.stance.all():
            return False
        limits = self.limits
        *joints, wx, wy, wz, ax, ay, az = self._smooth.tolist()
        return (
            max(max(joints), -min(joints)) <= limits.joint_velocity
            and wx * wx + wy * wy + wz * wz <= limits.angular_velocity**2
            and abs(sqrt(ax * ax + ay * ay + az * az) - GRAVITY) <= limits.specific_force
        )

    def _finished(self) -> RestMoment | None:
        """The moment that has ended, if it lasted long enough."""
        count, last = self._count, self._last
        force, specific = self._force, self._specific
        self.restart()
        if last is None or self._end - self._begin < self.limits.shortest:
            return None
        forces, up = last
        acceleration = specific / count
        robot_mass = force / count / acceleration
        slope = up @ forces.wrench_slope[:3, :_TORQUES] / acceleration
        white = float(slope**2 @ self.forces.noise.torque_white.ravel() ** 2)
        white += (robot_mass * self.limits.accelerometer / acceleration) ** 2
        leg_mass = self.forces.legs.mass
        legs_lag = (0.5 * leg_mass * (acceleration / GRAVITY - 1.0)) ** 2
        return RestMoment(self._begin, self._end, robot_mass - leg_mass, white / count + legs_lag, slope)
