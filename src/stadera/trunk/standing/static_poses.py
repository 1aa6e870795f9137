"""Poses of the trunk to hold for weighing it: which ones the legs reach, and what they will tell.

The equations at rest see the centre of mass normal to the vertical alone, so one level pose shows x and y. A pose
tilted by γ shows the height as well, with an error 1 / sin γ times that in the plane; constant errors of the sensors
are told apart by tilts about both axes, to both sides, and by shifts, which change the legs' shapes and their loads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.constants import GRAVITY
from stadera.errors import ModelError
from stadera.inertia import skew
from stadera.legs.model import foot_jacobians, foot_positions
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkBounds, TrunkModel
from stadera.trunk.standing.equilibrium import ConstantErrors
from stadera.trunk.standing.fit import centre_of, with_errors, with_poses
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.trunk.standing.pose_means import PoseMean
from stadera.trunk.standing.poses import plausible
from stadera.types import Array

_NEWTON_STEPS = 30
_LARGEST_STEP = 0.2  # rad
_SOLVED = 1e-7  # m
_SHRUNK = 0.8  # per attempt, a pose out of reach is made smaller


@dataclass(frozen=True)
class Reach:
    """What the legs must be able to do in a pose.

    Attributes:
        least_load: on every foot, as a share of the robot's weight.
        torque: of every joint at most, as a share of its effort limit.
        least_size: share of its wanted size below which a pose is given up.
    """

    least_load: float = 0.05
    torque: float = 0.8
    least_size: float = 0.25


@dataclass(frozen=True, eq=False)
class PoseOffset:
    """A pose of the trunk relative to the nominal stance, the feet staying where they are.

    Attributes:
        shift: (3,) [m], of the trunk's origin, in the nominal trunk's axes.
        turn: (3,) [rad], rotation vector from the nominal trunk, in its axes.
    """

    shift: Array = field(default_factory=lambda: np.zeros(3))
    turn: Array = field(default_factory=lambda: np.zeros(3))

    def scaled(self, share: float) -> PoseOffset:
        """The same, smaller or larger."""
        return PoseOffset(share * self.shift, share * self.turn)


def static_poses(
    robot: Robot, tilt: float = np.deg2rad(12.0), shift: float = 0.15, count: int = 11
) -> tuple[PoseOffset, ...]:
    """A small set of poses that shows the whole centre of mass: level, rolled and pitched, then shifted.

    In this order: level, pitch and roll to both sides, then shifts to all sides and down. A pose that the legs do not
    reach, within the joints' limits, torques and on loaded feet, is made smaller until they do.

    Args:
        tilt: of the tilted poses [rad].
        shift: of the shifted ones, as a share of the standing height.
        count: how many of the eleven, from the first.

    Raises:
        ModelError: fewer than 1 or more than 11 poses; a pose that the legs do not reach at a quarter of its size.
    """
    height = -float(foot_positions(robot, standing_configuration(robot)[None])[0, :, 2].mean())
    x, y, z = np.eye(3)
    turns = [tilt * axis for axis in (y, -y, x, -x)]
    shifts = [shift * height * axis for axis in (x, -x, y, -y, -z)]
    wanted = [PoseOffset(), *(PoseOffset(turn=turn) for turn in turns), *(PoseOffset(shift=s) for s in shifts)]
    wanted.append(PoseOffset(turn=tilt * z))
    if not 1 <= count <= len(wanted):
        raise ModelError(f"there are 1 to {len(wanted)} static poses to choose from, got {count}")
    source = ContactForceEstimator(robot)
    return tuple(_within_reach(source, pose) for pose in wanted[:count])


def expected_covariance(
    robot: Robot,
    poses: Sequence[PoseOffset],
    errors: ConstantErrors,
    *,
    seek_errors: bool = False,
    forces: ContactForceEstimator | None = None,
    samples: int = 1000,
) -> Array:
    """What holding these poses will tell of the robot's own trunk: covariance (4, 4) of mass [kg] and CoM [m].

    Args:
        poses: relative to the nominal stance on level ground.
        errors: that are constant over the run.
        seek_errors: they are unknowns; else considered.
        forces: None for ones with the default noise.
        samples: in each pose.

    Raises:
        ModelError: a pose out of the legs' reach.
    """
    forces = forces or ContactForceEstimator(robot)
    known = plausible(TrunkModel.prior(robot), TrunkBounds.of(robot))
    for pose in poses:
        measurement = standing_still(robot, pose, forces)
        if measurement is None:
            raise ModelError(f"robot {robot.name}: pose {pose.shift} m, {pose.turn} rad is out of reach")
        mean = PoseMean(measurement)
        mean.count = samples
        known = with_poses(known, forces, [mean])
    return centre_of(with_errors(known, errors, seek=seek_errors))[1]


def standing_still(
    robot: Robot, pose: PoseOffset, forces: ContactForceEstimator | None = None, reach: Reach | None = None
) -> Measurement | None:
    """What ideal sensors say when the robot holds a pose on level ground; None where it cannot.

    Of the forces that hold it, the least ones; they may need friction.

    Args:
        pose: relative to the nominal stance.
        forces: None for a new one.
        reach: what the legs must be able to do; None for the defaults.
    """
    source, reach = forces or ContactForceEstimator(robot), reach or Reach()
    q0 = standing_configuration(robot)
    rotation = Rotation.from_rotvec(pose.turn).as_matrix()
    feet = (foot_positions(robot, q0[None])[0] - pose.shift) @ rotation
    q = _reached(source, feet, q0)
    if q is None:
        return None
    up, n = rotation[2], len(q)
    still = Measurement(0.0, q, np.zeros(n), np.zeros(n), np.zeros(3), GRAVITY * up, rotation)
    state = source.legs.at(still)
    contact = feet - np.array([[leg.foot_radius] for leg in robot.legs]) * up
    grasp = np.vstack([np.hstack([np.eye(3)] * 4), np.hstack([skew(p) for p in contact])])
    trunk = TrunkModel.prior(robot)
    pull = np.concatenate([robot.mass * up, np.cross(trunk.mass * trunk.com_trunk + state.moment, up)]) * GRAVITY
    force = (np.linalg.pinv(grasp) @ pull).reshape(4, 3)
    torque = state.bias - np.einsum("lij,li->lj", state.jacobians(contact), force)
    effort = np.array([robot.dynamics[joint].offset for joint in robot.tree.joints])
    effort[source.legs.columns] += torque
    most = np.array([robot.limits[joint].effort for joint in robot.tree.joints])
    loaded = bool((force @ up).min() > reach.least_load * robot.mass * GRAVITY)
    if not loaded or bool((np.abs(effort) > reach.torque * most).any()):
        return None
    return Measurement(0.0, q, np.zeros(n), effort, np.zeros(3), GRAVITY * up, rotation)


def _within_reach(source: ContactForceEstimator, pose: PoseOffset) -> PoseOffset:
    share, robot, reach = 1.0, source.robot, Reach()
    while standing_still(robot, pose.scaled(share), source, reach) is None:
        share *= _SHRUNK
        if share < reach.least_size:
            raise ModelError(f"robot {robot.name}: no pose near {pose.shift} m, {pose.turn} rad is within reach")
    return pose.scaled(share)


def _reached(source: ContactForceEstimator, feet: Array, start: Array) -> Array | None:
    """Joint angles (n,) that bring the feet (4, 3) there, within the limits; None where there are none."""
    robot, columns = source.robot, source.legs.columns
    low = np.array([robot.limits[joint].lower for joint in robot.tree.joints])
    high = np.array([robot.limits[joint].upper for joint in robot.tree.joints])
    q = start.copy()
    for _ in range(_NEWTON_STEPS):
        miss = feet - foot_positions(robot, q[None])[0]
        step = np.linalg.pinv(foot_jacobians(robot, q[None])[0]) @ miss[:, :, None]
        q[columns] += np.clip(step[:, :, 0], -_LARGEST_STEP, _LARGEST_STEP)
    miss = feet - foot_positions(robot, q[None])[0]
    inside = ((q >= low) & (q <= high)).all()
    return q if inside and float(np.abs(miss).max()) < _SOLVED else None
