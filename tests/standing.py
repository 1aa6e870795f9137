"""A robot standing at rest, worked out by Pinocchio from the raw model file: nothing of the package's own dynamics."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from stadera.lab.control.legs import joint_columns
from stadera.logs import Imu, Recording
from stadera.robot import Robot
from stadera.robot.kinematics import checked_angles, foot_positions, leg_kinematics
from stadera.robot.stance import standing_configuration
from stadera.trunk import Measurement
from stadera.types import Array

GRAVITY = 9.81


class StandingRobot:
    """Static equilibrium of a robot with a point load, on a plane through its feet, however the trunk is turned.

    Args:
        robot: its model file is what Pinocchio reads.
        load: [kg], at
        place: (3,) [m], trunk frame.
        others: positions of joints outside the legs by name [rad or m]; at zero where not named.
    """

    def __init__(
        self,
        robot: Robot,
        load: float = 0.0,
        place: tuple[float, float, float] = (0.0, 0.0, 0.0),
        others: Mapping[str, float] | None = None,
    ) -> None:
        self.robot, self._others = robot, others or {}
        model = pin.buildModelFromUrdf(str(robot.source), pin.JointModelFreeFlyer())
        model.inertias[1] += pin.Inertia(load, np.array(place), np.zeros((3, 3)))
        self.model, self.data = model, model.createData()
        self.mass = pin.computeTotalMass(model)
        trunk = model.inertias[1]
        self.trunk_mass, self.trunk_com = float(trunk.mass), np.array(trunk.lever)
        self._in_q = [model.joints[model.getJointId(name)].idx_q for name in robot.tree.joints]
        self._in_v = [model.joints[model.getJointId(name)].idx_v for name in robot.tree.joints]
        self._feet = [model.getFrameId(leg.foot) for leg in robot.legs]

    def whole_com(self, joints: np.ndarray) -> np.ndarray:
        """The robot's centre of mass in the trunk frame (3,) [m]."""
        return np.array(pin.centerOfMass(self.model, self.data, self._configuration(joints, np.eye(3))))

    def efforts(self, joints: np.ndarray, rotation: np.ndarray, carrying: tuple[int, ...] = (0, 1, 2, 3)) -> np.ndarray:
        """Joint torques (n,) [N·m] with the least contact forces that hold it, on the feet that carry."""
        q = self._configuration(joints, rotation)
        pin.forwardKinematics(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        centres = np.array([self.data.oMf[frame].translation for frame in self._feet])
        normal = np.linalg.svd(centres[list(carrying)] - centres[list(carrying)].mean(axis=0))[2][2]
        normal *= np.sign(normal @ rotation[:, 2])
        jacobians = []
        for leg in carrying:
            J = pin.computeFrameJacobian(
                self.model, self.data, q, self._feet[leg], pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            )
            down = -self.robot.legs[leg].foot_radius * normal
            jacobians.append(J[:3] - pin.skew(down) @ J[3:])  # of the material point on the sole
        stacked = np.vstack(jacobians)
        gravity = pin.computeGeneralizedGravity(self.model, self.data, q)
        force = np.linalg.lstsq(stacked[:, :6].T, gravity[:6], rcond=None)[0]
        return (gravity - stacked.T @ force)[self._in_v]

    def holding(self, joints: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Joint torques (n,) [N·m] that hold the legs in the air, the trunk hung up."""
        q = self._configuration(joints, rotation)
        return np.array(pin.computeGeneralizedGravity(self.model, self.data, q))[self._in_v]

    def measurement(
        self,
        time: float,
        joints: np.ndarray,
        rotation: np.ndarray | None = None,
        carrying: tuple[int, ...] = (0, 1, 2, 3),
    ) -> Measurement:
        """What ideal sensors say of it."""
        R = np.eye(3) if rotation is None else rotation
        n = len(joints)
        effort = self.efforts(joints, R, carrying)
        return Measurement(time, joints, np.zeros(n), effort, np.zeros(3), GRAVITY * R[2], R)

    def held(
        self, joints: np.ndarray, believed_com: np.ndarray, stiffness: np.ndarray, reference: np.ndarray
    ) -> np.ndarray:
        """The trunk's rotation (3, 3) when virtual springs hold it about a believed centre of mass of the whole robot.

        Moments about the true one: gravity compensation, upwards through the believed one, and the springs' add up
        to none.
        """
        lever, turn = believed_com - self.whole_com(joints), np.zeros(3)
        for _ in range(30):
            up = (reference @ Rotation.from_rotvec(turn).as_matrix())[2]
            before, turn = turn, np.cross(lever, self.mass * GRAVITY * up) / stiffness
            if np.abs(turn - before).max() < 1e-13:
                return reference @ Rotation.from_rotvec(turn).as_matrix()
        raise AssertionError("the springs are too soft to hold it")

    def _configuration(self, joints: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        q = pin.neutral(self.model)
        q[3:7] = Rotation.from_matrix(rotation).as_quat()
        q[self._in_q] = joints
        for name, value in self._others.items():
            q[self.model.joints[self.model.getJointId(name)].idx_q] = value
        return q


RATE, HELD = 100.0, 0.5  # Hz, s of each pose
TILTS = [(0, 0), (6, 0), (-6, 0), (0, 6), (0, -6), (5, 5)]  # °, about x and y


def static_log(robot: Robot, load: float = 0.0, seed: int = 3) -> Recording:
    """Poses held at rest, by Pinocchio, with a little white noise as any sensor has."""
    plant = StandingRobot(robot, load, (0.05, 0.03, 0.1))
    rng = np.random.default_rng(seed)
    nominal = standing_configuration(robot)
    count = round(HELD * RATE)
    rows: dict[str, list[np.ndarray]] = {"q": [], "tau": [], "a": [], "turn": []}
    for roll, pitch in TILTS:
        turn = Rotation.from_euler("xy", [roll, pitch], degrees=True)
        joints = _with_feet_at(robot, nominal, turn)
        for name, values in (
            ("q", joints),
            ("tau", plant.efforts(joints, turn.as_matrix())),
            ("a", GRAVITY * turn.as_matrix()[2]),
            ("turn", turn.as_quat()),
        ):
            rows[name] += [values] * count
    q, tau, a, turns = (np.array(rows[name]) for name in ("q", "tau", "a", "turn"))
    samples = len(q)
    return Recording(
        time=np.arange(samples) / RATE,
        joints=robot.tree.joints,
        position=q + 1e-4 * rng.normal(size=q.shape),
        velocity=1e-2 * rng.normal(size=q.shape),
        effort=tau + 1e-2 * rng.normal(size=q.shape),
        imu=Imu(1e-3 * rng.normal(size=a.shape), a + 2e-2 * rng.normal(size=a.shape), turns, robot.trunk),
    )


def _with_feet_at(robot: Robot, nominal: np.ndarray, turn: Rotation) -> np.ndarray:
    """Joints with which the feet stay where they are in the world, the trunk turned; Newton's method."""
    wanted = turn.inv().apply(foot_positions(robot, nominal[None])[0])
    q = nominal.copy()
    columns = [[robot.tree.joints.index(joint) for joint in leg.joints] for leg in robot.legs]
    for _ in range(20):
        error = wanted - foot_positions(robot, q[None])[0]
        jacobians = foot_jacobians(robot, q[None])[0]
        for leg, place in enumerate(columns):
            q[place] += np.linalg.solve(jacobians[leg], error[leg])
    return q


def foot_jacobians(robot: Robot, q: ArrayLike) -> Array:
    """Jacobians of the feet with respect to their own leg's three joints (HAA, HFE, KFE, the last axis), trunk frame
    [m/rad], (N, 4, 3, 3): `foot velocity = J @ joint velocity` for a trunk that stands still. ModelError for another
    shape of q.
    """
    angles = checked_angles(robot.tree, q)
    slopes = [
        leg_kinematics(robot.leg_tree(leg.name), leg, angles[:, own])[2][..., :3]
        for leg, own in zip(robot.legs, joint_columns(robot), strict=True)
    ]
    return np.stack(slopes, axis=1).swapaxes(2, 3)
