"""The trunk controller of the paper ([13], section III.B): virtual springs, gravity compensation, contact forces.

All quantities are in the odometry frame (world axes, `LegOdometry`). With c the modelled centre of
mass of the whole robot in trunk axes, m its modelled mass, b, R the trunk's pose and b_d, R_d the reference, the
demanded wrench is

    F = K (b_d + R_d c - b - R c) + D (velocity error of that point) + m g e_z
    Γ = R [K_a log(Rᵀ R_d) + D_a (angular velocity error)]           about the modelled centre of mass

so the spring acts on the modelled centre of mass, and a change of the model does not cause motion. F and Γ are
distributed over the feet (`stadera.lab.control.distribution`), and the legs' torques are τ = h - J_cᵀ f. With a
wrong model the springs give way until they balance the true weight (eq. 12): see `stadera.lab.laws.orientation`.

A gait relieves a leg of its load, lets it swing along a trajectory, and lands it at touch-down. Swinging legs follow
inverse dynamics (`stadera.lab.control.swing`), and F, Γ include the reaction of their acceleration.

Leg odometry: position and velocity of the trunk from the legs in stance.

The base's position is not measured. Feet in stance do not move, so with R from the IMU and p_i from the legs::

    b = mean over stance of (anchor_i - R p_i)
    velocity of a point c of the trunk = -R mean over stance of (J_i q̇_i + ω x (r_i - c))

in the odometry frame: the world's axes, with the trunk's origin at the first update as origin. p_i is a foot's
centre, and a foot is anchored at its position when it enters stance; r_i is the contact point and J_i its Jacobian,
since that point is at rest while a foot rolls. A foot of radius ρ that rotates by θ on ground with normal n rolls:
its centre moves by θ x ρ n, and its anchor with it. Feet that do not slip keep their distances: the residual
anchor_i - R p_i - b identifies one that does.

The legs' velocity is unreliable at touch-down, and unavailable in the air. With the specific force a of the IMU, the
velocity is that of a complementary filter with time constant T::

    v̇ = R a + g + (v_legs - v) / T
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, isfinite, isnan, sqrt
from typing import ClassVar

import numpy as np

from stadera.constants import GRAVITY, NOTHING
from stadera.inertia import InertialParameters, skew
from stadera.lab.control.distribution import ForceDistribution, LoadRamp
from stadera.lab.control.legs import LegDynamics, LegState, cross
from stadera.lab.control.reference import ControlError, Follower, Move, TrunkPose
from stadera.lab.control.swing import SwingLegs, SwingTrajectory
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Robot
from stadera.robot.stance import nominal_feet, standing_configuration
from stadera.trunk.ground import ground_normal
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkBounds, TrunkModel
from stadera.types import Array, Bools

_NOBODY = np.zeros(4, dtype=bool)


class LegOdometry:
    """Position and velocity of the trunk from the feet in stance.

    `velocity_time` is T [s], 0 for the legs alone; a foot that deviates from the others by more than `slip` [m] has
    slipped.

    Attributes:
        position: (3,) [m], of the trunk's origin in the odometry frame.
        anchors: (4, 3) [m], positions of the feet in stance, and last positions of those in the air.
        anchored: (4,) bool, feet that have been in stance.
    """

    def __init__(self, velocity_time: float = 0.0, slip: float = 0.02) -> None:
        self._velocity_time, self._velocity, self._slip2 = velocity_time, np.zeros(3), slip**2
        self.position = np.zeros(3)
        self.anchors = np.zeros((4, 3))
        self.anchored = np.zeros(4, dtype=bool)
        self._stance = self._given = _NOBODY
        self._weights, self._standing, self._rolls = np.zeros(4), False, np.zeros((4, 3))

    def locate(self, levers: Array, stance: Bools, rolled: Array | None = None) -> None:
        """Updates the position; without a foot in stance it does not change.

        Levers R p_i (4, 3) [m] are the feet from the trunk's origin, `rolled` (4, 3) [m] is θ x ρ n since the last
        call, None for feet that do not roll, both in world axes. `stance` (4,) must not be modified in place between
        calls.
        """
        if rolled is not None and self._standing:
            self.anchors += rolled * self._rolls
        if stance is not self._given:
            self._change_stance(levers, stance)
        left = self.anchors - levers
        if self._standing:
            self.position = self._weights.dot(left)
        left -= self.position
        everywhere = left.ravel()
        if everywhere.dot(everywhere) > self._slip2:
            slipped = self._stance & ((left * left).sum(axis=1) > self._slip2)
            self.anchors[slipped] -= left[slipped]

    def velocity(self, arms: Array, joint_part: Array, angular_velocity: Array) -> Array:
        """Velocity (3,) [m/s] of a point of the trunk by the feet in stance at the last `locate`, from arms r_i - c (4,
        3) [m], J_i q̇_i (4, 3) [m/s] and angular velocity [rad/s], all in TRUNK axes.
        """
        x, y, z = self._weights.dot(arms).tolist()
        u, v, w = self._weights.dot(joint_part).tolist()
        wx, wy, wz = angular_velocity.tolist()
        return np.array([wz * y - wy * z - u, wx * z - wz * x - v, wy * x - wx * y - w])

    def fused(self, by_legs: Array, acceleration: Array, dt: float) -> Array:
        """Velocity (3,) [m/s] of the trunk's origin by legs (ignored if no foot is in stance) and IMU, world axes, from
        the acceleration R a + g (3,) [m/s²] and the time since the last call [s].
        """
        if self._velocity_time == 0.0:
            return by_legs
        ahead = self._velocity + dt * acceleration
        if self._standing:
            ahead += dt / (self._velocity_time + dt) * (by_legs - ahead)
        self._velocity = ahead
        return ahead

    def _change_stance(self, levers: Array, stance: Bools) -> None:
        new = stance & ~self._stance
        self.anchors[new] = self.position + levers[new]
        self._given, self._stance = stance, stance.copy()
        self._rolls = np.repeat(stance, 3).reshape(4, 3).astype(float)
        self.anchored = self.anchored | stance
        self._standing = bool(stance.any())
        self._weights = stance / max(int(stance.sum()), 1)


_UP = np.array([0.0, 0.0, 1.0])
_GRAVITY = GRAVITY * _UP


@dataclass(frozen=True, eq=False)
class TrunkGains:
    """Springs and dampers of the trunk controller."""

    # natural frequencies ω of the centre of mass, and of roll, pitch and yaw [rad/s], and damping ratio ζ
    linear: ClassVar[float] = 12.0
    angular: ClassVar[float] = 16.0
    ratio: ClassVar[float] = 0.8

    stiffness: float  # [N/m]
    damping: float  # [N·s/m], on the centre of mass, equal in all directions
    angular_stiffness: Array  # (3,) [N·m/rad]
    # (3,) [N·m·s/rad], about the trunk's axes. Not multiplied by an inertia again: the paper writes I K_p for the
    # torsional stiffness (eq. 12), which is the product given here.
    angular_damping: Array

    @classmethod
    def of(cls, robot: Robot) -> TrunkGains:
        """K = m ω², D = 2 ζ ω m, and the same with the moments of inertia, of the whole robot in its nominal stance."""
        linear, angular, damping = cls.linear, cls.angular, cls.ratio
        whole = composite(robot, standing_configuration(robot))
        moments = np.diag(whole.inertia_com)
        return cls(
            stiffness=whole.mass * linear**2,
            damping=2.0 * damping * linear * whole.mass,
            angular_stiffness=moments * angular**2,
            angular_damping=2.0 * damping * angular * moments,
        )


def composite(robot: Robot, joint_position: Array) -> InertialParameters:
    """The whole robot as one rigid body, in the trunk frame, at joint positions (n,) [rad]."""
    rotations, translations = forward_kinematics(robot.tree, joint_position[None])
    total = InertialParameters.zero()
    for i, link in enumerate(robot.tree.links):
        total = total + robot.inertias[link].transformed(rotations[0, i], translations[0, i])
    return total


class SmoothTrunk:
    """The controller's trunk model, checked for plausibility and low-pass filtered with T [s].

    A new model is a target. Mass m and first moment h = m c approach it by ṁ = (m* - m) / T, ḣ = (h* - h) / T. Torques
    are continuous in both, so a step of the model changes them by at most the share dt / T of its full effect in one
    control period. The centre of mass h / m is a mean of past and new ones weighted by mass, so it stays in any box
    that contains them all.

    Attributes:
        mass, moment: [kg], (3,) [kg·m], in use now.
        target_mass, target_moment: those of the last accepted model, without filtering: for planning ahead.
    """

    def __init__(self, start: TrunkModel, bounds: TrunkBounds, time_constant: float = 0.05) -> None:
        bounds.check(start)
        self.bounds, self.time_constant = bounds, time_constant
        self.mass, self.moment = start.mass, start.mass * start.com_trunk
        self.target_mass, self.target_moment = self.mass, self.moment
        self._settled = True

    @property
    def model(self) -> TrunkModel:
        return TrunkModel(self.mass, self.moment / self.mass)

    def accept(self, model: TrunkModel) -> bool:
        """Makes a model the target if it is plausible, else keeps the last one; returns whether it was plausible."""
        if self.bounds.complaint(model):
            return False
        self.target_mass, self.target_moment = model.mass, model.mass * model.com_trunk
        self._settled = False
        return True

    def advance(self, dt: float) -> None:
        """Advances the filter by dt [s]."""
        if self._settled:
            return
        share = dt / (self.time_constant + dt)
        self.mass += share * (self.target_mass - self.mass)
        left = self.target_moment - self.moment
        self.moment = self.moment + share * left
        self._settled = abs(self.target_mass - self.mass) + float(np.abs(left).max()) < NOTHING


class TrunkController(Follower):
    """Holds the trunk on its legs. Uses measurements only; one `update` per control period.

    Args:
        trunk: initial model; None for the robot's own.
        by_encoders: whether the torques use the Jacobian at the feet by the encoders; else at those measured, which
            differ only if the measurement contains foot positions.
        velocity_time: time constant [s] with which the trunk's velocity from the IMU follows that from the legs; 0 for
            the legs alone.
        moment_length: L [m], which weights errors of moments relative to those of forces if the feet cannot produce
            both; None for half the diagonal between the feet.

    Attributes:
        trunk: see `SmoothTrunk`.
        stance: (4,) bool, legs meant to be in stance; assign a new array to change it immediately, or use `relieve`,
            `swing` and `land`.
        forces: (4, 3) [N], demanded at the last update, odometry frame.
        saturated: (n,) bool, joints whose torque was limited at the last update.
        time: [s], of the last update, and at it, in the odometry frame,
        rotation: (3, 3), of the trunk,
        velocity: (3,) [m/s], of the trunk's origin,
        com: (3,) [m], the modelled centre of mass of the whole robot,
        feet: (4, 3) [m], the feet's centres, and
        normal: (3,) of the ground, the plane through the present or last footholds.
        swinging: the legs in the air: trajectories, contact forces, touch-down.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        trunk: TrunkModel | None = None,
        by_encoders: bool = False,
        velocity_time: float = 0.0,
        moment_length: float | None = None,
    ) -> None:
        self._by_encoders = by_encoders
        self.robot, self.legs = robot, LegDynamics(robot)
        self.gains = TrunkGains.of(robot)
        self.trunk = SmoothTrunk(trunk or TrunkModel.prior(robot), TrunkBounds.of(robot))
        self.odometry = LegOdometry(velocity_time)
        self.stance: Bools = np.ones(4, dtype=bool)
        self.forces = np.zeros((4, 3))
        self.saturated = np.zeros(len(robot.tree.joints), dtype=bool)
        self.rotation, self.velocity = np.eye(3), np.zeros(3)
        self.com, self.feet, self.normal = np.zeros(3), np.zeros((4, 3)), _UP
        self.swinging = SwingLegs(self.legs)
        feet = nominal_feet(robot)
        least = 0.02 * robot.mass * GRAVITY  # share of the weight on every foot in stance
        self._radii = np.array([[leg.foot_radius] * 3 for leg in robot.legs])
        self._effort = np.array([robot.limits[joint].effort for joint in robot.tree.joints])
        self._offset = np.array([robot.dynamics[joint].offset for joint in robot.tree.joints])
        self._tree_order = np.argsort(self.legs.columns.ravel())
        length = moment_length or 0.5 * float(np.linalg.norm(feet[0] - feet[3]))
        self._sharing, self._most = ForceDistribution(least, length), np.full(4, np.inf)
        self._ramps: list[LoadRamp | None] = [None] * 4  # limits of the feet's loads; None for none
        here = TrunkPose(np.zeros(3), np.eye(3))
        self._reference = Move(here, here, 0.0, 1.0)
        self._below, self._ground_stance = np.zeros((4, 3)), np.zeros(4, dtype=bool)
        self._across = skew(_UP)
        self._position = np.zeros(len(robot.tree.joints))

    # -- asked for ------------------------------------------------------------------------------------------------
    def update_trunk(self, trunk: TrunkModel) -> bool:
        """Sets a new model of the trunk, adopted smoothly; False, and the old one is kept, if it is not plausible."""
        return self.trunk.accept(trunk)

    @property
    def position(self) -> Array:
        """(3,) [m], of the trunk's origin at the last update, odometry frame."""
        return self.odometry.position

    def relieve(self, leg: int, duration: float) -> None:
        """Unloads a leg within a duration [s]; it then stays in stance without load."""
        now = max(float(self.forces[leg] @ self.normal), 0.0)
        self._ramps[leg] = LoadRamp(self.time, duration, now, 0.0, remains=True)

    @property
    def relieved(self) -> Bools:
        """Legs without load, in stance or in the air, (4,) bool."""
        return np.array([not stands or most <= 0.0 for stands, most in zip(self.stance, self._limits(), strict=True)])

    def swing(self, leg: int, trajectory: SwingTrajectory) -> None:
        """Takes a leg out of stance and along a trajectory; a leg that already swings gets a new trajectory."""
        self._require_update("a trajectory is in the odometry frame, which begins with it")
        self.swinging.begin(leg, trajectory)
        if self.stance[leg]:
            self.stance = self.stance & (np.arange(4) != leg)

    def land(self, leg: int, duration: float) -> None:
        """Puts a leg into stance where it is; its load limit grows to the robot's weight within a duration [s]."""
        weight, first = self._sharing.normal_force(), 0.05  # share that the foot may carry immediately
        self.swinging.end(leg)
        self._ramps[leg] = LoadRamp(self.time, duration, first * weight, weight, remains=False)
        self.stance = self.stance | (np.arange(4) == leg)

    # -- each period ----------------------------------------------------------------------------------------------
    def update(self, measurement: Measurement) -> Array:
        """Joint torques (n,) [N·m] for one measurement; the first update uses the trunk's pose as reference."""
        m, rotation = measurement, measurement.rotation
        if rotation is None:
            raise ControlError("the trunk controller needs the trunk's orientation")
        state, columns = self.legs.measured(m), self.legs.columns
        feet = state.feet if m.foot_position is None else m.foot_position
        levers = feet.dot(rotation.T)
        dt = self._advance(m, levers, rotation, state)
        contacts = (levers - self._below).dot(rotation)
        jacobians = state.jacobians(state.feet - self._below.dot(rotation) if self._by_encoders else contacts)
        moving = np.matvec(jacobians, m.joint_velocity[columns])
        mass = self.trunk.mass + self.legs.leg_mass
        com = (self.trunk.moment + state.moment) / mass
        arms = contacts - com
        self.com = self.odometry.position + rotation.dot(com)
        by_legs = rotation.dot(self.odometry.velocity(contacts, moving, m.angular_velocity))
        self.velocity = self.odometry.fused(by_legs, rotation.dot(m.force_at_origin) - _GRAVITY, dt)
        force, moment = self._springs(com, mass, m.angular_velocity)
        force[2] += mass * GRAVITY
        torque = state.bias
        if self.swinging.legs:
            trunk = (self.odometry.position, self.velocity, rotation)
            air, wrench = self.swinging.update(m, state, self.legs.motion(), trunk, self.normal, dt)
            torque = np.where(self.stance[:, None], torque, air)
            force += rotation.dot(wrench[:3])
            moment += rotation.dot(wrench[3:] - cross(com, wrench[:3]))
        demanded = force + moment
        if not isfinite(demanded.dot(demanded)):
            raise ControlError(f"no torques at {self.time:.6f} s: a value that was measured is not finite")
        self.forces = self._sharing.solve(arms.dot(rotation.T), force, moment)
        against = np.vecmat(self.forces.dot(rotation), jacobians)
        wanted: Array = (torque - against).ravel()[self._tree_order] + self._offset
        if not isfinite(wanted.dot(wanted)):
            raise ControlError(f"no torques at {self.time:.6f} s: a value measured is not finite, or a leg is singular")
        self.saturated = np.abs(wanted) > self._effort
        return np.clip(wanted, -self._effort, self._effort) if True in self.saturated.tolist() else wanted

    def _advance(self, m: Measurement, levers: Array, rotation: Array, state: LegState) -> float:
        """Updates time, model, pose and ground, from R p_i (4, 3) [m]; returns the time since the last update [s]."""
        time, dt = m.time, m.time - self.time
        started = not isnan(self.time)
        if started and not dt > 0:
            raise ControlError(f"the controller's time must increase, got {time} s after {self.time} s")
        rolled = self._rolled(m.joint_position, rotation, state) if started else None
        self.odometry.locate(levers, self.stance, rolled)
        self.feet = levers + self.odometry.position
        if started:
            self.trunk.advance(dt)
        else:
            here = TrunkPose(self.odometry.position, rotation)
            self._reference, dt = Move(here, here, time - 1.0, 1.0), 0.0
        self.time, self.rotation, self._position = time, rotation, m.joint_position
        if self.stance is not self._ground_stance:
            self.normal = ground_normal(self.odometry.anchors, self.odometry.anchored, _UP)
            self._ground_stance, self._below = self.stance, self._radii * self.normal
            self._across = skew(self.normal)  # turn x normal = turn @ this
            self._sharing.set_ground(self.normal)
        most = np.where(self.stance, self._limits(), 0.0)
        if (most != self._most).any():
            self._most = most
            self._sharing.set_most(most)
        return dt

    def _limits(self) -> list[float]:
        return [np.inf if ramp is None else ramp.at(self.time) for ramp in self._ramps]

    def _rolled(self, joint_position: Array, rotation: Array, state: LegState) -> Array:
        """Displacements θ x ρ n (4, 3) [m] of rolling feet since the last update, world axes; θ of the last links."""
        r = rotation.dot(self.rotation.T).tolist()  # small rotation of the trunk
        trunk = np.array([0.5 * (r[2][1] - r[1][2]), 0.5 * (r[0][2] - r[2][0]), 0.5 * (r[1][0] - r[0][1])])
        joints = (joint_position - self._position)[self.legs.columns]
        turn = np.matvec(state.axes, joints).dot(rotation.T) + trunk
        return np.asarray(turn.dot(self._across) * self._radii)

    def _springs(self, com: Array, mass: float, omega: Array) -> tuple[Array, Array]:
        """Force and moment [N, N·m] of springs and dampers, odometry frame; com and ω in trunk axes."""
        gains, goal, rotation = self.gains, self._reference.at(self.time), self.rotation
        to_goal = rotation.T.dot(goal.rotation)
        far = goal.position - self.odometry.position + (goal.rotation - rotation).dot(com)
        slow = -self.velocity - rotation.dot(cross(omega, com))
        pull = gains.stiffness * far
        if not goal.at_rest:
            slow += goal.velocity + goal.rotation.dot(cross(goal.angular_velocity, com))
            omega = omega - to_goal.dot(goal.angular_velocity)
            pull += mass * goal.acceleration
        moment = gains.angular_stiffness * _log(to_goal) - gains.angular_damping * omega
        return pull + gains.damping * slow, rotation.dot(moment)


def _log(rotation: Array) -> Array:
    """Rotation vector (3,) of a rotation matrix of less than half a turn."""
    r = rotation.tolist()
    x, y, z = r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]
    sine = 0.5 * sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (r[0][0] + r[1][1] + r[2][2] - 1.0)
    scale = 0.5 if sine < 1e-9 else 0.5 * atan2(sine, cosine) / sine
    return np.array([scale * x, scale * y, scale * z])
