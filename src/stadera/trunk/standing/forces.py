"""Contact forces of a robot at rest from its joint torques, their covariance, and the vertical that they indicate.

With f the force of the ground on the foot and τ the actuator torques, the equations of a leg's joints are

    h = τ + Jᵀ f,      h = rigid-body torque at this motion + friction and offsets of the joints,      f = B (h - τ)

(J: Jacobian of the contact point for a held trunk, B = J^-T). A leg has three joints, so J is square and the paper's
pseudo-inverse is an inverse. All vectors are in the trunk frame: the trunk's own motion enters h only through its
angular velocity and specific force. Accelerations of the joints are neglected. The foot is a sphere: the contact is at
foot - radius * normal, with the normal of the plane through the feet in stance. An error δτ of the torque and an error
δp of the foot's position change the force by

    δf = -B δτ,      δf = -B G δp,   G's rows (f x a_j)ᵀ          as (∂(Jᵀf)_j / ∂p) δp = (a_j x δp) · f

and the moment about the trunk's origin, μ = Σ p x f, by p x δf, and by δp x f for the foot's own error.

**The vertical without an IMU** is the direction of the total force. At rest the specific force of the trunk is a = g u,
u the vertical, trunk axes. Joint j of a leg carries the links k beyond it, h_j = Σ m_k (s_j x (c_k - o_j)) · a, linear
in a: h = H a. So the feet's forces are affine in a, and so is their sum, which carries the robot's mass M:

    F(a) = F₀ + K a,    F₀ = -Σ B τ,    K = Σ B H;        F(a) = M a,    |a| = g

These are three equations for three unknowns, M and the two angles of u. They are solved by the iteration a ← g F(a) /
|F(a)|, which contracts by about |K| / M, the effect of the legs' own weight on the feet's forces across the vertical,
as a share of the weight. If feet do not slip and joints are at rest, three feet hold the trunk at rest as well, so a
gyro would add nothing. Only an IMU could detect a steady push or pull across the vertical, which tilts F, and an
accelerating ground, which changes its magnitude; both are attributed to weight here. Constant errors of torques have
the same effect, and are in the error bars (`stadera.trunk.standing.equilibrium`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import sqrt
from typing import Literal

import numpy as np

from stadera.body.friction import JointFriction
from stadera.body.instant import LegDynamics, LegMotion, LegState
from stadera.body.instant import inverse_transposed as inverse_at
from stadera.body.statics import LegModel, inverse_transposed
from stadera.constants import GRAVITY, NOTHING
from stadera.errors import ModelError, UnknownNameError
from stadera.inertia import skews
from stadera.logs.recording import Recording
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement, meant_stance, measurements_of
from stadera.types import Array, Bools

JacobianOf = Literal["feet", "encoders"]

CARRIES = 0.03
"""Least force along the normal on a foot in stance, as a share of the robot's weight."""


@dataclass(frozen=True, eq=False)
class ForceNoise:
    """Standard deviations of torques and feet. "Constant" errors do not average out over a run.

    Attributes:
        torque_white, torque_constant: (4, 3) [N·m], by leg and joint.
        foot_position: [m], of each component of a foot's position in the trunk frame, constant.
        leg_mass: relative error of the mass of a leg's link, constant.
        repeatable: residual of a pose at rest, as a share of the robot's weight, moments at 1 m. Assumed.

    Raises:
        ModelError: wrong shape, or a value that is negative or not finite.
    """

    torque_white: Array
    torque_constant: Array
    foot_position: float = 0.0
    leg_mass: float = 0.0
    repeatable: float = 1e-4

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = np.asarray(getattr(self, name), dtype=float)
            if not (np.isfinite(value).all() and (value >= 0).all()):
                raise ModelError(f"force noise {name!r} must be finite and not negative")
            if name.startswith("torque") and value.shape != (4, 3):
                raise ModelError(f"force noise {name!r} needs shape (4, 3), got {value.shape}")

    @classmethod
    def of(
        cls,
        robot: Robot,
        white: float = 0.0033,
        constant: float = 0.0033,
        foot_position: float = 0.0,
        leg_mass: float = 0.02,
        lever: float = 0.5,
    ) -> ForceNoise:
        """Torque noise as shares of the joints' effort limits.

        Static friction of a joint at rest lies anywhere within its Coulomb friction ± τ_c: τ_c / √3 is added to the
        constant part. A joint without effort limit is treated as one made to carry half the robot's weight at
        `lever` [m].
        """
        joints = [list(leg.joints) for leg in robot.legs]
        limit = np.array([[robot.limits[joint].effort for joint in leg] for leg in joints])
        limit = np.where(np.isfinite(limit), limit, 0.5 * robot.mass * GRAVITY * lever)
        coulomb = np.array([[robot.dynamics[joint].coulomb for joint in leg] for leg in joints])
        return cls(white * limit, np.hypot(constant * limit, coulomb / np.sqrt(3.0)), foot_position, leg_mass)


class MeasuredLegs:
    """Caches the state of the legs for the latest measurement, so that controller and estimators share the computation.

    The first moment of the legs includes what joints outside the legs have moved since the robot's reference: at rest
    it enters the balance in the same way, and the trunk's parameters stay those at the reference.

    Attributes:
        robot: the model of the legs.
        columns: (4, 3), index of each leg's joints in the tree's order.
        mass: [kg], of all leg links.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._dynamics, self._extra = LegDynamics(robot), robot.extra
        self.columns = self._dynamics.columns
        self.mass = self._dynamics.leg_mass
        self._last: Measurement | None = None
        self._state: LegState | None = None
        self._motion: LegMotion | None = None

    def at(self, measurement: Measurement) -> LegState:
        """The state at this measurement; its `feet` always come from forward kinematics."""
        if self._state is None or measurement is not self._last:
            m = measurement
            self._state = self._dynamics.at(m.joint_position, m.joint_velocity, m.angular_velocity, m.force_at_origin)
            if m.extra.size and self._extra is not None:
                moved = self._extra.first_moment(m.extra[: len(self._extra.joints)])
                self._state = replace(self._state, moment=self._state.moment + moved)
            self._last, self._motion = m, None
        return self._state

    def motion_at(self, measurement: Measurement) -> LegMotion:
        """Motion of the legs at this measurement, evaluated on demand."""
        self.at(measurement)
        if self._motion is None:
            self._motion = self._dynamics.motion()
        return self._motion


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Forces of the ground on the feet, trunk frame and axes; legs in the robot's order.

    Attributes:
        force: (4, 3) [N]; NaN for a near-singular leg, for which a direction of the force is not determined.
        contact: (4, 3) [m], contact points, on the foot's sphere towards the ground.
        stance: (4,) bool, the loaded feet.
        normal: (3,), unit normal of the ground through the feet in stance.
        jacobian: (4, 3, 3) [m/rad], J of the contacts.
        by_torque: (4, 3, 3) [1/m], J^-T; NaN for a near-singular leg.
        axes: (4, 3, 3), the joints' axes as columns.
        noise: of torques and feet, from which the covariances are computed.
        feet_move_forces: True if the Jacobians are at the measured feet, so that errors of the feet change the forces.
    """

    force: Array
    contact: Array
    stance: Bools
    normal: Array
    jacobian: Array
    by_torque: Array
    axes: Array
    noise: ForceNoise
    feet_move_forces: bool = True

    @cached_property
    def total_force(self) -> Array:
        """Total force on the feet in stance, (3,) [N]."""
        return np.asarray(np.where(self.stance[..., None], self.force, 0.0).sum(axis=-2))

    @cached_property
    def moment(self) -> Array:
        """Moment of the forces on the feet in stance about the trunk's origin, (3,) [N·m]."""
        force = np.where(self.stance[..., None], self.force, 0.0)
        return np.asarray((skews(self.contact) @ force[..., None])[..., 0].sum(axis=-2))

    @property
    def wrench(self) -> Array:
        """(6,): `total_force` and `moment`."""
        return np.concatenate([self.total_force, self.moment], axis=-1)

    def vertical(self, up: Array) -> Array:
        """Each foot's force along the vertical (3,), zero off the ground, (4,) [N]."""
        return np.where(self.stance, np.nan_to_num(self.force) @ up, 0.0)

    @cached_property
    def torque_to_force(self) -> Array:
        """Derivative of each foot's force with respect to its leg's torques, (4, 3, 3) [1/m], -J^-T; zero for a
        near-singular leg.
        """
        return -np.nan_to_num(self.by_torque)

    @cached_property
    def wrench_slope(self) -> Array:
        """Derivative (6, 24) of `wrench` with respect to the legs' torques [N·m], then the feet's positions [m], leg by
        leg.
        """
        held, by_torque = np.nan_to_num(self.force), self.torque_to_force
        by_foot = np.zeros_like(self.jacobian)
        if self.feet_move_forces:
            by_foot = by_torque @ np.cross(held[:, None, :], self.axes.swapaxes(-1, -2))  # -B G
        arms = skews(self.contact)
        torque = np.concatenate([by_torque, arms @ by_torque], axis=1)
        foot = np.concatenate([by_foot, arms @ by_foot - skews(held)], axis=1)
        slopes = np.concatenate([torque, foot]) * np.tile(self.stance, 2)[:, None, None]
        return np.asarray(slopes.transpose(1, 0, 2).reshape(6, 24))

    @property
    def white_covariance(self) -> Array:
        """Covariance (6, 6) of `wrench` due to the torques' white noise."""
        scaled = self.wrench_slope[:, :12] * self.noise.torque_white.ravel()
        return np.asarray(scaled @ scaled.T)


class ContactForceEstimator:
    """Computes the contact forces of successive measurements, neglecting accelerations of the joints.

    Args:
        robot: the model of the legs.
        noise: of torques and feet; None for the default shares of the effort limits.
        legs: shared with other users of the same measurements; None for a new one.
        jacobian: at the "feet" as measured or by the "encoders"; the two differ only if the measurement contains foot
            positions.

    Raises:
        UnknownNameError: another kind of Jacobian.
    """

    def __init__(
        self,
        robot: Robot,
        noise: ForceNoise | None = None,
        legs: MeasuredLegs | None = None,
        jacobian: JacobianOf = "feet",
    ) -> None:
        if jacobian not in ("feet", "encoders"):
            raise UnknownNameError("Jacobian of the contacts", jacobian, ("feet", "encoders"))
        self.robot, self.legs = robot, legs or MeasuredLegs(robot)
        self.noise = noise or ForceNoise.of(robot)
        self.jacobian = jacobian
        self._radii = np.array([[leg.foot_radius] for leg in robot.legs])
        self._least = CARRIES * robot.mass * GRAVITY
        self._friction, self._least_volume = JointFriction.of(robot), LegModel.of(robot).least_volume
        self._everyone = np.ones(4, dtype=bool)

    def at(self, measurement: Measurement) -> ContactForces:
        """The contact forces at a measurement, trunk axes."""
        m, state, columns = measurement, self.legs.at(measurement), self.legs.columns
        torque = state.bias + self._friction.torque(m.joint_velocity[columns]) - m.effort[columns]
        feet = state.feet if m.foot_position is None else m.foot_position
        stance = self._everyone if m.stance is None else m.stance
        moves = self.jacobian == "feet"

        def solved(stance: Bools) -> ContactForces:
            normal = ground_normal(feet, stance, m.up)
            below = self._radii * normal
            contact = feet - below
            jacobian = state.jacobians(contact if moves else state.feet - below)
            by_torque = inverse_at(jacobian, self._least_volume)
            force = np.matvec(by_torque, torque)
            return ContactForces(force, contact, stance, normal, jacobian, by_torque, state.axes, self.noise, moves)

        forces = solved(stance)
        loaded = stance & (forces.force @ forces.normal > self._least)
        return forces if loaded.tolist() == stance.tolist() else solved(loaded)


def ground_normal(feet: Array, stance: Bools, up: Array) -> Array:
    """Unit normal (..., 3) of the plane through the feet in stance, on the side of `up` (..., 3).

    Computed from the diagonals of the quadrilateral LF, RF, RH, LH, which gives the best plane's normal if the four
    feet are not in one plane. A foot that is not in stance is replaced by its neighbour, which leaves the triangle of
    the others. With fewer than three feet the normal is `up`.

    Args:
        feet: (..., 4, 3) [m], in the order LF, RF, LH, RH; stance: (..., 4).
    """
    points = feet
    if not stance.all():
        points = np.where(stance[..., None], feet, feet[..., [1, 0, 3, 2], :])
    elif feet.ndim == 2:
        return _normal_of_four(feet, up)
    normal = np.cross(points[..., 1, :] - points[..., 2, :], points[..., 0, :] - points[..., 3, :])
    normal *= np.where((normal * up).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    usable = (stance.sum(axis=-1, keepdims=True) >= 3) & (size > 0)
    return np.where(usable, normal / np.where(usable, size, 1.0), up)


def _normal_of_four(feet: Array, up: Array) -> Array:
    """`ground_normal` for one sample with four feet in stance, without array overhead, for a controller's loop."""
    lf, rf, lh, rh = feet.tolist()
    ax, ay, az = rf[0] - lh[0], rf[1] - lh[1], rf[2] - lh[2]
    bx, by, bz = lf[0] - rh[0], lf[1] - rh[1], lf[2] - rh[2]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = sqrt(x * x + y * y + z * z)
    if size == 0.0:
        return up
    ux, uy, uz = up.tolist()
    size = size if x * ux + y * uy + z * uz >= 0.0 else -size
    return np.array([x / size, y / size, z / size])


# -- the vertical without an IMU ------------------------------------------------------------------------------------


def vertical_by_forces(
    robot: Robot, position: Array, velocity: Array, effort: Array, stance: Bools | None = None
) -> tuple[Array, Array]:
    """The vertical indicated by the feet's forces, and the mass that they carry, for samples at rest.

    Args:
        robot: the model of the legs.
        position, velocity: (samples, n) [rad, rad/s], joints in the tree's order; velocities are used for friction
            only.
        effort: (samples, n) [N·m].
        stance: (samples, 4), legs that may be loaded; None for all.

    Returns:
        Unit vectors (samples, 3), trunk axes, and the robot's mass (samples,) [kg]. Both are meaningless for a robot
        that is not on its feet.
    """
    model = LegModel.of(robot)
    columns = model.columns
    torque = effort[:, columns] - model.friction.torque(velocity[:, columns])
    pose = model.pose(position[:, columns])
    bears, feet = model.weight_torques(pose), pose.feet.transpose(1, 2, 0)
    away = -feet.mean(axis=1)
    away /= np.linalg.norm(away, axis=1, keepdims=True)

    def solved(carrying: Bools) -> tuple[Array, Array, Array]:
        """Vertical, sum of the forces, and each foot's force along the ground's normal."""
        normal = ground_normal(feet, carrying, away)
        by_torque, volume = inverse_transposed(pose.jacobians(model.contacts(pose.feet, normal.T)))
        felt = carrying & (np.abs(volume) >= model.least_volume)
        by_torque = np.where(felt[..., None], by_torque, 0.0)
        fixed = -(by_torque * torque).sum(axis=-1).transpose(1, 2, 0)
        slope = np.einsum("inlk,jnlk->nlij", by_torque, bears)
        up, total = _balanced(fixed.sum(axis=1), slope.sum(axis=1), normal)
        force = fixed + GRAVITY * (slope @ up[:, None, :, None])[..., 0]
        return up, total, (force @ normal[:, :, None])[..., 0]

    meant = np.ones((len(position), 4), dtype=bool) if stance is None else stance
    up, total, load = solved(meant)
    carrying = meant & (load > CARRIES * robot.mass * GRAVITY)
    if not np.array_equal(carrying, meant):
        up, total, _ = solved(carrying)
    return up, np.linalg.norm(total, axis=1) / GRAVITY


def _balanced(fixed: Array, slope: Array, start: Array, iterations: int = 60) -> tuple[Array, Array]:
    """u (samples, 3) such that F₀ + g K u is along u, and that force, from F₀ (samples, 3) and K (samples, 3, 3)."""
    up, force = start, fixed
    for _ in range(iterations):
        force = fixed + GRAVITY * np.matvec(slope, up)
        size = np.linalg.norm(force, axis=1, keepdims=True)
        before, up = up, np.where(size > 0, force / np.where(size > 0, size, 1.0), up)
        if float(np.abs(up - before).max(initial=0.0)) < NOTHING:
            break
    return up, force


def measurements_without_imu(recording: Recording, robot: Robot, at_once: int = 4096) -> Iterator[Measurement]:
    """Yields a log's samples as if at rest, with the vertical from the feet's forces, computed for `at_once` samples at
    a time. The caller must check for rest.

    Raises:
        RecordingError: the log lacks a joint's velocity or effort.
        UnknownNameError: a joint of the robot is not recorded.
    """
    q, qd, effort = (recording.channel(name, robot.tree.joints) for name in ("position", "velocity", "effort"))
    stance = meant_stance(recording, robot)
    parts = [slice(start, start + at_once) for start in range(0, len(recording), at_once)]
    ups = [
        vertical_by_forces(robot, q[part], qd[part], effort[part], None if stance is None else stance[part])[0]
        for part in parts
    ]
    return measurements_of(recording, robot, vertical=np.concatenate(ups))
