"""Where the trunk is, from the legs it stands on.

The base's position is not measured. Feet in stance do not move, so with R from the IMU and p_i from the legs::

    b = mean over stance of (anchor_i - R p_i),      ḃ = -R mean over stance of (J_i q̇_i + ω x p_i)

in the odometry frame: the world's axes, its origin the trunk's origin at the first update. A foot is anchored where it is
when it comes into stance. Feet that do not move keep their distances: what is left of anchor_i - R p_i - b tells a foot
that slips.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_SLIP = 0.02  # m, that one foot may disagree with the others before it counts as slipped


class LegOdometry:
    """Dead reckoning on the feet in stance.

    Attributes:
        position: (3,) [m], of the trunk's origin, and
        velocity: (3,) [m/s], both in the odometry frame.
        anchors: (4, 3) [m], where the feet in stance stand.
        slipped: (4,) bool, feet found to have slipped at the last update; they were anchored anew.
    """

    def __init__(self) -> None:
        self.position, self.velocity = np.zeros(3), np.zeros(3)
        self.anchors = np.zeros((4, 3))
        self.slipped = np.zeros(4, dtype=bool)
        self._stance = np.zeros(4, dtype=bool)
        self._weights = np.zeros(4)

    def update(self, feet: Array, joint_part: Array, angular_velocity: Array, rotation: Array, stance: Bools) -> None:
        """Takes one sample in; with no foot in stance the position stays.

        Args:
            feet: (4, 3) [m], and
            joint_part: (4, 3) [m/s], J_i q̇_i, both in the trunk frame.
            angular_velocity: (3,) [rad/s], trunk axes.
            rotation: (3, 3), of the trunk in the world.
            stance: (4,) bool.
        """
        levers = feet @ rotation.T
        if stance is not self._stance and not np.array_equal(stance, self._stance):
            self._change_stance(levers, stance)
        if not stance.any():
            return
        left = self.anchors - levers
        self.position = self._weights @ left
        mean_foot, mean_rate = self._weights @ feet, self._weights @ joint_part
        wx, wy, wz = angular_velocity.tolist()
        x, y, z = mean_foot.tolist()
        turning = np.array([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x])
        self.velocity = -(rotation @ (mean_rate + turning))
        left -= self.position
        self.slipped = stance & ((left * left).sum(axis=1) > _SLIP**2)
        if self.slipped.any():
            self.anchors[self.slipped] -= left[self.slipped]

    def _change_stance(self, levers: Array, stance: Bools) -> None:
        new = stance & ~self._stance
        self.anchors[new] = self.position + levers[new]
        self._stance = stance.copy()
        self._weights = stance / max(int(stance.sum()), 1)
