"""True state of the plant at one instant, hidden from estimators."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.types import Array, Bools


@dataclass(frozen=True, eq=False)
class TrueState:
    """The plant's state with the torque applied up to this instant; all values are simultaneous.

    Attributes:
        time: [s].
        position: (3,) [m], the trunk frame's origin in the world.
        orientation: (4,) quaternion xyzw of the trunk in the world.
        linear_velocity: (3,) [m/s], of the trunk frame's origin, world axes.
        angular_velocity: (3,) [rad/s], trunk axes.
        linear_acceleration: (3,) [m/s²], second derivative of `position`, world axes.
        angular_acceleration: (3,) [rad/s²], trunk axes.
        joint_position, joint_velocity, joint_acceleration: (n,) [rad, rad/s, rad/s²], in the tree's order.
        effort: (n,) [N·m], torques of the actuators on the joints.
        foot_position: (4, 3) [m], centres of the feet in the world, legs in the robot's order.
        contact_point: (4, 3) [m], contact points, world; NaN for feet in the air.
        foot_force: (4, 3) [N], forces of the ground on the feet, world axes.
        foot_contact: (4,) bool, whether the foot touches the ground.
    """

    time: float
    position: Array
    orientation: Array
    linear_velocity: Array
    angular_velocity: Array
    linear_acceleration: Array
    angular_acceleration: Array
    joint_position: Array
    joint_velocity: Array
    joint_acceleration: Array
    effort: Array
    foot_position: Array
    contact_point: Array
    foot_force: Array
    foot_contact: Bools

    @property
    def rotation(self) -> Array:
        """Rotation of the trunk in the world, r_world = R r_trunk, (3, 3)."""
        return rotation_of(self.orientation)


def rotation_of(quaternion: Array) -> Array:
    """The rotation matrix of a unit quaternion xyzw, (3, 3)."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
