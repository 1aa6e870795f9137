"""Regressor with six rows for each sample in the trunk's ten parameters, whichever feet touch the ground.

Every leg has three joints and a point foot, so the force f of the ground on a foot follows from the leg's own joints,
in contact or not. With τ the torques of the actuators, h the torque required by the leg's rigid bodies, rotors and
friction in this motion, and J the Jacobian of the contact point for a held trunk::

    h = τ + Jᵀ f        =>        f = J^-T (h - τ)

The trunk's inertial wrench is that of the feet on the robot minus that of the legs' own inertia. With w_l the inertial
wrench of leg l and p_l its contact point, force above moment about the trunk's origin::

    A(a, α, ω) θ = b,        b = Σ_l [ f_l ; p_l x f_l ] - Σ_l w_l

All vectors are in trunk axes, and the trunk's motion enters only through its angular velocity ω, angular acceleration α
and specific force a: orientation, slope, direction of gravity and velocity are not needed. The columns e_k of J^-T are
(j_k+1 x j_k+2) / det J, so that with E_k = [e_k ; p x e_k]

    b = Σ_k E_k (h_k - τ_k) - Σ_l w_l

and E is the effect of a torque error on the rows, by which a leg near its singularity is weighted down.

**Contact point.** The foot is a sphere of radius r: p = p_foot - r n with n the ground's normal. A foot in the air has
f = 0 for any contact point, so one normal serves all feet.

**Accelerations.** Rows are linear in q̈ and α. Under a filter with weights w_k that are zero at both ends, central
differences of the velocities can be transferred to the weights,

    Σ_k w_k G_k (v_k+1 - v_k-1) / 2T = -Σ_k v_k (w_k+1 G_k+1 - w_k-1 G_k-1) / 2T

which is the momentum G v filtered by parts. So differentiating first and filtering the ROWS afterwards is exact, and
amplifies only noise that the filter removes. Filtering the signals first is not exact, since G depends on the legs'
posture.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stadera.legs.model import LegModel, cross, inverse_transposed, outwards, rotated, rotated_back
from stadera.robot.model import Robot
from stadera.types import Array

__all__ = ["BaseWrenchRegressor", "LegMotions", "LegWrenches", "LinkMotions", "cross"]


class LegMotions(NamedTuple):
    """Motion of the robot over some samples, components first."""

    # position, velocity, acceleration: (samples, 4, 3) of the joints, by leg, from the trunk outwards
    position: Array
    velocity: Array
    acceleration: Array
    # angular_velocity, angular_acceleration, specific_force: (3, samples), of the trunk, its origin and axes
    angular_velocity: Array
    angular_acceleration: Array
    specific_force: Array
    normal: Array  # (3, samples), unit vector of the ground's normal, trunk axes
    sliding: Array | None = None  # (samples, 4, 3), velocities that determine friction's direction; None for `velocity`


class LinkMotions(NamedTuple):
    """Motion of the links in trunk axes, (3, samples, 4, 3) by leg and link."""

    turn: Array  # (3, 3, samples, 4, 3), rotation from the links' axes to the trunk's
    joints: Array  # position of each link's joint [m]
    # angular_velocity, angular_acceleration: [rad/s], [rad/s²]
    angular_velocity: Array
    angular_acceleration: Array
    # force, moment: inertial force [N] and moment [N·m] of the link, the moment about the trunk's origin
    force: Array
    moment: Array


@dataclass(frozen=True, eq=False)
class LegWrenches:
    """Torques, inertial wrenches and contact maps of the legs (in the robot's order) at some samples, trunk axes."""

    torque: Array  # (samples, 4, 3) [N·m], h: required by rigid bodies, rotors, friction and offsets
    inertial: Array  # (6, samples, 4) [N, N·m], w_l: wrench of the legs' inertia about the trunk's origin
    to_wrench: Array  # (6, samples, 4, 3), E: wrench on the trunk for a unit of h - τ
    feet: Array  # (3, samples, 4) [m], centres of the feet
    volume: Array  # (samples, 4) [m³], det J: near zero where a leg is singular
    axis: Array  # (3, samples, 4, 3), unit vectors of the joints
    links: LinkMotions  # motion of each link, and its inertial wrench

    def target(self, effort: Array) -> Array:
        """b by leg (6, samples, 4), from efforts (samples, 4, 3) [N·m]."""
        felt = (self.to_wrench * (self.torque - effort)).sum(axis=-1)
        return np.asarray(felt - self.inertial)

    def forces(self, effort: Array) -> Array:
        """Contact forces (3, samples, 4) [N]."""
        return np.asarray((self.to_wrench[:3] * (self.torque - effort)).sum(axis=-1))


class BaseWrenchRegressor(LegModel):
    """Computes the rows of one robot, from inertias, rotors, friction and offsets of its model. `armature` is (4, 3, 1)
    [kg·m²].
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self.armature = np.array([[[robot.dynamics[j].armature] for j in leg.joints] for leg in robot.legs])

    def at(self, motion: LegMotions) -> LegWrenches:
        """The legs' side of the rows at some samples."""
        velocity, acceleration = (np.ascontiguousarray(x.transpose(1, 2, 0)) for x in motion[1:3])  # samples last
        turn, arm, origin, axis, feet = self.parts(motion.position.transpose(1, 2, 0))
        spin = axis * velocity
        # contributions of each joint to its link, summed up along the leg; `from_` is the previous link, first the
        # trunk
        omega, from_omega = _along(motion.angular_velocity, spin)
        alpha, from_alpha = _along(motion.angular_acceleration, cross(from_omega, spin) + axis * acceleration)
        swing = cross(from_alpha, arm) + cross(from_omega, cross(from_omega, arm))
        a, _ = _along(motion.specific_force, swing)
        force, moment = self._inertial(turn, omega, alpha, a, origin)
        carried_force, carried_moment = outwards(force, -2), outwards(moment, -2)
        rigid = (axis * (carried_moment - cross(origin, carried_force))).sum(axis=0)
        torque = (rigid + self.armature * acceleration).transpose(2, 0, 1)
        torque += self.friction.torque(motion.velocity, motion.sliding)
        contact = feet - self.radius[:, None] * motion.normal[:, None]
        dual, volume = inverse_transposed(cross(axis, contact[:, :, None] - origin), -2)
        to_wrench = np.concatenate([dual, cross(contact[:, :, None], dual)])
        inertial = np.concatenate([carried_force[:, :, 0], carried_moment[:, :, 0]])
        links = LinkMotions(
            turn.transpose(0, 1, 4, 2, 3), *(x.transpose(0, 3, 1, 2) for x in (origin, omega, alpha, force, moment))
        )
        return LegWrenches(
            torque,
            inertial.transpose(0, 2, 1),
            to_wrench.transpose(0, 3, 1, 2),
            feet.transpose(0, 2, 1),
            volume.T,
            axis.transpose(0, 3, 1, 2),
            links,
        )

    def by_links(self, wrenches: LegWrenches, weights: Array) -> Array:
        """Effect of errors of the links' masses and centres of mass on b, (k, 6, 48), in weighted sums over samples.

        A link whose ten parameters are all larger by a share ε has ε times its inertial force F and moment M about the
        trunk's origin added. If its mass is displaced by δ without rotation, about its joint at p and with its centre
        of mass at p + c,

            ΔF = m (α x δ + ω x (ω x δ)),    ΔM = δ x F + (p + c) x ΔF

        Link i hangs from the joints k ≤ i, so b changes by Σ_k≤i E_k s_k · (ΔM - p_k x ΔF) - [ΔF ; ΔM].

        Args:
            weights: (k, n), of the first n samples.

        Returns:
            Derivatives with respect to ε [1] of the twelve links, by leg, then to δ [m] along link axes, 3 by 12.
        """
        n = weights.shape[1]
        turn = wrenches.links.turn.transpose(0, 1, 3, 4, 2)[..., :n]
        E, s, at, omega, alpha, force, moment = (
            x.transpose(0, 2, 3, 1)[..., :n] for x in (wrenches.to_wrench, wrenches.axis, *wrenches.links[1:])
        )
        felt = np.concatenate([cross(at, s), s])[None] * E[:, None]  # s · (p x F) = (s x p) · F
        np.cumsum(felt, axis=-2, out=felt)
        felt -= np.eye(6)[..., None, None, None]
        effects = np.empty((6, 4, 4, 3, n))  # the wrench; ε and three axes; leg, link, samples
        effects[:3, 0], effects[3:, 0] = force, moment
        omega, mass = omega[:, None], self.link_mass[..., None]
        centre = at + rotated(turn, self.moment) / mass
        moved = mass * (cross(alpha[:, None], turn) + cross(omega, cross(omega, turn)))  # by link axis
        effects[:3, 1:], effects[3:, 1:] = moved, cross(turn, force[:, None]) + cross(centre[:, None], moved)
        # Σ over samples and components of the wrench, as one product for each link
        left = felt.transpose(2, 3, 0, 1, 4)[:, :, None] * weights[:, None, None]  # (leg, link, k, 6, 6, n)
        right = effects.transpose(2, 3, 0, 4, 1)  # (leg, link, 6, n, effects)
        total = left.reshape(4, 3, -1, 6 * n) @ right.reshape(4, 3, 6 * n, 4)
        return np.asarray(total.reshape(4, 3, -1, 6, 4).transpose(2, 3, 4, 0, 1).reshape(-1, 6, 48))

    def _inertial(self, turn: Array, omega: Array, alpha: Array, a: Array, origin: Array) -> tuple[Array, Array]:
        """Inertial force and moment about the trunk's origin of each link, (3, leg, link, samples)."""
        h = rotated(turn, self.moment)
        force = self.link_mass[..., None] * a + cross(alpha, h) + cross(omega, cross(omega, h))
        own_omega, own_alpha = rotated_back(turn, omega), rotated_back(turn, alpha)
        own = rotated(self.tensor, own_alpha) + cross(own_omega, rotated(self.tensor, own_omega))
        moment = cross(h, a) + rotated(turn, own) + cross(origin, force)
        return force, moment


def _along(trunk: Array, added: Array) -> tuple[Array, Array]:
    """For each link and the previous one: the trunk's (3, samples) plus the joints' (3, leg, joint, samples)."""
    chain = np.empty((3, 4, 4, added.shape[-1]))
    chain[:, :, 0], chain[:, :, 1:] = trunk[:, None], added
    np.cumsum(chain, axis=2, out=chain)
    return chain[:, :, 1:], chain[:, :, :3]
