"""Whole-body controller of robots on flat feet: inverse dynamics with legs that their feet determine.

The demanded acceleration of the trunk is that of springs and dampers to its reference, those of the arms of theirs,
feet in stance do not accelerate, and those in the air follow their trajectories. A leg of as many joints as its contact
has components (more are shared with least squares) then has the acceleration

    q̈_l = J_l⁺ (a_l - J̇_l v - J_b v̇_b)

so all of v̇ is known, and with it the six components of the wrench that the ground must exert,

    [M v̇ + h]_b = Σ_i J_bᵢᵀ f_i

over the points i of the soles. It is distributed over the points within their friction cones by the quadratic programme
of `stadera.lab.control.distribution`, and the torques are τ = [M v̇ + h - Σ J_iᵀ f_i] of the joints. Friction is not
compensated: by a model of more than the joint has, standing legs chatter. The centre of pressure stays inside the soles
because only their corners carry. Position and velocity of the trunk follow from the feet in stance, its orientation
from the IMU.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stadera.constants import GRAVITY
from stadera.lab.control.arms import Arms
from stadera.lab.control.distribution import ForceDistribution
from stadera.lab.control.legs import cross
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


@dataclass(frozen=True, eq=False)
class Seen:
    """What one measurement says; vectors in world axes, places from the trunk's origin."""

    rotation: Array  # (3, 3), of the trunk
    angular_velocity: Array  # (3,) [rad/s], trunk axes
    jacobians: list[Array]  # (c, 6 + n) of each foot
    inverses: list[Array]  # (c's own joints, c), of their columns of the leg's own joints
    feet: Array  # (L, 3) [m]
    turned: Array  # (L, 3, 3), of the feet
    velocity: Array  # (3,) [m/s], of the trunk's origin by the feet in stance
    com: Array  # (3,) [m], of the whole robot
    com_velocity: Array  # (3,) [m/s]


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
        least = 0.02 * robot.mass * GRAVITY / count  # share of the weight on all points
        self._sharing = ForceDistribution(least, 0.5 * robot.leg_length, feet=count)
        self._effort = np.array([robot.limits[joint].effort for joint in robot.tree.joints])
        self.stance: Bools = np.ones(len(robot.legs), dtype=bool)
        self._weights = np.full(len(robot.legs), 1.0 / len(robot.legs))  # with which feet say where the trunk is
        self.position, self._anchors = np.zeros(3), np.zeros((len(robot.legs), 3))
        here = TrunkPose(np.zeros(3), np.eye(3))
        self._reference = Move(here, here, 0.0, 1.0)

    def update_trunk(self, trunk: TrunkModel) -> bool:
        """False: it keeps the model file's trunk."""
        return False

    def update(self, measurement: Measurement) -> Array:
        """Joint torques (n,) [N·m] for one measurement; the first update uses the trunk's pose as reference."""
        m, model, data = measurement, self._model, self._data
        if m.rotation is None:
            raise ControlError("the whole-body controller needs the trunk's orientation")
        q, v = pin.neutral(model), np.zeros(model.nv)  # the trunk's origin at zero
        q[3:7], q[7:], v[3:6], v[6:] = (
            pin.Quaternion(m.rotation).coeffs(),
            m.joint_position,
            m.angular_velocity,
            m.joint_velocity,
        )
        seen = self._seen(m, q, v)
        before, self.time = self.time, m.time
        if np.isnan(before):
            self._begin(seen)
        self.position = self._weights @ (self._anchors - seen.feet)
        self._plan(seen, self.time - before)
        needed = np.array(pin.rnea(model, data, q, v, self._accelerations(seen, m, q, v)))
        forces, arms = self._forces(seen, needed)
        for jacobian, own, share in zip(seen.jacobians, arms, forces, strict=True):
            wrench = np.concatenate([share.sum(axis=0), np.cross(own, share).sum(axis=0)])
            needed -= jacobian.T @ wrench[: len(jacobian)]
        torque = needed[6:] + self._friction(seen)
        if not np.isfinite(torque).all():
            raise ControlError(f"no torques at {self.time:.6f} s: a value that was measured is not finite")
        return np.asarray(np.clip(torque, -self._effort, self._effort))

    def _seen(self, m: Measurement, q: Array, v: Array) -> Seen:
        """Writes the trunk's velocity, in its axes, into v."""
        R, model, data = np.asarray(m.rotation), self._model, self._data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        J = [np.array(pin.getFrameJacobian(model, data, frame, _LEVEL))[:size] for frame, _, size in self._legs]
        feet = np.array([data.oMf[leg[0]].translation for leg in self._legs])
        turned = np.array([data.oMf[leg[0]].rotation for leg in self._legs])
        velocity = -self._weights @ np.array([jacobian[:3] @ v for jacobian in J])
        v[:3] = R.T @ velocity
        com = np.array(pin.centerOfMass(model, data, q, v, False))
        inverses = [np.linalg.pinv(own[:, leg[1]], rcond=1e-3) for own, leg in zip(J, self._legs, strict=True)]
        return Seen(R, m.angular_velocity, J, inverses, feet, turned, velocity, com, np.array(data.vcom[0]))

    def _begin(self, seen: Seen) -> None:
        """Anchors the feet, and moves the centre of mass over their middle."""
        self._anchors = seen.feet
        middle = np.mean([self._middle(seen, k) for k in range(len(self._legs))], axis=0)
        here = TrunkPose(np.zeros(3), seen.rotation)
        there = here.moved(np.array([*(middle - seen.com)[:2], 0.0]), np.zeros(3))
        self._reference = Move(here, there, self.time, self.centred)

    def _middle(self, seen: Seen, leg: int) -> Array:
        """The middle (3,) [m] of a foot's sole."""
        return np.asarray(seen.feet[leg] + seen.turned[leg] @ self._soles[leg][0].mean(axis=0))

    def _plan(self, seen: Seen, dt: float) -> None:
        """Decides which feet stand, for robots that step."""

    def _accelerations(self, seen: Seen, m: Measurement, q: Array, v: Array) -> Array:
        """Those of the trunk, in its axes, and of the joints, (6 + n,)."""
        goal, omega, R, a = self._reference.at(self.time), seen.angular_velocity, seen.rotation, np.zeros_like(v)
        k, d = self._stiffness, self._damping
        pull = k[0] * (goal.position - self.position) + d[0] * (goal.velocity - seen.velocity) + goal.acceleration
        to_goal = R.T @ goal.rotation
        a[:3] = R.T @ pull - cross(omega, v[:3])
        a[3:6] = k[1] * pin.log3(to_goal) + d[1] * (to_goal @ goal.angular_velocity - omega)
        first = self.arms.first
        a[6 + first :] = self.arms.accelerations(self.time, m.joint_position[first:], m.joint_velocity[first:])
        pin.forwardKinematics(self._model, self._data, q, v, np.zeros_like(v))
        shifting = np.zeros((len(v), 3))  # of all, by an acceleration of the trunk's origin
        shifting[:3] = np.eye(3)
        for leg, ((frame, columns, size), jacobian) in enumerate(zip(self._legs, seen.jacobians, strict=True)):
            inverse = -seen.inverses[leg]
            free = pin.getFrameClassicalAcceleration(self._model, self._data, frame, _LEVEL).vector[:size]
            wanted = self._foot_acceleration(seen, leg, jacobian @ v)
            a[columns] = inverse @ (free - wanted[:size] + jacobian[:, :6] @ a[:6])
            shifting[columns] = inverse @ jacobian[:, :3]
        if (com := self._com_acceleration(seen)) is not None:
            M = np.asarray(pin.crba(self._model, self._data, q))[:3]
            force = self.robot.mass * R.T @ (com + GRAVITY * _UP)
            left = force - np.asarray(pin.rnea(self._model, self._data, q, v, a))[:3]
            a += shifting @ np.linalg.solve(M @ shifting, left)
        return a

    def _foot_acceleration(self, seen: Seen, leg: int, velocity: Array) -> Array:
        """Demanded acceleration (6,) of a foot, linear and angular, from its velocity (c,), in world axes."""
        return np.zeros(6)

    def _com_acceleration(self, seen: Seen) -> Array | None:
        """Demanded acceleration (3,) [m/s²] of the centre of mass; None to move the trunk's origin by its reference."""
        return None

    def _friction(self, seen: Seen) -> Array:
        """Torques (n,) [N·m] against friction."""
        return np.zeros(len(self._effort))

    def _forces(self, seen: Seen, needed: Array) -> tuple[list[Array], list[Array]]:
        """Forces [N] on the points of each sole, and the points from the foot's centre [m], (k, 3) each."""
        arms = [
            points @ turned.T - radius * _UP for (points, radius), turned in zip(self._soles, seen.turned, strict=True)
        ]
        levers = np.concatenate([own + place - seen.com for own, place in zip(arms, seen.feet, strict=True)])
        force, moment = seen.rotation @ needed[:3], seen.rotation @ needed[3:6]
        forces = self._sharing.solve(levers, force, moment - cross(seen.com, force))
        return np.split(forces, np.cumsum([len(own) for own in arms])[:-1]), arms
