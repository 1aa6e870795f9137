"""The six equations of a robot at rest, as rows in the trunk's parameters and in constant errors.

With F = Σ f_i and μ = Σ p_i x f_i over the loaded feet (trunk axes, about the trunk's origin), g the magnitude of
gravity, u the vertical, m and h = m c of the trunk with its payload, m_l and h_l of the legs

    F - (m + m_l) g u = 0,        μ - (h + h_l) x g u = 0                      (the paper's eq. 9, with its forces)

are linear in m and h. The errors that are constant over a run are those of the joints' torques, t (measured minus
true), of the feet's positions, d (trunk frame), of the vertical, a small rotation ε with u_measured = u + ε x u, and of
the links' masses, shares s (model minus true). The equations are linearised at values t₀, d₀, ε₀, which are subtracted
from the measurement:

    dF = -∂F/∂τ dt - ∂F/∂p dd,    dμ likewise,    du = u x dε      (torques enter exactly linearly, feet nearly)

Link k, with mass m_k and centre of mass c_k, contributes J_kᵀ m_k g u to h; so its share changes

    dF_k = J_c^-T J_kᵀ m_k g u,    d(m_l g u) = m_k g u,    d(h_l x g u) = c_k x m_k g u      (J_k: Jacobian of c_k)

and the sum over all links, with du instead of u, is the effect of a wrong vertical on the forces.

Without an IMU the vertical is itself estimated from the forces in each pose (`standing.forces`), so that its error is
not constant but adds two unknowns to each pose. They are eliminated from the six equations: the whitened equations are
projected onto the complement of the two columns, which leaves four equations per pose, in which offsets include their
effect on the vertical.

Contact is not decided from the force, which the errors may hide: the equations hold for all feet, loaded or not. A leg
that is known to be in the air is excluded, and adds its joints' own equations, h_j - τ_j = 0, in which only the offsets
are unknown.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from stadera.body.statics import LegModel
from stadera.constants import GRAVITY
from stadera.errors import ModelError
from stadera.inertia import skew, skews
from stadera.robot.model import Robot
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.measurement import Measurement
from stadera.trunk.settings import ModelErrors
from stadera.trunk.standing.forces import ContactForceEstimator, ContactForces, ForceNoise, vertical_by_forces
from stadera.types import Array

ERRORS = 39
"""Number of constant errors: 12 torques and 12 of feet leg by leg, 3 of the vertical, 12 masses of links."""


@dataclass(frozen=True, eq=False)
class ConstantErrors:
    """Prior of the constant errors, Gaussian with mean zero.

    Attributes:
        covariance: (39, 39), of torques [N·m], feet [m], vertical [rad] and links' masses (shares).
        sticking: (12, 12) [N²·m²], part of the torques' covariance that is static friction. It is constant while the
            robot stands, and another one after a load has moved the joints: it does not cancel between two loads.

    Raises:
        ModelError: wrong shape, or not a covariance of positive variances.
    """

    covariance: Array
    sticking: Array = field(default_factory=lambda: np.zeros((12, 12)))

    def __post_init__(self) -> None:
        C = np.array(self.covariance, dtype=float)
        if C.shape != (ERRORS, ERRORS) or not np.isfinite(C).all() or np.linalg.eigvalsh(C).min() <= 0:
            raise ModelError(f"constant errors need a positive definite covariance {(ERRORS, ERRORS)}")
        object.__setattr__(self, "covariance", C)

    @classmethod
    def of(cls, noise: ForceNoise, orientation: float = np.deg2rad(0.2), common_torque: float = 0.0) -> ConstantErrors:
        """Independent errors, except for a part of the torques that is common to all joints.

        Args:
            noise: of torques, feet and links' masses.
            orientation: of each component of ε [rad].
            common_torque: standard deviation of an offset common to all joints [N·m].
        """
        sizes = (np.full(12, noise.foot_position), np.full(3, orientation), np.full(12, noise.leg_mass))
        std = np.concatenate([noise.torque_constant.ravel(), *sizes])
        C = np.diag(np.maximum(std, 1e-9) ** 2)
        C[:12, :12] += common_torque**2
        return cls(C)

    @classmethod
    def of_robot(cls, robot: Robot, sizes: ModelErrors | None = None) -> ConstantErrors:
        """Of a real robot, with the sizes that weighing in motion assumes too (`trunk.error_model`): torques are off by
        their offsets and by static friction, which holds up to a joint's Coulomb friction and its friction under load.
        """
        model = ErrorModel(robot, sizes or ModelErrors(), robot.leg_length)
        std = {name: np.sqrt(model.variance[place]) for name, place in model.layout.places.items()}
        tilt = float(np.hypot(std["imu_rotation"].max(), std["accelerometer"].max() / GRAVITY))
        C = np.diag(np.concatenate([std["offset"], std["contact"], np.full(3, tilt), std["link_mass"]]) ** 2)
        unloaded = model.covariance[model.layout.sticking, model.layout.sticking]
        held = np.sqrt(np.diag(unloaded))
        more = np.hypot(held, model.held * model.by_load) / np.maximum(held, 1e-12)
        sticking = unloaded * more * more[:, None]
        C[:12, :12] += sticking
        return cls(C, sticking)

    def scaled(self, lasting: float, sticking: float) -> ConstantErrors:
        """The same with the standard deviations of what lasts and of static friction multiplied."""
        held = sticking**2 * self.sticking
        covariance = lasting**2 * self.lasting
        covariance[:12, :12] += held
        return ConstantErrors(covariance, held)

    @property
    def lasting(self) -> Array:
        """(39, 39), covariance of what is the same under every load."""
        out = self.covariance.copy()
        out[:12, :12] -= self.sticking
        return out

    @cached_property
    def root(self) -> Array:
        """L (39, 39) with L Lᵀ the covariance."""
        return np.asarray(np.linalg.cholesky(self.covariance))


def leg_mass_slope(forces: ContactForces, robot: Robot, joint_position: Array, up: Array) -> Array:
    """Derivative (6, 12) of (F - m_l g u, μ - h_l x g u), at rest, with respect to the links' masses, as shares."""
    return np.asarray(link_weights(forces, robot, joint_position) @ up)


def link_weights(forces: ContactForces, robot: Robot, joint_position: Array) -> Array:
    """Contribution (6, 12, 3) of each leg link to (F - m_l g u, μ - h_l x g u), at rest, linear in u."""
    model = LegModel.of(robot)
    pose = model.pose(joint_position[None, model.columns])
    axes, origins, coms = (x[:, 0].transpose(1, 2, 0) for x in (pose.axis, pose.joints, model.centres(pose)))
    weights = GRAVITY * model.link_mass
    arms = coms[:, :, None] - origins[:, None]  # (leg, link, joint, 3)
    bears = np.cross(axes[:, None], arms) * np.tri(3)[:, :, None]  # the links before a joint do not load it
    felt = forces.torque_to_force * forces.stance[:, None, None]
    force = -weights[..., None, None] * (felt[:, None] @ bears)
    own = weights[..., None, None]
    moment = skews(forces.contact)[:, None] @ force - own * skews(coms)
    slope = np.concatenate([force - own * np.eye(3), moment], axis=-2)  # (leg, link, 6, 3)
    return np.asarray(slope.reshape(12, 6, 3).swapaxes(0, 1))


def vertical_slope(links: Array, trunk: Array, up: Array) -> Array:
    """Derivative (6, 3) of (F - (m + m_l) g u, μ - (h + h_l) x g u) with respect to ε, u = u_measured + u x ε.

    Args:
        links: `link_weights`.
        trunk: (4,), m [kg] and h [kg·m].
        up: u_measured, (3,).
    """
    by_up = links.sum(axis=1)
    by_up[:3] -= GRAVITY * trunk[0] * np.eye(3)
    by_up[3:] -= GRAVITY * skew(trunk[1:])
    return np.asarray(by_up @ skew(up))


def weight_felt(forces: ContactForces, robot: Robot, joint_position: Array, up: Array) -> Array:
    """Errors (4, 39) of the trunk's mass [kg] and of a vertical taken from the forces, due to constant errors.

    From the differential of F - (m + m_l) g u = 0, three equations, with respect to m and to u across itself.
    """
    links = link_weights(forces, robot, joint_position)
    by_error = np.hstack([forces.wrench_slope[:3], np.zeros((3, 3)), links[:3] @ up])
    mass = float(up @ forces.total_force) / GRAVITY - robot.mass + robot.inertias[robot.trunk].mass
    across = _across(up)
    by_up = links[:3].sum(axis=1) - GRAVITY * mass * np.eye(3)
    felt = np.linalg.solve(np.column_stack([GRAVITY * up, -by_up @ across]), by_error)
    return np.vstack([felt[:1], across @ felt[1:]])


def equilibrium_rows(
    forces_of: ContactForceEstimator,
    measurement: Measurement,
    count: float,
    errors: Array,
    foot_variance: float = 0.0,
    effort_covariance: Array | None = None,
    fewest: int = 30,
) -> tuple[Array, Array]:
    """Whitened rows (n, 43) of one pose, in the trunk's m and h and the constant errors, and their right side (n,).

    Args:
        forces_of: estimator of contact forces, with the noise that weights the rows.
        measurement: the pose's mean.
        count: number of samples in the mean.
        errors: (39,), values at which the equations are linearised.
        foot_variance: of each component of the feet's mean positions, if these are measured separately [m²].
        effort_covariance: (n, n), of the mean efforts from their scatter [N²·m²]. It is used where it makes the
            wrench's covariance larger than the noise does (worse sensors than assumed, a controller that shakes the
            robot).
        fewest: number of samples needed to estimate a covariance from their scatter.
    """
    m, up = _without(measurement, errors, forces_of)
    forces, state = forces_of.at(m), forces_of.legs.at(m)
    meant = np.ones(4, dtype=bool) if m.stance is None else m.stance
    felt = np.isfinite(forces.force).all(axis=1)
    forces = replace(forces, stance=meant & felt)
    swing = np.flatnonzero(~meant & felt).tolist()
    slope = forces.wrench_slope
    matrix = np.zeros((6 + 3 * len(swing), 4 + ERRORS))
    matrix[:3, 0] = -GRAVITY * up
    matrix[3:6, 1:4] = GRAVITY * skew(up)
    matrix[:6, 4:28] = -slope
    trunk = _estimated_trunk(forces, state.moment, forces_of.legs.mass, up)
    links = link_weights(forces, forces_of.robot, m.joint_position)
    matrix[:6, 31:] = -links @ up
    matrix[:6, 28:31] = vertical_slope(links, trunk, up)
    legs_only = np.concatenate([forces_of.legs.mass * up, np.cross(state.moment, up)]) * GRAVITY
    value = np.zeros(len(matrix))
    value[:6] = forces.wrench - legs_only
    white = (forces.noise.torque_white**2 / count).ravel()
    covariance = np.eye(len(matrix)) * (forces.noise.repeatable * forces_of.robot.mass * GRAVITY) ** 2
    covariance[:6, :6] += (slope[:, :12] * white) @ slope[:, :12].T
    if effort_covariance is not None and count >= fewest:
        joints = forces_of.legs.columns.ravel()
        scatter = slope[:, :12] @ effort_covariance[np.ix_(joints, joints)] @ slope[:, :12].T
        covariance[:6, :6] = _at_least(covariance[:6, :6], scatter)
    covariance[:6, :6] += foot_variance * slope[:, 12:] @ slope[:, 12:].T
    for k, leg in enumerate(swing):
        at, own = slice(6 + 3 * k, 9 + 3 * k), slice(3 * leg, 3 * leg + 3)
        value[at] = forces.jacobian[leg].T @ forces.force[leg]
        matrix[at, 4:16][:, own] = np.eye(3)
        covariance[at, at] += np.diag(white[own])
    root = np.linalg.cholesky(covariance)
    linear_at = errors.copy()
    linear_at[27:] = 0.0  # links' masses are not subtracted from the measurement: their equations are linear
    target = matrix[:, 4:] @ linear_at - value
    matrix, target = np.linalg.solve(root, matrix), np.linalg.solve(root, target)
    if m.vertical_by_forces:  # projected onto the complement of the vertical's two columns
        rest = np.linalg.qr(matrix[:, 28:31] @ _across(up), mode="complete")[0][:, 2:].T
        matrix, target = rest @ matrix, rest @ target
        matrix[:, 28:31] = 0.0
    return matrix, target


def _across(up: Array) -> Array:
    """An orthonormal basis (3, 2) of the plane normal to a unit vector."""
    return np.asarray(np.linalg.svd(up[None])[2][1:].T)


def _at_least(explained: Array, scatter: Array) -> Array:
    """The larger of two covariances in every direction, in units of the first."""
    root = np.linalg.cholesky(explained)
    seen = np.linalg.solve(root, np.linalg.solve(root, scatter).T)
    sizes, axes = np.linalg.eigh(0.5 * (seen + seen.T))
    wide = root @ axes
    return np.asarray((wide * np.maximum(sizes, 1.0)) @ wide.T)


def _without(m: Measurement, errors: Array, forces_of: ContactForceEstimator) -> tuple[Measurement, Array]:
    """The measurement at rest after subtracting these errors, and its vertical."""
    torque, foot, turn = np.zeros(len(m.effort)), errors[12:24].reshape(4, 3), errors[24:27]
    torque[forces_of.legs.columns] = errors[:12].reshape(4, 3)
    effort = m.effort - torque
    up = m.up - np.cross(turn, m.up)
    if m.vertical_by_forces:
        still, stance = np.zeros_like(m.effort)[None], None if m.stance is None else m.stance[None]
        up = vertical_by_forces(forces_of.robot, m.joint_position[None], still, effort[None], stance)[0][0]
    up /= np.linalg.norm(up)
    feet = m.foot_position
    if foot.any():
        feet = (forces_of.legs.at(m).feet if feet is None else feet) - foot
    corrected = replace(
        m,
        joint_velocity=np.zeros_like(m.joint_velocity),
        angular_velocity=np.zeros(3),
        specific_force=GRAVITY * up,
        rotation=None,
        effort=effort,
        foot_position=feet,
    )
    return corrected, up


def _estimated_trunk(forces: ContactForces, leg_moment: Array, leg_mass: float, up: Array) -> Array:
    """Mass and first moment (4,) of the trunk from this pose alone, zero along the vertical; used for derivatives."""
    mass = float(up @ forces.total_force) / GRAVITY
    moment = np.cross(up, forces.moment) / GRAVITY
    return np.array([mass - leg_mass, *(moment - leg_moment)])


def felt_by_mass(forces: ContactForces, measurement: Measurement, robot: Robot) -> Array:
    """Error (39,) of the trunk's mass [kg] per unit of the constant errors; that of the vertical has no effect.

    If the vertical is computed from the forces, the errors tilt it as well.
    """
    up = measurement.up
    if measurement.vertical_by_forces:
        return np.asarray(weight_felt(forces, robot, measurement.joint_position, up)[0])
    by_legs = leg_mass_slope(forces, robot, measurement.joint_position, up)[:3]
    slope = np.hstack([forces.wrench_slope[:3], np.zeros((3, 3)), by_legs])
    return np.asarray(up @ slope / GRAVITY)
