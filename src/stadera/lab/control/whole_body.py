"""Whole-body controller of robots on flat feet: inverse dynamics with legs that their feet determine.

The demanded acceleration of the trunk is that of springs and dampers to its reference, those of the arms of theirs, and
feet in stance do not accelerate. A leg of as many joints as its contact has components (more are shared with least
squares) then has the acceleration

    q̈_l = J_l⁺ (a_l - J̇_l v - J_b v̇_b)

so all of v̇ is known, and with it the six components of the wrench that the ground must exert,

    [M v̇ + h]_b = Σ_i J_bᵢᵀ f_i

over the points i of the soles. It is distributed over the points within their friction cones by the quadratic programme
of `stadera.lab.control.distribution`, and the torques are τ = [M v̇ + h - Σ J_iᵀ f_i] of the joints. Friction is not
compensated: by a model of more than the joint has, standing legs chatter. The centre of pressure stays inside the soles
because only their corners carry. Position and velocity of the trunk follow from the feet in stance, its orientation
from the IMU.
"""

import numpy as np
import pinocchio as pin

from stadera.constants import GRAVITY
from stadera.lab.control.arms import Arms
from stadera.lab.control.distribution import ContactLimits, ForceDistribution
from stadera.lab.control.reference import ControlError, Follower, Move, TrunkPose
from stadera.lab.control.trunk import TrunkGains
from stadera.lab.pinocchio import pinocchio_model
from stadera.robot.model import Robot
from stadera.robot.sole import sole
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.types import Array, Bools

_LEVEL = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
_UP = np.array([0.0, 0.0, 1.0])


class WholeBody(Follower):
    """Stands on all feet and follows a reference of the trunk, with the interface of `TrunkController`.

    Args:
        robot: with all joints in its tree, as the controller knows it.
        arms: motion of the joints outside the legs.
    """

    centred = 1.0  # time in which the centre of mass moves over the middle of the soles at the beginning [s]

    def __init__(self, robot: Robot, arms: Arms) -> None:
        self.robot, self.arms, self.gains = robot, arms, TrunkGains.of(robot)
        frequencies = np.array([self.gains.linear, self.gains.angular])
        self._stiffness, self._damping = np.square(frequencies), 2.0 * self.gains.ratio * frequencies
        self._model, self._soles = pinocchio_model(robot), [sole(robot, leg) for leg in robot.legs]
        self._legs = []
        for k, leg in enumerate(robot.legs):
            joint = self._model.getJointId(leg.joints[-1])
            place = pin.SE3(np.eye(3), np.array(leg.foot_position))
            frame = self._model.addFrame(pin.Frame(f"{leg.name} sole", joint, place, pin.FrameType.OP_FRAME))
            columns = 6 + np.array([robot.tree.joints.index(name) for name in leg.joints])
            self._legs.append((frame, columns, leg.contact))
            points, radius = self._soles[k]
            self._soles[k] = points - np.array(leg.foot_position), radius
        self._data = self._model.createData()
        count = sum(len(points) for points, _ in self._soles)
        limits = ContactLimits(least_normal=0.02 * robot.mass * GRAVITY / count)  # share of the weight on all points
        self._sharing = ForceDistribution(limits, 0.5 * robot.leg_length, feet=count)
        self._effort = np.array([robot.limits[joint].effort for joint in robot.tree.joints])
        self.stance: Bools = np.ones(len(robot.legs), dtype=bool)
        self.position, self._anchors = np.zeros(3), np.zeros((len(robot.legs), 3))
        here = TrunkPose(np.zeros(3), np.eye(3))
        self._reference = Move(here, here, 0.0, 1.0)

    def update_trunk(self, trunk: TrunkModel) -> bool:
        """False: it keeps the model file's trunk."""
        return False

    def update(self, measurement: Measurement) -> Array:
        """Joint torques (n,) [N·m] for one measurement; the first update uses the trunk's pose as reference."""
        m, R, model, data = measurement, measurement.rotation, self._model, self._data
        if R is None:
            raise ControlError("the whole-body controller needs the trunk's orientation")
        first, self.time = bool(np.isnan(self.time)), m.time
        q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)  # the trunk's origin at zero
        q[3:7], q[7:], v[3:6], v[6:] = (
            pin.Quaternion(R).coeffs(),
            m.joint_position,
            m.angular_velocity,
            m.joint_velocity,
        )
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        J = [np.array(pin.getFrameJacobian(model, data, frame, _LEVEL))[:size] for frame, _, size in self._legs]
        poses = [(np.array(data.oMf[leg[0]].rotation), np.array(data.oMf[leg[0]].translation)) for leg in self._legs]
        feet = np.array([place for _, place in poses])
        velocity = -np.mean([jacobian[:3] @ v for jacobian in J], axis=0)
        v[:3] = R.T @ velocity
        com = np.array(pin.centerOfMass(model, data, q))
        if first:
            self._begin(R, feet, com)
        self.position = np.mean(self._anchors - feet, axis=0)
        self._demand(m, R, velocity, a)
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        for (frame, columns, size), jacobian in zip(self._legs, J, strict=True):
            free = pin.getFrameClassicalAcceleration(model, data, frame, _LEVEL).vector[:size]
            a[columns] = -np.linalg.pinv(jacobian[:, columns], rcond=1e-3) @ (free + jacobian[:, :6] @ a[:6])
        needed = np.array(pin.rnea(model, data, q, v, a))
        arms = [
            points @ turned.T - radius * _UP for (points, radius), (turned, _) in zip(self._soles, poses, strict=True)
        ]
        levers = np.concatenate([own + place - com for own, place in zip(arms, feet, strict=True)])
        force, moment = R @ needed[:3], R @ needed[3:6]
        forces = self._sharing.solve(levers, force, moment - np.cross(com, force))
        shares = np.split(forces, np.cumsum([len(own) for own in arms])[:-1])
        for jacobian, own, share in zip(J, arms, shares, strict=True):
            wrench = np.concatenate([share.sum(axis=0), np.cross(own, share).sum(axis=0)])
            needed -= jacobian.T @ wrench[: len(jacobian)]
        torque = needed[6:]
        if not np.isfinite(torque).all():
            raise ControlError(f"no torques at {self.time:.6f} s: a value that was measured is not finite")
        return np.asarray(np.clip(torque, -self._effort, self._effort))

    def _begin(self, R: Array, feet: Array, com: Array) -> None:
        """Anchors the feet, and moves the centre of mass over their middle."""
        self._anchors = feet
        middle = np.mean([foot + np.mean(p, axis=0) for foot, (p, _) in zip(feet, self._soles, strict=True)], axis=0)
        here = TrunkPose(np.zeros(3), R)
        self._reference = Move(
            here, here.moved(np.array([*(middle - com)[:2], 0.0]), np.zeros(3)), self.time, self.centred
        )

    def _demand(self, m: Measurement, R: Array, velocity: Array, a: Array) -> None:
        """Writes the accelerations of the trunk, in its axes, and of the arms."""
        goal, omega = self._reference.at(self.time), m.angular_velocity
        k, d = self._stiffness, self._damping
        pull = k[0] * (goal.position - self.position) + d[0] * (goal.velocity - velocity) + goal.acceleration
        to_goal = R.T @ goal.rotation
        a[:3] = R.T @ pull - np.cross(omega, R.T @ velocity)
        a[3:6] = k[1] * pin.log3(to_goal) + d[1] * (to_goal @ goal.angular_velocity - omega)
        first = self.arms.first
        a[6 + first :] = self.arms.accelerations(self.time, m.joint_position[first:], m.joint_velocity[first:])
