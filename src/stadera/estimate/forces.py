"""Contact forces from joint torques: f = -J_c^-T (Sᵀτ - h), leg by leg.

With f what the ground does to the foot and τ what the actuators do to the joints, the equations of a leg's joints are

    h = τ + J_cᵀ f,      h = rigid-body torque at this motion + friction and offsets of the joints

(J_c: Jacobian of the contact point for a held trunk), so f = J_c^-T (h - τ). A leg has three joints, so J_c is square
and the paper's pseudo-inverse an inverse. Everything is in the trunk frame: the trunk's own motion enters h by its
angular velocity and specific force alone.

The foot is a sphere: the contact is at foot - radius * normal, with the normal of the plane through the feet that
carry.
"""

from __future__ import annotations

from math import nan, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError, UnknownNameError
from stadera.estimate.contact import ContactForces, ground_normal
from stadera.estimate.legs import MeasuredLegs
from stadera.estimate.measurement import Measurement
from stadera.estimate.noise import ForceNoise
from stadera.inertia import ORDER
from stadera.regressors.friction import FRICTION_TERMS, FrictionModel
from stadera.regressors.joint_torques import JointTorqueRegressor
from stadera.regressors.motion import JointMotion, TrunkMotion
from stadera.robot.kinematics import foot_positions, joint_axes, point_jacobians
from stadera.robot.model import Robot

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
JacobianOf = Literal["feet", "encoders"]

CARRIES = 0.03
"""Share of the robot's weight that a foot in stance has along the normal."""

_LEAST_VOLUME = 0.01  # of det J_c, as a share of the cubed length of the leg: below it a direction is not felt
_GRAVITY = 9.81  # m/s²
_STICTION_VELOCITY = 0.1  # rad/s, over which friction's sign is smoothed, well above the noise of a joint's velocity


class ContactForceEstimator:
    """Contact forces of one measurement after the other, accelerations of the joints left out.

    Args:
        robot: whose legs are believed in.
        noise: of torques and feet; None for the default shares of the effort limits.
        legs: shared with others that look at the same measurements; None for its own.
        jacobian: of the feet where the measurement says they are, or where the encoders say; the same unless the
            measurement brings positions of its own.

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
        self._radii = _radii(robot)
        self._least = CARRIES * robot.mass * _GRAVITY
        self._flat = least_determinant(robot)
        joints = [robot.dynamics[joint] for joint in robot.tree.joints]
        self._viscous = np.array([d.viscous for d in joints])
        self._coulomb = np.array([d.coulomb for d in joints])
        self._offset = np.array([d.offset for d in joints])
        self._has_coulomb = bool(self._coulomb.any())
        self._everyone = np.ones(4, dtype=bool)

    def at(self, measurement: Measurement) -> ContactForces:
        """The contact forces at a measurement, trunk axes."""
        state, columns = self.legs.at(measurement), self.legs.columns
        velocity = measurement.joint_velocity
        joint_side = self._viscous * velocity + self._offset - measurement.effort
        if self._has_coulomb:
            joint_side += self._coulomb * np.tanh(velocity / _STICTION_VELOCITY)
        torque = state.bias + joint_side[columns]
        feet = state.feet if measurement.foot_position is None else measurement.foot_position
        stance = self._everyone if measurement.stance is None else measurement.stance

        def solved(stance: Bools) -> tuple[Array, Array, Array, Array]:
            normal = _normal(feet, stance, measurement)
            below = self._radii * normal
            contact = feet - below
            jacobian = state.jacobians(contact if self.jacobian == "feet" else state.feet - below)
            return normal, contact, jacobian, _solved_each(jacobian, torque, self._flat)

        normal, contact, jacobian, force = solved(stance)
        loaded = stance & (force @ normal > self._least)
        if loaded.tolist() != stance.tolist():
            normal, contact, jacobian, force = solved(loaded)
        moves = self.jacobian == "feet"
        return ContactForces(force, contact, loaded, normal, jacobian, state.axes, self.noise, moves)


def contact_forces(
    robot: Robot,
    joints: JointMotion,
    effort: Array,
    trunk: TrunkMotion,
    *,
    stance: Bools | None = None,
    feet: Array | None = None,
    noise: ForceNoise | None = None,
) -> ContactForces:
    """Contact forces of a whole log at once, accelerations of joints and trunk included.

    Args:
        joints: motion of all joints in the tree's order, (samples, n).
        effort: (samples, n) [N·m].
        trunk: its motion, in trunk axes at the trunk's origin.
        stance: (samples, 4), the legs that may carry; None for all.
        feet: (samples, 4, 3) [m], centres of the feet in the trunk frame; None for forward kinematics.
        noise: as for `ContactForceEstimator`.

    Raises:
        RecordingError: shapes that do not fit.
    """
    samples = len(joints)
    if effort.shape != joints.position.shape:
        raise RecordingError(f"effort needs shape {joints.position.shape}, got {effort.shape}")
    regressor = JointTorqueRegressor(robot.tree, FrictionModel.full(_STICTION_VELOCITY))
    columns = np.array([[robot.tree.joints.index(joint) for joint in leg.joints] for leg in robot.legs])
    torque = (regressor.predict(joints, _parameters(robot), trunk) - effort)[:, columns]
    centres = foot_positions(robot, joints.position) if feet is None else feet
    allowed = np.ones((samples, 4), dtype=bool) if stance is None else stance
    specific = np.broadcast_to(trunk.specific_force, (samples, 3))
    up = specific / np.linalg.norm(specific, axis=-1, keepdims=True)
    axes, origins = joint_axes(robot, joints.position)

    flat = least_determinant(robot)

    def solved(stance: Bools) -> tuple[Array, Array, Array, Array]:
        normal = ground_normal(centres, stance, up)
        contact = centres - _radii(robot) * normal[:, None, :]
        jacobian = point_jacobians(axes, origins, contact)
        singular = (np.abs(np.linalg.det(jacobian)) < flat)[..., None, None]
        transposed = np.where(singular, np.nan, np.swapaxes(jacobian, -1, -2))
        forces = np.asarray(np.linalg.solve(transposed, torque[..., None])[..., 0], dtype=np.float64)
        return normal, contact, jacobian, forces

    normal, _, _, force = solved(allowed)
    loaded = allowed & ((force * normal[:, None, :]).sum(axis=-1) > CARRIES * robot.mass * _GRAVITY)
    normal, contact, jacobian, force = solved(loaded)
    return ContactForces(force, contact, loaded, normal, jacobian, axes, noise or ForceNoise.of(robot))


def friction_torque(robot: Robot, velocity: Array) -> Array:
    """(..., n) [N·m], what friction and offsets of the joints take at velocities (..., n) [rad/s], as believed."""
    joints = [robot.dynamics[joint] for joint in robot.tree.joints]
    viscous, coulomb, offset = np.array([[d.viscous, d.coulomb, d.offset] for d in joints]).T
    return np.asarray(viscous * velocity + coulomb * np.tanh(velocity / _STICTION_VELOCITY) + offset)


def _normal(feet: Array, stance: Bools, measurement: Measurement) -> Array:
    """`ground_normal` of one sample; written out for the four feet of a stand, for speed."""
    if False in stance.tolist():
        return ground_normal(feet, stance, measurement.up)
    lf, rf, lh, rh = feet.tolist()
    ax, ay, az = rf[0] - lh[0], rf[1] - lh[1], rf[2] - lh[2]
    bx, by, bz = lf[0] - rh[0], lf[1] - rh[1], lf[2] - rh[2]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = sqrt(x * x + y * y + z * z)
    up = measurement.up
    if size == 0.0:
        return up
    ux, uy, uz = up.tolist()
    size = size if x * ux + y * uy + z * uz >= 0.0 else -size
    return np.array([x / size, y / size, z / size])


def _solved_each(jacobian: Array, torque: Array, flat: float) -> Array:
    """J^-T t for each leg, (4, 3), by Cramer's rule: J's columns j_k give Σ t_k (j_k+1 x j_k+2) / det J; NaN where J is
    too near to singular. Written out, for the overhead of a general solver is ten times the work.
    """
    forces = []
    for leg, (t0, t1, t2) in zip(jacobian.tolist(), torque.tolist(), strict=True):
        (a, b, c), (d, e, f), (g, h, i) = leg
        x0, y0, z0 = e * i - h * f, h * c - b * i, b * f - e * c  # j_1 x j_2
        determinant = a * x0 + d * y0 + g * z0
        if abs(determinant) < flat:
            forces.append((nan, nan, nan))
            continue
        x = t0 * x0 + t1 * (f * g - i * d) + t2 * (d * h - g * e)
        y = t0 * y0 + t1 * (i * a - c * g) + t2 * (g * b - a * h)
        z = t0 * z0 + t1 * (c * d - f * a) + t2 * (a * e - d * b)
        forces.append((x / determinant, y / determinant, z / determinant))
    return np.array(forces)


def _radii(robot: Robot) -> Array:
    return np.array([[leg.foot_radius] for leg in robot.legs])


def least_determinant(robot: Robot) -> float:
    """The determinant [m³] below which a leg's Jacobian counts as singular."""
    spans = [robot.tree.translations[robot.tree.joints.index(leg.joints[2])] for leg in robot.legs]
    length = min(
        float(np.linalg.norm(span) + np.linalg.norm(leg.foot_position))
        for span, leg in zip(spans, robot.legs, strict=True)
    )
    return _LEAST_VOLUME * length**3


def _parameters(robot: Robot) -> dict[str, float]:
    """The robot's own values of all that its joint torques depend on."""
    values = {
        f"{link}.{name}": float(value)
        for link in robot.tree.links
        for name, value in zip(ORDER, robot.inertias[link].vector, strict=True)
    }
    for joint in robot.tree.joints:
        values |= {f"{joint}.{term}": float(getattr(robot.dynamics[joint], term)) for term in FRICTION_TERMS}
    return values
