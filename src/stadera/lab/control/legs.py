"""Model of a quadruped's legs for a single sample, fast enough for a controller at 1 kHz (uses Pinocchio).

All vectors are in the trunk frame. A trunk that moves with angular velocity ω and specific force a obeys the equations
of one at rest in gravity-free space accelerated by a, so the bias torque

    h(q, q̇, ω, a) = actuator torques for free feet, without joint accelerations and friction

needs neither orientation nor gravity.

Joint accelerations add M q̈ to a leg's h, with M its own block of the joint-space inertia (rotors included), and the
coupling C q̈ to the trunk's rows (force and moment at its origin).

A point r fixed to a leg's last link has, for each joint j of that leg, the velocity a_j x (r - o_j) = v_j + a_j x r per
unit rate, where v_j is that of the link's point at the trunk's origin.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from stadera.inertia import skew
from stadera.lab.pinocchio import pinocchio_model
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.trunk.measurement import Measurement
from stadera.types import Array

_PERMUTATION = np.stack([-skew(axis) for axis in np.eye(3)]).reshape(3, 9)  # a x r = -[r]x a


@dataclass(frozen=True, eq=False)
class LegState:
    """State of the legs at one sample, trunk frame; legs in the robot's order, joints HAA, HFE, KFE."""

    feet: Array  # (4, 3) [m], centres of the feet
    axes: Array  # (4, 3, 3), `axes[leg, :, joint]` is the joint's axis
    at_origin: Array  # (4, 3, 3) [m/rad], Jacobians of the last links' points at the trunk's origin
    bias: Array  # (4, 3) [N·m], h
    moment: Array  # (3,) [kg·m], first moment of all leg links

    def jacobians(self, points: Array) -> Array:
        """Jacobians (4, 3, 3) [m/rad] of points (4, 3) [m] fixed to the legs' last links."""
        across = points.dot(_PERMUTATION).reshape(4, 3, 3)  # -[r]x for each leg
        return np.asarray(self.at_origin + across @ self.axes)


@dataclass(frozen=True, eq=False)
class LegMotion:
    """Motion of the legs at one sample, and their inertia; trunk axes."""

    velocity: Array  # (4, 3) [m/s], of the feet's centres relative to a trunk whose origin is at rest: ω x p + J q̇
    # (4, 3) [m/s²], of the feet's centres minus gravity, without accelerations of joints and ω
    free_acceleration: Array
    inertia: Array  # (4, 3, 3) [kg·m²], M
    # (4, 6, 3), C: force [N] and moment [N·m] on the trunk, at its origin, per unit of joint acceleration
    coupling: Array


class LegDynamics:
    """Evaluates `LegState`s of one robot, once for each measurement, which parts of a controller share. Reuses buffers,
    so an instance must not be shared between threads.
    """

    _last: Measurement | None = None

    def __init__(self, robot: Robot) -> None:
        model = pinocchio_model(robot)
        model.gravity = pin.Motion.Zero()
        frames = []
        for leg in robot.legs:
            place = pin.SE3(np.eye(3), np.array(leg.foot_position))
            frame = pin.Frame(f"{leg.name} sole", model.getJointId(leg.joints[2]), place, pin.FrameType.OP_FRAME)
            frames.append(model.addFrame(frame))
        self.robot = robot
        self.columns = joint_columns(robot)
        trunk = robot.inertias[robot.trunk]
        self.leg_mass = robot.mass - trunk.mass
        self._trunk_moment, self._mass = np.array(trunk.first_moment), robot.mass
        self._model, self._data = model, model.createData()
        data = self._data
        self._frames = frames
        # views into Pinocchio's memory, overwritten by every evaluation
        self._feet = [data.oMf[frame].translation for frame in frames]
        self._motions, self._torque, self._com = data.J.T, data.tau, data.com[0]
        self._q, self._v, self._a = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
        self._q[6] = 1.0
        self._in_v = 6 + self.columns
        self._block = (self._in_v[:, :, None], self._in_v[:, None, :])
        self._coupling = (np.arange(6)[None, :, None], self._in_v[:, None, :])

    def at(self, position: Array, velocity: Array, angular_velocity: Array, specific_force: Array) -> LegState:
        """Computes the legs' state from positions and velocities (n,) [rad, rad/s] of the joints in the tree's order,
        and the trunk's angular velocity (3,) [rad/s] and specific force of its origin (3,) [m/s²], in its axes.
        """
        model, data = self._model, self._data
        self._q[7:] = position
        self._v[3:6], self._v[6:] = angular_velocity, velocity
        self._a[:3] = specific_force  # the trunk's own velocity is zero, so spatial and classical acceleration agree
        pin.rnea(model, data, self._q, self._v, self._a)
        pin.computeJointJacobians(model, data, self._q)
        pin.updateFramePlacements(model, data)
        pin.centerOfMass(model, data, False)
        motions = self._motions[self._in_v]  # (leg, joint, linear and angular velocity per unit of rate)
        return LegState(
            feet=np.array(self._feet),
            axes=motions[:, :, 3:].swapaxes(1, 2),
            at_origin=motions[:, :, :3].swapaxes(1, 2),
            bias=self._torque[self._in_v],
            moment=self._mass * self._com - self._trunk_moment,
        )

    def nominal_jacobians(self) -> Array:
        """Jacobians (4, 3, 3) [m/rad] of the feet's centres in the nominal stance."""
        still = np.zeros(len(self.robot.tree.joints))
        state = self.at(standing_configuration(self.robot), still, np.zeros(3), np.zeros(3))
        return state.jacobians(state.feet)

    def measured(self, m: Measurement) -> LegState:
        """The state at this measurement; its `feet` always come from forward kinematics."""
        if self._last is not m:
            self._state = self.at(m.joint_position, m.joint_velocity, m.angular_velocity, m.force_at_origin)
            self._last = m
        return self._state

    def motion(self) -> LegMotion:
        """Motion of the legs at the sample of the last call of `at`."""
        model, data = self._model, self._data
        pin.forwardKinematics(model, data, self._q, self._v, self._a)
        pin.crba(model, data, self._q)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        velocity = [pin.getFrameVelocity(model, data, frame, axes).linear for frame in self._frames]
        acceleration = [pin.getFrameClassicalAcceleration(model, data, frame, axes).linear for frame in self._frames]
        inertia = data.M
        return LegMotion(
            velocity=np.array(velocity),
            free_acceleration=np.array(acceleration),
            inertia=inertia[self._block],
            coupling=inertia[self._coupling],
        )


def cross(a: Array, b: Array) -> Array:
    """a x b, (3,) each, faster than numpy's for single vectors."""
    a, b = np.concatenate((a, a[:2])), np.concatenate((b, b[:2]))  # x y z x y
    return np.asarray(a[1:4] * b[2:] - a[2:] * b[1:4])


def joint_columns(robot: Robot) -> NDArray[np.int_]:
    """Index of each leg's joints, from the trunk outwards, in the tree's order, (4, 3)."""
    return np.array([[robot.tree.joints.index(joint) for joint in leg.joints] for leg in robot.legs])
