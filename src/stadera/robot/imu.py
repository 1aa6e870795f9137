"""Where the IMU sits on the trunk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError, UnknownNameError
from stadera.robot.model import Array, Robot


@dataclass(frozen=True, eq=False)
class ImuMount:
    """Pose of the IMU frame in the trunk frame: r_trunk = rotation @ r_imu + translation.

    Attributes:
        rotation: (3, 3). translation: (3,) [m].
        name: of the frame.
    """

    rotation: Array
    translation: Array
    name: str

    @classmethod
    def of(cls, robot: Robot, frame: str | None = None) -> ImuMount:
        """The mount of the named frame; of None, of the trunk's only frame with "imu" in its name, else the trunk.

        Raises:
            UnknownNameError: no such frame.
            ModelError: the frame is fixed to a leg.
        """
        if frame is None:
            found = [name for name, f in robot.frames.items() if "imu" in name.lower() and f.link == robot.trunk]
            frame = found[0] if len(found) == 1 else robot.trunk
        if frame == robot.trunk:
            return cls(np.eye(3), np.zeros(3), frame)
        if frame not in robot.frames:
            raise UnknownNameError("IMU frame", frame, (robot.trunk, *robot.frames), robot.name)
        pose = robot.frames[frame]
        if pose.link != robot.trunk:
            raise ModelError(f"robot {robot.name}: IMU frame {frame!r} is fixed to {pose.link!r}, not to the trunk")
        return cls(np.array(pose.rotation), np.array(pose.translation), frame)
