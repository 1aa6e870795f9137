"""Trunk poses for static weighing: which ones the legs can reach.

The equations at rest contain only the centre of mass normal to the vertical, so one level pose determines x and y. A
pose tilted by γ determines the height as well, with an error 1 / sin γ times that in the plane. Constant errors of the
sensors are separated by tilts about both axes, to both sides, and by shifts, which change the legs' shapes and their
loads.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.body import Motion
from stadera.constants import GRAVITY
from stadera.errors import IdentificationError, ModelError
from stadera.excite.trunk.planted import Planted, planted_joints
from stadera.robot.model import Robot
from stadera.robot.stance import nominal_feet
from stadera.trunk.measurement import Measurement
from stadera.types import Array


@dataclass(frozen=True)
class Reach:
    """Sizes of the poses, and requirements on the legs in one."""

    tilt: float = float(np.deg2rad(12.0))  # of the tilted poses [rad]
    shift: float = 0.15  # of the shifted ones, as a share of the standing height
    least_load: float = 0.05  # on every foot, as a share of the robot's weight
    torque: float = 0.8  # largest torque of any joint, as a share of its effort limit
    least_size: float = 0.25  # share of its requested size below which a pose is given up
    shrunk: float = 0.8  # factor by which a pose out of reach is reduced in each attempt


_REACH = Reach()


@dataclass(frozen=True, eq=False)
class PoseOffset:
    """A pose of the trunk relative to the nominal stance, with the feet unchanged."""

    shift: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m], of the origin, in the nominal trunk's axes
    turn: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [rad], rotation vector in its axes

    def scaled(self, share: float) -> PoseOffset:
        """The pose with shift and turn multiplied by `share`."""
        return PoseOffset(share * self.shift, share * self.turn)


def static_poses(robot: Robot, count: int = 11) -> tuple[PoseOffset, ...]:
    """The first of a small set of eleven poses that determines the whole centre of mass: level, pitched and rolled to
    both sides, shifted to all sides and down, yawed. A pose that the legs cannot reach, within the joints' limits and
    torques and with loaded feet, is reduced until they can; ModelError at a quarter of its size.
    """
    tilt, height = _REACH.tilt, -float(nominal_feet(robot)[:, 2].mean())
    x, y, z = np.eye(3)
    turns = [tilt * axis for axis in (y, -y, x, -x)]
    shifts = [_REACH.shift * height * axis for axis in (x, -x, y, -y, -z)]
    wanted = [PoseOffset(), *(PoseOffset(turn=turn) for turn in turns), *(PoseOffset(shift=s) for s in shifts)]
    wanted.append(PoseOffset(turn=tilt * z))
    return tuple(_within_reach(robot, pose) for pose in wanted[:count])


def standing_still(robot: Robot, pose: PoseOffset) -> Measurement | None:
    """Measurement of ideal sensors when the robot holds a pose, relative to the nominal stance, on level ground; None
    if it cannot. The contact forces are the smallest ones that hold it, which may need friction.
    """
    rotation = Rotation.from_rotvec(pose.turn).as_matrix()
    try:
        q = planted_joints(robot, rotation[None], pose.shift[None], np.zeros((1, len(robot.legs), 3)))
    except IdentificationError:
        return None
    up, still = rotation[2], np.zeros_like(q)
    motion = Motion(q, still, still, np.zeros((1, 3)), np.zeros((1, 3)), GRAVITY * up[None], up[None])
    planted = Planted(robot, np.zeros(1), np.zeros((1, 6)), motion, np.ones((1, len(robot.legs))))
    torque, force = planted.torques(robot.inertias[robot.trunk])
    limits = [robot.limits[joint] for joint in robot.tree.joints]
    low, high, most = np.array([(limit.lower, limit.upper, limit.effort) for limit in limits]).T
    within = (q >= low) & (q <= high) & (np.abs(torque) <= _REACH.torque * most)
    if not within.all() or (force @ up).min() <= _REACH.least_load * robot.mass * GRAVITY:
        return None
    return Measurement(0.0, q[0], still[0], torque[0], np.zeros(3), GRAVITY * up, rotation)


def _within_reach(robot: Robot, pose: PoseOffset) -> PoseOffset:
    share = 1.0
    while standing_still(robot, pose.scaled(share)) is None:
        share *= _REACH.shrunk
        if share < _REACH.least_size:
            raise ModelError(f"robot {robot.name}: no pose near {pose.shift} m, {pose.turn} rad is within reach")
    return pose.scaled(share)
