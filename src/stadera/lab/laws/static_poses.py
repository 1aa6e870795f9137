"""Trunk poses for static weighing: which ones the legs can reach, and the accuracy to expect from them.

The equations at rest contain only the centre of mass normal to the vertical, so one level pose determines x and y. A
pose tilted by γ determines the height as well, with an error 1 / sin γ times that in the plane. Constant errors of the
sensors are separated by tilts about both axes, to both sides, and by shifts, which change the legs' shapes and their
loads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.constants import GRAVITY
from stadera.errors import ModelError
from stadera.inertia import skew
from stadera.lab.control.legs import LegDynamics, foot_jacobians
from stadera.lab.laws.equilibrium import ConstantErrors
from stadera.lab.laws.poses import PoseMean, centre_of, plausible, with_errors, with_poses
from stadera.robot.kinematics import foot_positions
from stadera.robot.model import Robot
from stadera.robot.stance import nominal_feet, standing_configuration
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkBounds, TrunkModel
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.types import Array


@dataclass(frozen=True)
class Reach:
    """Requirements on the legs in a pose."""

    least_load: float = 0.05  # on every foot, as a share of the robot's weight
    torque: float = 0.8  # largest torque of any joint, as a share of its effort limit
    least_size: float = 0.25  # share of its requested size below which a pose is given up
    shrunk: float = 0.8  # factor by which a pose out of reach is reduced in each attempt
    solved: float = 1e-7  # distance of the feet from their targets below which a pose is reached [m]
    steps: int = 30  # of Newton's method
    largest_step: float = 0.2  # of each joint in one step [rad]


_REACH = Reach()


@dataclass(frozen=True, eq=False)
class PoseOffset:
    """A pose of the trunk relative to the nominal stance, with the feet unchanged."""

    shift: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m], of the origin, in the nominal trunk's axes
    turn: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [rad], rotation vector in its axes

    def scaled(self, share: float) -> PoseOffset:
        """The pose with shift and turn multiplied by `share`."""
        return PoseOffset(share * self.shift, share * self.turn)


def static_poses(
    robot: Robot, tilt: float = np.deg2rad(12.0), shift: float = 0.15, count: int = 11
) -> tuple[PoseOffset, ...]:
    """A small set of poses that determines the whole centre of mass: level, rolled and pitched, then shifted.

    In this order: level, pitch and roll to both sides, then shifts to all sides and down. A pose that the legs cannot
    reach, within the joints' limits and torques and with loaded feet, is reduced until they can.

    Args:
        tilt: of the tilted poses [rad].
        shift: of the shifted ones, as a share of the standing height.
        count: number of poses to use, of the eleven, from the first.

    Raises:
        ModelError: fewer than 1 or more than 11 poses, or a pose that the legs cannot reach at a quarter of its size.
    """
    height = -float(nominal_feet(robot)[:, 2].mean())
    x, y, z = np.eye(3)
    turns = [tilt * axis for axis in (y, -y, x, -x)]
    shifts = [shift * height * axis for axis in (x, -x, y, -y, -z)]
    wanted = [PoseOffset(), *(PoseOffset(turn=turn) for turn in turns), *(PoseOffset(shift=s) for s in shifts)]
    wanted.append(PoseOffset(turn=tilt * z))
    if not 1 <= count <= len(wanted):
        raise ModelError(f"there are 1 to {len(wanted)} static poses to choose from, got {count}")
    legs = LegDynamics(robot)
    return tuple(_within_reach(legs, pose) for pose in wanted[:count])


def expected_covariance(
    robot: Robot,
    poses: Sequence[PoseOffset],
    errors: ConstantErrors,
    *,
    seek_errors: bool = False,
    samples: int = 1000,
) -> Array:
    """Expected covariance (4, 4) of mass [kg] and CoM [m] of the robot's own trunk from holding these poses.

    Args:
        poses: relative to the nominal stance on level ground.
        errors: constant over the run.
        seek_errors: treat them as unknowns; else they are considered.
        samples: number in each pose.

    Raises:
        ModelError: a pose is out of the legs' _REACH.
    """
    forces = ContactForceEstimator(robot)
    known = plausible(robot, TrunkModel.prior(robot), TrunkBounds.of(robot))
    legs = LegDynamics(robot)
    for pose in poses:
        measurement = standing_still(robot, pose, legs)
        if measurement is None:
            raise ModelError(f"robot {robot.name}: pose {pose.shift} m, {pose.turn} rad is out of reach")
        mean = PoseMean(measurement)
        mean.count = samples
        known = with_poses(known, forces, [mean])
    return centre_of(with_errors(known, errors, seek=seek_errors))[1]


def standing_still(robot: Robot, pose: PoseOffset, legs: LegDynamics | None = None) -> Measurement | None:
    """Measurement of ideal sensors when the robot holds a pose on level ground; None if it cannot.

    The contact forces are the smallest ones that hold it, which may need friction.

    Args:
        pose: relative to the nominal stance.
        legs: None for a new one.
    """
    source = legs or LegDynamics(robot)
    q0 = standing_configuration(robot)
    rotation = Rotation.from_rotvec(pose.turn).as_matrix()
    feet = (foot_positions(robot, q0[None])[0] - pose.shift) @ rotation
    q = _reached(source, feet, q0)
    if q is None:
        return None
    up, n = rotation[2], len(q)
    still = Measurement(0.0, q, np.zeros(n), np.zeros(n), np.zeros(3), GRAVITY * up, rotation)
    state = source.measured(still)
    contact = feet - np.array([[leg.foot_radius] for leg in robot.legs]) * up
    grasp = np.vstack([np.hstack([np.eye(3)] * len(contact)), np.hstack([skew(p) for p in contact])])
    trunk = TrunkModel.prior(robot)
    pull = np.concatenate([robot.mass * up, np.cross(trunk.mass * trunk.com_trunk + state.moment, up)]) * GRAVITY
    force = (np.linalg.pinv(grasp) @ pull).reshape(-1, 3)
    torque = state.bias - np.einsum("lij,li->lj", state.jacobians(contact), force)
    effort = np.array([robot.dynamics[joint].offset for joint in robot.tree.joints])
    effort[source.columns] += torque
    most = np.array([robot.limits[joint].effort for joint in robot.tree.joints])
    loaded = bool((force @ up).min() > _REACH.least_load * robot.mass * GRAVITY)
    if not loaded or bool((np.abs(effort) > _REACH.torque * most).any()):
        return None
    return Measurement(0.0, q, np.zeros(n), effort, np.zeros(3), GRAVITY * up, rotation)


def _within_reach(legs: LegDynamics, pose: PoseOffset) -> PoseOffset:
    share, robot = 1.0, legs.robot
    while standing_still(robot, pose.scaled(share), legs) is None:
        share *= _REACH.shrunk
        if share < _REACH.least_size:
            raise ModelError(f"robot {robot.name}: no pose near {pose.shift} m, {pose.turn} rad is within reach")
    return pose.scaled(share)


def _reached(legs: LegDynamics, feet: Array, start: Array) -> Array | None:
    """Joint angles (n,) that bring the feet (4, 3) to these positions, within the limits; None if there are none."""
    robot, columns = legs.robot, legs.columns
    low = np.array([robot.limits[joint].lower for joint in robot.tree.joints])
    high = np.array([robot.limits[joint].upper for joint in robot.tree.joints])
    q = start.copy()
    for _ in range(_REACH.steps):
        miss = feet - foot_positions(robot, q[None])[0]
        step = np.linalg.pinv(foot_jacobians(robot, q[None])[0]) @ miss[:, :, None]
        q[columns] += np.clip(step[:, :, 0], -_REACH.largest_step, _REACH.largest_step)
    miss = feet - foot_positions(robot, q[None])[0]
    inside = ((q >= low) & (q <= high)).all()
    return q if inside and float(np.abs(miss).max()) < _REACH.solved else None
