"""The six equations of a robot at rest, as rows in the trunk's parameters and in constant errors.

With F = Σ f_i and μ = Σ p_i x f_i over the loaded feet (trunk axes, about the trunk's origin), g the magnitude of
gravity, u the vertical, m and h = m c of the trunk with its payload, m_l and h_l of the legs

    F - (m + m_l) g u = 0,        μ - (h + h_l) x g u = 0                      (the paper's eq. 9, with its forces)

are linear in m and h. The errors that are constant over a run are those of the joints' torques, t (measured minus
true), of the feet's positions, d (trunk frame), of the vertical, a small rotation ε with u_measured = u + ε x u, and of
the links' masses, shares s (model minus true). The equations are linearised at values t₀, d₀, ε₀, which are subtracted
from the measurement:

    dF = -∂F/∂τ dt - ∂F/∂p dd,    dμ likewise,    du = u x dε      (torques enter exactly linearly, feet nearly)

The effect of a link's share is that of its weight on these equations, by its joints and by itself
(`standing.forces.Weights`), and the sum over all links, with du instead of u, is that of a wrong vertical.

Without an IMU the vertical is itself estimated from the forces in each pose (`standing.forces`), so that its error is
not constant but adds two unknowns to each pose. They are eliminated from the six equations: the whitened equations are
projected onto the complement of the two columns, which leaves four equations per pose, in which offsets include their
effect on the vertical.

Contact is not decided from the force, which the errors may hide: the equations hold for all feet, loaded or not. A leg
that is known to be in the air is excluded, and adds its joints' own equations, h_j - τ_j = 0, in which only the offsets
are unknown.
"""

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import ModelError
from stadera.inertia import skew
from stadera.information import Unknowns
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.standing.forces import ContactForceEstimator, ContactForces, vertical_by_forces
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class ForceNoise:
    """Standard deviations of torques and feet. "Constant" errors do not average out over a run.

    Attributes:
        torque_white, torque_constant: (J,) [N·m], of the legs' joints, leg by leg and outwards.
        foot_position: [m], of each component of a foot's position in the trunk frame, constant.
        leg_mass: relative error of the mass of a leg's link, constant.
        repeatable: residual of a pose at rest, as a share of the robot's weight, moments at 1 m. Assumed.

    Raises:
        ModelError: torques of different shapes, or a value that is negative or not finite.
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
            if name.startswith("torque") and (value.ndim != 1 or value.shape != np.shape(self.torque_white)):
                raise ModelError(f"force noise {name!r} needs one value for each joint of the legs, got {value.shape}")

    @classmethod
    def of(
        cls,
        robot: Robot,
        white: float = 0.0033,
        constant: float = 0.0033,
        foot_position: float = 0.0,
        leg_mass: float = 0.02,
        lever: float = 0.5,
    ) -> Self:
        """Torque noise as shares of the joints' effort limits.

        Static friction of a joint at rest lies anywhere within its Coulomb friction ± τ_c: τ_c / √3 is added to the
        constant part. A joint without effort limit is treated as one made to carry half the robot's weight at
        `lever` [m].
        """
        joints = [joint for leg in robot.legs for joint in leg.joints]
        limit = np.array([robot.limits[joint].effort for joint in joints])
        limit = np.where(np.isfinite(limit), limit, 0.5 * robot.mass * GRAVITY * lever)
        coulomb = np.array([robot.dynamics[joint].coulomb for joint in joints])
        return cls(white * limit, np.hypot(constant * limit, coulomb / np.sqrt(3.0)), foot_position, leg_mass)


class NoisyForces(ContactForceEstimator):
    """Contact forces; `noise` of torques and feet, None for the default shares of the effort limits."""

    def __init__(self, robot: Robot, noise: ForceNoise | None = None) -> None:
        super().__init__(robot)
        self.noise = noise or ForceNoise.of(robot)


def constant_errors_of(robot: Robot) -> Unknowns:
    """Names and places of a robot's constant errors: torques of J joints and positions of L feet, leg by leg, the
    vertical, and the masses of the tree's links.
    """
    joints, legs = sum(len(leg.joints) for leg in robot.legs), len(robot.legs)
    return Unknowns.of(torque=joints, foot=3 * legs, vertical=3, link_mass=len(robot.tree.joints))


def wrench_slope(forces: ContactForces) -> Array:
    """Derivative (6, J + 3 L) of the feet's wrench with respect to the legs' torques [N·m], then the feet's positions
    [m], leg by leg.
    """
    carried = np.where(forces.stance[:, None], np.nan_to_num(forces.force), 0.0)
    E = forces.to_wrench * forces.stance[forces.body.leg_of[forces.body.in_legs], None]
    by_foot = forces.body.by_contact(E, forces.axis, carried)
    return np.hstack([-E.T, by_foot.transpose(1, 0, 2).reshape(6, -1)])


def error_slope(forces: ContactForces, robot: Robot, up: Array) -> Array:
    """Derivative (6, k) of (F - m_l g u, μ - h_l x g u), at rest, with respect to the constant errors; the vertical's,
    which depends on the trunk, is zero.
    """
    links = forces.weights.links[:, : len(robot.tree.joints)] @ (GRAVITY * up)
    return np.hstack([wrench_slope(forces), np.zeros((6, 3)), links])


def _by_specific_force(forces: ContactForces, trunk: Array) -> Array:
    """Derivative (6, 3) of the equations by the trunk's specific force, with its mass and first moment (4,)."""
    lumped, own = forces.body.lumped[:4], np.empty((6, 3))
    mass, moment = trunk[0] - lumped[0], trunk[1:] - lumped[1:]
    own[:3], own[3:] = mass * np.eye(3), skew(moment)
    return np.asarray(forces.weights.links.sum(axis=1) - own)


def weight_felt(forces: ContactForces, robot: Robot, up: Array) -> Array:
    """Errors (4, k) of the trunk's mass [kg] and of a vertical taken from the forces, due to constant errors.

    From the differential of F - (m + m_l) g u = 0, three equations, with respect to m and to u across itself.
    """
    by_error = error_slope(forces, robot, up)[:3]
    mass = float(up @ forces.wrench[:3]) / GRAVITY - robot.mass + robot.inertias[robot.trunk].mass
    across = _across(up)
    by_up = GRAVITY * _by_specific_force(forces, np.array([mass, 0.0, 0.0, 0.0]))[:3]
    felt = np.linalg.solve(np.column_stack([GRAVITY * up, -by_up @ across]), by_error)
    return np.vstack([felt[:1], across @ felt[1:]])


def equilibrium_rows(
    forces_of: NoisyForces,
    measurement: Measurement,
    count: float,
    errors: Array,
    foot_variance: float = 0.0,
    effort_covariance: Array | None = None,
    fewest: int = 30,
) -> tuple[Array, Array]:
    """Whitened rows (r, 4 + k) of one pose, in the trunk's m and h and the constant errors, and their right side (r,).

    Args:
        forces_of: estimator of contact forces, with the noise that weights the rows.
        measurement: the pose's mean.
        count: number of samples in the mean.
        errors: (k,), values at which the equations are linearised.
        foot_variance: of each component of the feet's mean positions, if these are measured separately [m²].
        effort_covariance: (n, n), of the mean efforts from their scatter [N²·m²]. It is used where it makes the
            wrench's covariance larger than the noise does (worse sensors than assumed, a controller that shakes the
            robot).
        fewest: number of samples needed to estimate a covariance from their scatter.
    """
    robot, places = forces_of.robot, constant_errors_of(forces_of.robot)
    m, up = _without(measurement, errors, forces_of, places)
    forces = forces_of.at(m)
    meant = np.ones(len(robot.legs), dtype=bool) if m.stance is None else m.stance
    felt = np.isfinite(forces.force).all(axis=1)
    forces = replace(forces, stance=meant & felt)
    body, torque = forces.body, places["torque"]
    swing = np.flatnonzero((~meant & felt)[body.leg_of[body.in_legs]])  # joints of legs in the air
    matrix, value = np.zeros((6 + len(swing), 4 + len(places))), np.empty(6 + len(swing))
    by_error = matrix[:, 4:]
    matrix[:3, 0] = -GRAVITY * up
    matrix[3:6, 1:4] = GRAVITY * skew(up)
    by_error[:6] = -error_slope(forces, robot, up)
    # u = u_measured + u x ε
    by_error[:6, places["vertical"]] = GRAVITY * _by_specific_force(forces, _estimated_trunk(forces, up)) @ skew(up)
    by_error[np.arange(6, len(matrix)), torque.start + swing] = 1.0
    value[:6] = forces.wrench - forces.weights.own @ (GRAVITY * up)
    value[6:] = forces.left[swing]
    white, slope = forces_of.noise.torque_white**2 / count, wrench_slope(forces)
    covariance = np.eye(len(matrix)) * (forces_of.noise.repeatable * robot.mass * GRAVITY) ** 2
    covariance[:6, :6] += (slope[:, torque] * white) @ slope[:, torque].T
    if effort_covariance is not None and count >= fewest:
        scatter = slope[:, torque] @ effort_covariance[np.ix_(body.in_legs, body.in_legs)] @ slope[:, torque].T
        covariance[:6, :6] = _at_least(covariance[:6, :6], scatter)
    covariance[:6, :6] += foot_variance * slope[:, places["foot"]] @ slope[:, places["foot"]].T
    covariance[6:, 6:] += np.diag(white[swing])
    root = np.linalg.cholesky(covariance)
    linear_at = errors.copy()
    linear_at[places["link_mass"]] = 0.0  # not subtracted from the measurement: the equations are linear in them
    target = by_error @ linear_at - value
    matrix, target = np.linalg.solve(root, matrix), np.linalg.solve(root, target)
    if m.vertical_by_forces:  # projected onto the complement of the vertical's two columns
        tilt = matrix[:, 4:][:, places["vertical"]] @ _across(up)
        rest = np.linalg.qr(tilt, mode="complete")[0][:, 2:].T
        matrix, target = rest @ matrix, rest @ target
        matrix[:, 4:][:, places["vertical"]] = 0.0
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


def _without(m: Measurement, errors: Array, forces_of: NoisyForces, places: Unknowns) -> tuple[Measurement, Array]:
    """The measurement at rest after subtracting these errors, and its vertical."""
    effort, foot, turn = m.effort.copy(), errors[places["foot"]].reshape(-1, 3), errors[places["vertical"]]
    effort[forces_of.body.in_legs] -= errors[places["torque"]]
    up = m.up - np.cross(turn, m.up)
    if m.vertical_by_forces:
        still, stance = np.zeros_like(m.effort)[None], None if m.stance is None else m.stance[None]
        up = vertical_by_forces(forces_of.robot, m.joint_position[None], still, effort[None], stance)[0][0]
    up /= np.linalg.norm(up)
    feet = m.foot_position
    if foot.any():
        feet = (forces_of.at(m).feet if feet is None else feet) - foot
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


def _estimated_trunk(forces: ContactForces, up: Array) -> Array:
    """Mass and first moment (4,) of the trunk from this pose alone, zero along the vertical; used for derivatives."""
    weights, (force, moment) = forces.weights, np.split(forces.wrench, 2)
    mass = float(up @ force) / GRAVITY - weights.own[0, 0]
    return np.array([mass, *(np.cross(up, moment) / GRAVITY - weights.moment)])


def felt_by_mass(forces: ContactForces, measurement: Measurement, robot: Robot) -> Array:
    """Error (k,) of the trunk's mass [kg] per unit of the constant errors; that of the vertical has no effect.

    If the vertical is computed from the forces, the errors tilt it as well.
    """
    up = measurement.up
    if measurement.vertical_by_forces:
        return np.asarray(weight_felt(forces, robot, up)[0])
    return np.asarray(up @ error_slope(forces, robot, up)[:3] / GRAVITY)
