"""The six equations of a robot at rest, as rows in the trunk's parameters and in constant errors.

With F = Σ f_i and μ = Σ p_i x f_i of the feet that carry (trunk axes, about the trunk's origin), g the downward pull's
size, u the vertical, m and h = m c of the trunk with its payload, m_l and h_l of the legs

    F - (m + m_l) g u = 0,        μ - (h + h_l) x g u = 0                      (the paper's eq. 9, with its forces)

are linear in m and h. Constant errors over a run: the joints' torques by offsets t (measured minus true), the
feet's positions by d (trunk frame), the vertical by a small rotation ε, u_measured = u + ε x u, the masses of the legs'
links by shares s (model minus true). The equations are linearised at values t₀, d₀, ε₀, which are subtracted from the
measurement:

    dF = -∂F/∂τ dt - ∂F/∂p dd,    dμ likewise,    du = u x dε      (torques enter exactly linearly, feet nearly)

Link k, mass m_k with centre of mass c_k, has the part J_kᵀ m_k g u of h; so by its share

    dF_k = J_c^-T J_kᵀ m_k g u,    d(m_l g u) = m_k g u,    d(h_l x g u) = c_k x m_k g u      (J_k: Jacobian of c_k)

and all links together, by du in the place of u, are what a wrong vertical does to the forces.

Without an IMU the vertical is itself found from the forces, anew in each pose (`standing.vertical`), so that
its error is no constant one but two unknowns of the pose, of which nothing else is known. They are taken out of the
six equations: of those, whitened, what is normal to their two columns is left, four equations a pose, in which offsets
count by what they do through the vertical, too.

Whether a foot carries is not asked of its force, which the errors may hide: the equations hold for all feet, loaded or
not. A leg that is known to be held in the air is left out, and adds its joints' own equations, h_j - τ_j = 0, in which
nothing but the offsets is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import ModelError
from stadera.inertia import skew, skews
from stadera.legs.model import LegModel
from stadera.legs.rows import Rows
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.standing.contact import ContactForces
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.trunk.standing.noise import ForceNoise
from stadera.trunk.standing.vertical import vertical_of
from stadera.types import Array

TRUNK: tuple[str, ...] = ("m", "mcx", "mcy", "mcz")
"""Names of the trunk's four parameters [kg, kg·m]."""

ERRORS = 39
"""How many constant errors there are: 12 torques, 12 of feet, 3 of the vertical, 12 masses of links."""

_FEWEST = 30  # samples whose scatter says something of a covariance
_REPEATABLE = 1e-4  # share of the robot's weight (times 1 m): what a pose at rest leaves unexplained


@lru_cache(maxsize=16)
def error_names(robot: Robot) -> tuple[str, ...]:
    """Names of the constant errors: torque offsets leg by leg, feet leg by leg, the vertical, the legs' links."""
    torques = [f"{joint}.torque" for leg in robot.legs for joint in leg.joints]
    feet = [f"{leg.name}.foot.{axis}" for leg in robot.legs for axis in "xyz"]
    links = [f"{link}.mass" for leg in robot.legs for link in leg.links]
    return (*torques, *feet, *(f"vertical.{axis}" for axis in "xyz"), *links)


@dataclass(frozen=True, eq=False)
class ConstantErrors:
    """How large the constant errors may be, as a Gaussian of mean zero.

    Attributes:
        covariance: (39, 39), of torques [N·m], feet [m], vertical [rad] and links' masses (shares), in the order of
            `error_names`.

    Raises:
        ModelError: a wrong shape, or not a covariance of positive variances.
    """

    covariance: Array

    def __post_init__(self) -> None:
        C = np.array(self.covariance, dtype=float)
        if C.shape != (ERRORS, ERRORS) or not np.isfinite(C).all() or np.linalg.eigvalsh(C).min() <= 0:
            raise ModelError(f"constant errors need a positive definite covariance {(ERRORS, ERRORS)}")
        object.__setattr__(self, "covariance", C)

    @classmethod
    def of(cls, noise: ForceNoise, orientation: float = np.deg2rad(0.2), common_torque: float = 0.0) -> ConstantErrors:
        """Independent errors, save for a part of the torques that is common to all joints.

        Args:
            noise: of torques, feet and links' masses.
            orientation: of each component of ε [rad].
            common_torque: standard deviation of an offset that is the same in every joint [N·m].
        """
        sizes = (np.full(12, noise.foot_position), np.full(3, orientation), np.full(12, noise.leg_mass))
        std = np.concatenate([noise.torque_constant.ravel(), *sizes])
        C = np.diag(np.maximum(std, 1e-9) ** 2)
        C[:12, :12] += common_torque**2
        return cls(C)

    @cached_property
    def root(self) -> Array:
        """L (39, 39) with L Lᵀ the covariance."""
        return np.asarray(np.linalg.cholesky(self.covariance))


def leg_mass_slope(forces: ContactForces, robot: Robot, joint_position: Array, up: Array) -> Array:
    """(6, 12): change of (F - m_l g u, μ - h_l x g u), at rest, with the masses of the legs' links, as shares."""
    return np.asarray(link_weights(forces, robot, joint_position) @ up)


def link_weights(forces: ContactForces, robot: Robot, joint_position: Array) -> Array:
    """(6, 12, 3): what each link of the legs does to (F - m_l g u, μ - h_l x g u), at rest, linear in u."""
    model = LegModel.of(robot)
    pose = model.pose(joint_position[None, model.columns])
    axes, origins, coms = (x[:, 0].transpose(1, 2, 0) for x in (pose.axis, pose.joints, model.centres(pose)))
    weights = GRAVITY * model.link_mass
    arms = coms[:, :, None] - origins[:, None]  # (leg, link, joint, 3)
    bears = np.cross(axes[:, None], arms) * np.tri(3)[:, :, None]  # a joint does not feel the links before it
    felt = forces.torque_to_force * forces.stance[:, None, None]
    force = -weights[..., None, None] * (felt[:, None] @ bears)
    own = weights[..., None, None]
    moment = skews(forces.contact)[:, None] @ force - own * skews(coms)
    slope = np.concatenate([force - own * np.eye(3), moment], axis=-2)  # (leg, link, 6, 3)
    return np.asarray(slope.reshape(12, 6, 3).swapaxes(0, 1))


def vertical_slope(links: Array, trunk: Array, up: Array) -> Array:
    """(6, 3): change of (F - (m + m_l) g u, μ - (h + h_l) x g u) with a small rotation ε, u = u_measured + u x ε.

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
    """(4, 39): how far the trunk's mass [kg] and the vertical are off by constant errors, the vertical the forces' own.

    By the differential of F - (m + m_l) g u = 0, three equations, in m and in u across itself.
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
) -> Rows:
    """Whitened rows of one pose, in `TRUNK` and the constant errors.

    Args:
        forces_of: source of contact forces, and of the noise that weights the rows.
        measurement: the pose's mean.
        count: of samples that it is the mean of.
        errors: (39,), values that the equations are linearised at.
        foot_variance: of each component of the feet's mean positions, where these are measured by themselves [m²].
        effort_covariance: (n, n), of the mean efforts by their own scatter [N²·m²]. Where the wrench's is larger by
            that than the noise explains (sensors worse than thought, a controller that shakes the robot), it counts.
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
    covariance = np.eye(len(matrix)) * (_REPEATABLE * forces_of.robot.mass * GRAVITY) ** 2
    covariance[:6, :6] += (slope[:, :12] * white) @ slope[:, :12].T
    if effort_covariance is not None and count >= _FEWEST:
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
    linear_at[27:] = 0.0  # links' masses are not taken off the measurement: their equations are linear
    target = matrix[:, 4:] @ linear_at - value
    white_rows, white_target = np.linalg.solve(root, matrix), np.linalg.solve(root, target)
    if m.vertical_by_forces:
        white_rows, white_target = _without_vertical(white_rows, white_target, up)
    return Rows((*TRUNK, *error_names(forces_of.robot)), white_rows, white_target)


def _without_vertical(matrix: Array, target: Array, up: Array) -> tuple[Array, Array]:
    """What whitened equations say whatever the vertical is: their part normal to its two columns."""
    rest = np.linalg.qr(matrix[:, 28:31] @ _across(up), mode="complete")[0][:, 2:].T
    left = rest @ matrix
    left[:, 28:31] = 0.0
    return left, rest @ target


def _across(up: Array) -> Array:
    """(3, 2), an orthonormal basis of the plane across a unit vector."""
    return np.asarray(np.linalg.svd(up[None])[2][1:].T)


def _at_least(explained: Array, scatter: Array) -> Array:
    """The covariance that is the larger one of two in every direction, as seen with the first one for a unit."""
    root = np.linalg.cholesky(explained)
    seen = np.linalg.solve(root, np.linalg.solve(root, scatter).T)
    sizes, axes = np.linalg.eigh(0.5 * (seen + seen.T))
    wide = root @ axes
    return np.asarray((wide * np.maximum(sizes, 1.0)) @ wide.T)


def _without(m: Measurement, errors: Array, forces_of: ContactForceEstimator) -> tuple[Measurement, Array]:
    """The measurement with these errors taken off, as one at rest, and its vertical."""
    torque, foot, turn = np.zeros(len(m.effort)), errors[12:24].reshape(4, 3), errors[24:27]
    torque[forces_of.legs.columns] = errors[:12].reshape(4, 3)
    effort = m.effort - torque
    up = m.up - np.cross(turn, m.up)
    if m.vertical_by_forces:
        up = vertical_of(replace(m, effort=effort), forces_of.robot)
    up /= np.linalg.norm(up)
    feet = m.foot_position
    if foot.any():
        feet = (forces_of.legs.at(m).feet if feet is None else feet) - foot
    still = np.zeros_like(m.joint_velocity)
    corrected = replace(
        m,
        joint_velocity=still,
        angular_velocity=np.zeros(3),
        specific_force=GRAVITY * up,
        rotation=None,
        effort=effort,
        foot_position=feet,
    )
    return corrected, up


def _estimated_trunk(forces: ContactForces, leg_moment: Array, leg_mass: float, up: Array) -> Array:
    """Mass and first moment (4,) of the trunk from this pose alone, nothing along the vertical: for slopes."""
    mass = float(up @ forces.total_force) / GRAVITY
    moment = np.cross(up, forces.moment) / GRAVITY
    return np.array([mass - leg_mass, *(moment - leg_moment)])
