"""Leg odometry: position and velocity of the trunk from the legs in stance.

The base's position is not measured. Feet in stance do not move, so with R from the IMU and p_i from the legs::

    b = mean over stance of (anchor_i - R p_i)
    velocity of a point c of the trunk = -R mean over stance of (J_i q̇_i + ω x (r_i - c))

in the odometry frame: the world's axes, with the trunk's origin at the first update as origin. p_i is a foot's centre,
and a foot is anchored at its position when it enters stance; r_i is the contact point and J_i its Jacobian, since that
point is at rest while a foot rolls. A foot of radius ρ that rotates by θ on ground with normal n rolls: its centre
moves by θ x ρ n, and its anchor with it. Feet that do not slip keep their distances: the residual anchor_i - R p_i - b
identifies one that does.

The legs' velocity is unreliable at touch-down, and unavailable in the air. With the specific force a of the IMU, the
velocity is that of a complementary filter with time constant T::

    v̇ = R a + g + (v_legs - v) / T
"""

from __future__ import annotations

import numpy as np

from stadera.errors import ModelError
from stadera.types import Array, Bools

_NOBODY = np.zeros(4, dtype=bool)


class LegOdometry:
    """Position and velocity of the trunk from the feet in stance.

    `velocity_time` is T [s], 0 for the legs alone; a foot that deviates from the others by more than `slip` [m] has
    slipped.

    Attributes:
        position: (3,) [m], of the trunk's origin in the odometry frame.
        anchors: (4, 3) [m], positions of the feet in stance, and last positions of those in the air.
        anchored, slipped: (4,) bool, feet that have been in stance, and feet that slipped at the last update.
    """

    def __init__(self, velocity_time: float = 0.0, slip: float = 0.02) -> None:
        if not (np.isfinite(velocity_time) and velocity_time >= 0):
            raise ModelError(f"the velocity's time constant must not be negative, got {velocity_time} s")
        self._velocity_time, self._velocity, self._slip2 = velocity_time, np.zeros(3), slip**2
        self.position = np.zeros(3)
        self.anchors = np.zeros((4, 3))
        self.anchored = np.zeros(4, dtype=bool)
        self.slipped = _NOBODY
        self._stance = _NOBODY
        self._given = _NOBODY
        self._weights, self._standing, self._rolls = np.zeros(4), False, np.zeros((4, 3))

    def locate(self, levers: Array, stance: Bools, rolled: Array | None = None) -> None:
        """Updates the position; without a foot in stance it does not change.

        Levers R p_i (4, 3) [m] are the feet from the trunk's origin, `rolled` (4, 3) [m] is θ x ρ n since the last
        call, None for feet that do not roll, both in world axes. `stance` (4,) must not be modified in place between
        calls.
        """
        if rolled is not None and self._standing:
            self.anchors += rolled * self._rolls
        if stance is not self._given:
            self._change_stance(levers, stance)
        left = self.anchors - levers
        if self._standing:
            self.position = self._weights.dot(left)
        left -= self.position
        everywhere = left.ravel()
        self.slipped = _NOBODY
        if everywhere.dot(everywhere) > self._slip2:
            self.slipped = self._stance & ((left * left).sum(axis=1) > self._slip2)
            self.anchors[self.slipped] -= left[self.slipped]

    def velocity(self, arms: Array, joint_part: Array, angular_velocity: Array) -> Array:
        """Velocity (3,) [m/s] of a point of the trunk by the feet in stance at the last `locate`, from arms r_i - c (4,
        3) [m], J_i q̇_i (4, 3) [m/s] and angular velocity [rad/s], all in TRUNK axes.
        """
        x, y, z = self._weights.dot(arms).tolist()
        u, v, w = self._weights.dot(joint_part).tolist()
        wx, wy, wz = angular_velocity.tolist()
        return np.array([wz * y - wy * z - u, wx * z - wz * x - v, wy * x - wx * y - w])

    def fused(self, by_legs: Array, acceleration: Array, dt: float) -> Array:
        """Velocity (3,) [m/s] of the trunk's origin by legs (ignored if no foot is in stance) and IMU, world axes, from
        the acceleration R a + g (3,) [m/s²] and the time since the last call [s].
        """
        if self._velocity_time == 0.0:
            return by_legs
        ahead = self._velocity + dt * acceleration
        if self._standing:
            ahead += dt / (self._velocity_time + dt) * (by_legs - ahead)
        self._velocity = ahead
        return ahead

    def _change_stance(self, levers: Array, stance: Bools) -> None:
        new = stance & ~self._stance
        self.anchors[new] = self.position + levers[new]
        self._given, self._stance = stance, stance.copy()
        self._rolls = np.repeat(stance, 3).reshape(4, 3).astype(float)
        self.anchored = self.anchored | stance
        self._standing = bool(stance.any())
        self._weights = stance / max(int(stance.sum()), 1)
