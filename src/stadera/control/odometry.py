"""Where the trunk is, from the legs it stands on.

The base's position is not measured. Feet in stance do not move, so with R from the IMU and p_i from the legs::

    b = mean over stance of (anchor_i - R p_i)
    velocity of a point c of the trunk = -R mean over stance of (J_i q̇_i + ω x (r_i - c))

in the odometry frame: the world's axes, its origin the trunk's origin at the first update. p_i is a foot's centre, and
a foot is anchored where it is when it comes into stance; r_i is the point that touches the ground and J_i its Jacobian,
for that is the point at rest while a foot rolls. Feet that do not move keep their distances: what is left of
anchor_i - R p_i - b tells a foot that slips.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_SLIP = 0.02  # m, that one foot may disagree with the others before it counts as slipped
_NOBODY = np.zeros(4, dtype=bool)


class LegOdometry:
    """Dead reckoning on the feet in stance.

    Attributes:
        position: (3,) [m], of the trunk's origin in the odometry frame.
        anchors: (4, 3) [m], where the feet in stance stand.
        slipped: (4,) bool, feet found to have slipped at the last update; they were anchored anew.
    """

    def __init__(self) -> None:
        self.position = np.zeros(3)
        self.anchors = np.zeros((4, 3))
        self.slipped = _NOBODY
        self._stance = _NOBODY
        self._given = _NOBODY
        self._weights, self._standing = np.zeros(4), False

    def locate(self, levers: Array, stance: Bools) -> None:
        """Takes the position in; with no foot in stance it stays.

        Args:
            levers: (4, 3) [m], R p_i: centres of the feet from the trunk's origin, world axes.
            stance: (4,) bool; not to be changed in place between calls.
        """
        if stance is not self._given:
            self._change_stance(levers, stance)
        left = self.anchors - levers
        if self._standing:
            self.position = self._weights @ left
        left -= self.position
        everywhere = left.ravel()
        self.slipped = _NOBODY
        if everywhere @ everywhere > _SLIP**2:
            self.slipped = self._stance & ((left * left).sum(axis=1) > _SLIP**2)
            self.anchors[self.slipped] -= left[self.slipped]

    def velocity(self, arms: Array, joint_part: Array, angular_velocity: Array) -> Array:
        """Velocity (3,) [m/s] of a point of the trunk, TRUNK axes, by the feet in stance at the last `locate`.

        Args:
            arms: (4, 3) [m], r_i - c, and
            joint_part: (4, 3) [m/s], J_i q̇_i, both in trunk axes.
            angular_velocity: (3,) [rad/s], trunk axes.
        """
        x, y, z = (self._weights @ arms).tolist()
        u, v, w = (self._weights @ joint_part).tolist()
        wx, wy, wz = angular_velocity.tolist()
        return np.array([wz * y - wy * z - u, wx * z - wz * x - v, wy * x - wx * y - w])

    def _change_stance(self, levers: Array, stance: Bools) -> None:
        new = stance & ~self._stance
        self.anchors[new] = self.position + levers[new]
        self._given, self._stance = stance, stance.copy()
        self._standing = bool(stance.any())
        self._weights = stance / max(int(stance.sum()), 1)
