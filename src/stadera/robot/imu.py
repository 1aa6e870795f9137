"""Pose of the IMU on the trunk: the only place where its values are rotated to trunk axes and moved to the origin.

The IMU at r (trunk frame) reads the specific force a_imu; at the trunk's origin it is, for a rigid trunk::

    a = a_imu - ω x (ω x r) - α x r
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from stadera.errors import ModelError, UnknownNameError
from stadera.robot.model import Robot
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class ImuMount:
    """Pose of the named IMU frame in the trunk frame: r_trunk = rotation (3, 3) @ r_imu + translation (3,) [m]. One on
    a link outside the legs is that with their joints at the reference, where those that carry it have to stay.
    """

    rotation: Array
    translation: Array
    name: str

    @classmethod
    def of(cls, robot: Robot, frame: str | None = None, of_log: str | None = None) -> Self:
        """Mount of the named frame, else of that of a log, `of_log`; for None, of the only frame on the trunk
        with "imu" in its name, or on the trunk itself where others are beyond a waist, else of the trunk frame.
        UnknownNameError if there is no such frame, ModelError if it is fixed to a leg.
        """
        extra, where = robot.extra, robot.name
        if not frame and of_log:
            frame, where = of_log, f"the log may be of another robot than {robot.name}"
        if frame is None:
            found = [name for name, f in robot.frames.items() if "imu" in name.lower() and f.link == robot.trunk]
            own = [name for name in found if extra is None or name not in extra.frames]  # not beyond a waist or a neck
            frame = next((names[0] for names in (own, found) if len(names) == 1), robot.trunk)
        if frame == robot.trunk:
            return cls(np.eye(3), np.zeros(3), frame)
        if extra is not None and frame in extra.frames:
            pose = extra.frames[frame]
            R, p = extra.poses(extra.reference)[extra.links.index(pose.link)]
            return cls(R @ pose.rotation, p + R @ pose.translation, frame)
        if frame not in robot.frames:
            on_trunk = (name for name, f in robot.frames.items() if f.link == robot.trunk)
            raise UnknownNameError("IMU frame", frame, dict.fromkeys((robot.trunk, *on_trunk)), where)
        pose = robot.frames[frame]
        if pose.link != robot.trunk:
            raise ModelError(f"robot {robot.name}: IMU frame {frame!r} is fixed to {pose.link!r}, not to the trunk")
        return cls(np.array(pose.rotation), np.array(pose.translation), frame)

    def in_trunk_axes(self, values: Array) -> Array:
        """Rotates vectors (..., 3) from the IMU's axes to the trunk's."""
        return np.asarray(values.dot(self.rotation.T))

    def trunk_rotation(self, imu_rotation: Array) -> Array:
        """Orientation of the trunk (..., 3, 3) in the world, from that of the IMU."""
        return np.asarray(imu_rotation.dot(self.rotation.T))


def force_at_origin(
    specific_force: Array, angular_velocity: Array, lever: Array, angular_acceleration: Array | None = None
) -> Array:
    """Specific force at the trunk's origin (..., 3) [m/s²] from that at the IMU, all in trunk axes.

    Without the angular acceleration (..., 3) [rad/s²] the term α x r is not removed. The lever (3,) [m] is the position
    of the IMU in the trunk frame.
    """
    w = angular_velocity
    centripetal = w * w.dot(lever)[..., None] - lever * (w * w).sum(axis=-1)[..., None]  # ω x (ω x r)
    force = specific_force - centripetal
    return np.asarray(force if angular_acceleration is None else force - np.cross(angular_acceleration, lever))
