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

_CARRIES = 0.03  # share of the robot's weight that a foot in stance has along the normal
_LEAST_LEVER = 0.01  # share of the leg's length: a smaller singular value of J_c means that a direction is not felt
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
        self._least = _CARRIES * robot.mass * _GRAVITY
        self._limit = _largest_inverse(robot)
        joints = [robot.dynamics[joint] for joint in robot.tree.joints]
        self._viscous = np.array([d.viscous for d in joints])
        self._coulomb = np.array([d.coulomb for d in joints])
        self._offset = np.array([d.offset for d in joints])
        self._everyone = np.ones(4, dtype=bool)

    def at(self, measurement: Measurement) -> ContactForces:
        """The contact forces at a measurement, trunk axes."""
        state, columns = self.legs.at(measurement), self.legs.columns
        velocity = measurement.joint_velocity
        joint_side = self._viscous * velocity + self._offset - measurement.effort
        if self._coulomb.any():
            joint_side += self._coulomb * np.tanh(velocity / _STICTION_VELOCITY)
        torque = state.bias + joint_side[columns]
        feet = state.feet if measurement.foot_position is None else measurement.foot_position
        stance = self._everyone if measurement.stance is None else measurement.stance

        def solved(stance: Bools) -> tuple[Array, Array, Array, Array]:
            normal = _normal(feet, stance, measurement)
            below = self._radii * normal
            points = (state.feet if self.jacobian == "encoders" else feet) - below
            inverse = _inverted(state.jacobians(points), self._limit)
            force = (inverse @ torque[:, :, None])[:, :, 0]
            return normal, feet - below, inverse, force

        normal, contact, inverse, force = solved(stance)
        loaded = stance & (force @ normal > self._least)
        if not (loaded == stance).all():
            normal, contact, inverse, force = solved(loaded)
        return ContactForces(force, contact, loaded, normal, inverse, state.axes, self.noise, self.jacobian == "feet")


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

    def solved(stance: Bools) -> tuple[Array, Array, Array, Array]:
        normal = ground_normal(centres, stance, up)
        contact = centres - _radii(robot) * normal[:, None, :]
        inverse = _inverted(point_jacobians(axes, origins, contact), _largest_inverse(robot))
        return normal, contact, inverse, (inverse @ torque[..., None])[..., 0]

    normal, _, _, force = solved(allowed)
    loaded = allowed & ((force * normal[:, None, :]).sum(axis=-1) > _CARRIES * robot.mass * _GRAVITY)
    normal, contact, inverse, force = solved(loaded)
    return ContactForces(force, contact, loaded, normal, inverse, axes, noise or ForceNoise.of(robot))


def _normal(feet: Array, stance: Bools, measurement: Measurement) -> Array:
    if not stance.all():
        return ground_normal(feet, stance, measurement.up)
    ax, ay, az = (feet[1] - feet[2]).tolist()
    bx, by, bz = (feet[0] - feet[3]).tolist()
    normal = np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
    size = float(np.sqrt(normal @ normal))
    if size == 0.0:
        return measurement.up
    return np.asarray(normal / (size if normal @ measurement.up >= 0 else -size))


def _inverted(jacobians: Array, limit: float) -> Array:
    """J^-T; NaN where a leg is too near to singular."""
    try:
        inverse = np.linalg.inv(np.swapaxes(jacobians, -1, -2))
    except np.linalg.LinAlgError:
        inverse = np.linalg.pinv(np.swapaxes(jacobians, -1, -2), rcond=1e-15)
        singular = np.linalg.matrix_rank(jacobians) < 3
        inverse[singular] = np.nan
    if np.abs(inverse).max() > limit:
        inverse[np.abs(inverse).max(axis=(-2, -1)) > limit] = np.nan
    return np.asarray(inverse, dtype=np.float64)


def _radii(robot: Robot) -> Array:
    return np.array([[leg.foot_radius] for leg in robot.legs])


def _largest_inverse(robot: Robot) -> float:
    """Largest entry [1/m] of a J^-T that is not taken as singular."""
    spans = [robot.tree.translations[robot.tree.joints.index(leg.joints[2])] for leg in robot.legs]
    length = min(
        float(np.linalg.norm(span) + np.linalg.norm(leg.foot_position))
        for span, leg in zip(spans, robot.legs, strict=True)
    )
    return 1.0 / (_LEAST_LEVER * length)


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
