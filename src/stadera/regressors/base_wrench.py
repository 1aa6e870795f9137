"""The trunk's ten parameters from what the legs feel: six rows an instant, whoever of the feet touches the ground.

Every leg has three joints and a point foot, so the force f of the ground on a foot follows from the leg's own joints,
in contact or not. With τ what the actuators do, h the torque that the leg's rigid bodies, rotors and friction take at
this motion, and J the Jacobian of the point that touches, for a trunk held still::

    h = τ + Jᵀ f        =>        f = J^-T (h - τ)

The wrench of the trunk's inertia is what the feet do to the robot, less what the legs' own inertia takes. With w_l the
inertial wrench of leg l and p_l its contact point, force above moment about the trunk's origin::

    A(a, α, ω) θ = b,        b = Σ_l [ f_l ; p_l x f_l ] - Σ_l w_l

All is in the trunk's axes, and the trunk's motion enters by its angular velocity ω, angular acceleration α and
specific force a alone: neither orientation, nor slope, nor the direction of gravity, nor velocity. The columns e_k of
J^-T are (j_k+1 x j_k+2) / det J, so that with E_k = [e_k ; p x e_k]

    b = Σ_k E_k (h_k - τ_k) - Σ_l w_l

and E is what a torque's error does to the rows: a leg near its singularity counts little by itself.

**Where the ground touches.** The foot is a sphere of radius r: p = p_foot - r n, n the ground's normal. A foot in
the air has f = 0 by whatever point, so one normal serves all.

**Accelerations.** Rows are linear in q̈ and α. Filtered with weights w_k that begin and end with zero, central
differences of the velocities go over to the weights,

    Σ_k w_k G_k (v_k+1 - v_k-1) / 2T = -Σ_k v_k (w_k+1 G_k+1 - w_k-1 G_k-1) / 2T

which is the momentum G v filtered by parts. So differentiating first and filtering the ROWS afterwards is exact, and
loud only in what is thrown away; filtering the signals first is not, for G depends on where the legs are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stadera.inertia import skew
from stadera.robot.model import Robot

Array = NDArray[np.float64]

STICTION_VELOCITY = 0.02
"""rad/s, over which Coulomb friction's sign is smoothed: above the noise of velocities that are averaged a little."""


class LegMotions(NamedTuple):
    """How the robot moves over some samples, components first: what rows are made of.

    Attributes:
        position, velocity, acceleration: (samples, 4, 3) of the joints, by leg, from the trunk outwards.
        angular_velocity, angular_acceleration, specific_force: (3, samples), of the trunk, its origin and axes.
        normal: (3, samples), unit vector of the ground's normal, trunk axes.
        sliding: (samples, 4, 3), velocities by which friction's direction is told; None for `velocity`.
    """

    position: Array
    velocity: Array
    acceleration: Array
    angular_velocity: Array
    angular_acceleration: Array
    specific_force: Array
    normal: Array
    sliding: Array | None = None


class LinkMotions(NamedTuple):
    """How links move, trunk axes, (3, samples, 4, 3) by leg and link.

    Attributes:
        turn: (3, 3, samples, 4, 3), from the links' axes to the trunk's.
        joints: [m], where each link's joint is.
        angular_velocity, angular_acceleration: [rad/s], [rad/s²].
        force, moment: [N], [N·m], that the link's inertia takes, the moment about the trunk's origin.
    """

    turn: Array
    joints: Array
    angular_velocity: Array
    angular_acceleration: Array
    force: Array
    moment: Array


@dataclass(frozen=True, eq=False)
class LegWrenches:
    """What the legs take and give at some samples, trunk axes; legs in the robot's order.

    Attributes:
        torque: (samples, 4, 3) [N·m], h: what rigid bodies, rotors, friction and offsets take.
        inertial: (6, samples, 4) [N, N·m], w_l: wrench of the legs' inertia about the trunk's origin.
        to_wrench: (6, samples, 4, 3), E: wrench on the trunk for a unit of h - τ.
        feet: (3, samples, 4) [m], centres of the feet.
        volume: (samples, 4) [m³], det J: near zero where a leg is singular.
        axis: (3, samples, 4, 3), unit vectors of the joints.
        links: how each link moves, and what it takes.
    """

    torque: Array
    inertial: Array
    to_wrench: Array
    feet: Array
    volume: Array
    axis: Array
    links: LinkMotions

    def target(self, effort: Array) -> Array:
        """b by leg (6, samples, 4), from efforts (samples, 4, 3) [N·m]."""
        felt = (self.to_wrench * (self.torque - effort)).sum(axis=-1)
        return np.asarray(felt - self.inertial)

    def forces(self, effort: Array) -> Array:
        """Contact forces (3, samples, 4) [N]."""
        return np.asarray((self.to_wrench[:3] * (self.torque - effort)).sum(axis=-1))

    def by_contact(self, force: Array, shift: Array) -> Array:
        """How b changes when each contact point lies elsewhere, (6, samples).

        A force f that acts at p + δ turns joint k by s_k · (δ x f) more, and the trunk by δ x f::

            δb = Σ_legs [0 ; δ x f] - Σ_k E_k s_k · (δ x f)

        Args:
            force: (3, samples, 4) [N], as by `forces`.
            shift: (3, samples) [m], δ of every foot.
        """
        moment = cross(shift[:, :, None], force)
        change = -(self.to_wrench * (self.axis * moment[..., None]).sum(axis=0)).sum(axis=(2, 3))
        change[3:] += moment.sum(axis=2)
        return np.asarray(change)


class BaseWrenchRegressor:
    """Makes the rows of one robot. All arrays are components first, which keeps each operation on whole vectors.

    Args:
        robot: whose legs are believed in: inertias, rotors, friction and offsets of the joints.

    Attributes:
        columns: (4, 3), where each leg's joints are in the tree's order.
        leg_mass: [kg], of all legs.
        coulomb: (4, 3) [N·m], friction of the joints, by leg.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        tree = robot.tree
        index = np.array([[tree.joints.index(joint) for joint in leg.joints] for leg in robot.legs])
        self.columns = index
        K = np.array([[skew(tree.axes[j]) for j in leg] for leg in index])  # (leg, joint, 3, 3)
        fixed = tree.rotations[index]
        # to the parent's axes by B0 + sin q B1 + (1 - cos q) B2; all components first, (..., 1, leg, joint)
        self._turns = [_first(fixed), _first(fixed @ K), _first(fixed @ K @ K)]
        self._arms, self._axes = _first(tree.translations[index]), _first(tree.axes[index])
        self._foot = _first(np.array([leg.foot_position for leg in robot.legs])[:, None])[..., 0]
        self._radius = np.array([leg.foot_radius for leg in robot.legs])
        bodies = np.array([[robot.inertias[link].vector for link in leg.links] for leg in robot.legs])
        self._mass = bodies[..., 0]
        self._moment, self._tensor = _first(bodies[..., 1:4]), _first(bodies[..., [[4, 5, 6], [5, 7, 8], [6, 8, 9]]])
        dynamics = [[robot.dynamics[joint] for joint in leg.joints] for leg in robot.legs]
        self._joint_side = np.array(
            [[[d.armature, d.viscous, d.coulomb, d.offset] for d in leg] for leg in dynamics]
        ).transpose(2, 0, 1)
        self.leg_mass = float(self._mass.sum())
        self.coulomb = np.asarray(self._joint_side[2])

    @cached_property
    def length(self) -> float:
        """Of the shortest leg, hip to foot when stretched [m]."""
        thigh = np.linalg.norm(self._arms[:, 0, :, 2], axis=0)
        return float((thigh + np.linalg.norm(self._foot[:, 0], axis=0)).min())

    def at(self, motion: LegMotions) -> LegWrenches:
        """The legs' side of the rows at some samples."""
        turn, arm = self._placed(motion.position)
        axis = _rotated(turn, self._axes)
        origin = np.cumsum(arm, axis=-1)
        spin = axis * motion.velocity
        # what a joint adds to its link, summed up along the leg; `from_` is the link before, the trunk for the first
        omega, from_omega = _along(motion.angular_velocity, spin)
        alpha, from_alpha = _along(motion.angular_acceleration, cross(from_omega, spin) + axis * motion.acceleration)
        swing = cross(from_alpha, arm) + cross(from_omega, cross(from_omega, arm))
        a, _ = _along(motion.specific_force, swing)
        force, moment = self._inertial(turn, omega, alpha, a, origin)
        inwards = slice(None, None, -1)  # joint j carries the links from j outwards
        carried_force = np.cumsum(force[..., inwards], axis=-1)[..., inwards]
        carried_moment = np.cumsum(moment[..., inwards], axis=-1)[..., inwards]
        torque = (axis * (carried_moment - cross(origin, carried_force))).sum(axis=0)
        armature, viscous, coulomb, offset = self._joint_side
        torque += armature * motion.acceleration + viscous * motion.velocity + offset
        if coulomb.any():
            sliding = motion.velocity if motion.sliding is None else motion.sliding
            torque += coulomb * np.tanh(sliding / STICTION_VELOCITY)
        feet = origin[..., 2] + _rotated(turn[..., 2], self._foot)
        contact = feet - self._radius * motion.normal[:, :, None]
        to_wrench, volume = _inverse_transposed(axis, origin, contact)
        inertial = np.concatenate([carried_force[..., 0], carried_moment[..., 0]])
        links = LinkMotions(turn, origin, omega, alpha, force, moment)
        return LegWrenches(torque, inertial, to_wrench, feet, volume, axis, links)

    def by_links(self, wrenches: LegWrenches, samples: int) -> Array:
        """What errors of the links' masses and centres of mass do to b, (samples, 6, 48), of the first samples.

        A link whose ten parameters are all larger by a share ε takes ε times its own inertial force F and moment M
        about the trunk's origin. With matter that lies elsewhere by δ, no differently turned, about its joint at p and
        its centre of mass at p + c,

            ΔF = m (α x δ + ω x (ω x δ)),    ΔM = δ x F + (p + c) x ΔF

        Link i hangs from the joints k ≤ i, so b changes by Σ_k≤i E_k s_k · (ΔM - p_k x ΔF) - [ΔF ; ΔM].

        Returns:
            per unit of ε [1] of the twelve links, by leg, then of δ [m] along link axes, 3 by 12.
        """
        links, n = wrenches.links, samples
        at, turn = links.joints[:, :n], links.turn[:, :, :n]
        force, moment = links.force[:, :n], links.moment[:, :n]
        E, s = wrenches.to_wrench[:, :n], wrenches.axis[:, :n]
        felt = np.concatenate([cross(at, s), s])[None] * E[:, None]  # s · (p x F) = (s x p) · F
        np.cumsum(felt, axis=-1, out=felt)
        felt -= np.eye(6)[..., None, None, None]
        effects = np.empty((6, 4, n, 4, 3))  # the wrench; ε and three axes; samples, leg, link
        effects[:3, 0], effects[3:, 0] = force, moment
        omega, alpha = links.angular_velocity[:, :n], links.angular_acceleration[:, :n]
        centre = at + _rotated(turn, self._moment) / self._mass
        for axis in range(3):
            shift = turn[:, axis]
            moved = self._mass * (cross(alpha, shift) + cross(omega, cross(omega, shift)))
            effects[:3, 1 + axis], effects[3:, 1 + axis] = moved, cross(shift, force) + cross(centre, moved)
        return np.asarray(np.einsum("wvnlk,vtnlk->nwtlk", felt, effects).reshape(n, 6, 48))

    def _placed(self, position: Array) -> tuple[Array, Array]:
        """Rotations (3, 3, samples, leg, joint) of the links, and where each joint lies from the one before."""
        local = self._turns[0] + np.sin(position) * self._turns[1] + (1.0 - np.cos(position)) * self._turns[2]
        turn, arm = np.empty_like(local), np.empty(local.shape[1:])
        turn[..., 0], arm[..., 0] = local[..., 0], self._arms[..., 0]
        for j in (1, 2):
            arm[..., j] = _rotated(turn[..., j - 1], self._arms[..., j])
            turn[..., j] = np.einsum("ikns,kjns->ijns", turn[..., j - 1], local[..., j])
        return turn, arm

    def _inertial(self, turn: Array, omega: Array, alpha: Array, a: Array, origin: Array) -> tuple[Array, Array]:
        """Inertial force and moment about the trunk's origin of each link, (3, samples, leg, link)."""
        h = _rotated(turn, self._moment)
        force = self._mass * a + cross(alpha, h) + cross(omega, cross(omega, h))
        own_omega, own_alpha = _rotated_back(turn, omega), _rotated_back(turn, alpha)
        own = _rotated(self._tensor, own_alpha) + cross(own_omega, _rotated(self._tensor, own_omega))
        moment = cross(h, a) + _rotated(turn, own) + cross(origin, force)
        return force, moment


def cross(a: Array, b: Array) -> Array:
    """a x b, components first; what comes after the components may broadcast."""
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


def _first(values: Array) -> Array:
    """(leg, joint, ...) to (..., 1, leg, joint)."""
    return np.ascontiguousarray(np.moveaxis(values, (0, 1), (-2, -1))[..., None, :, :])


def _along(trunk: Array, added: Array) -> tuple[Array, Array]:
    """Of each link and of the one before: the trunk's (3, samples) and what joints add (3, samples, leg, joint)."""
    chain = np.empty((*added.shape[:-1], 4))
    chain[..., 0], chain[..., 1:] = trunk[:, :, None], added
    np.cumsum(chain, axis=-1, out=chain)
    return chain[..., 1:], chain[..., :3]


def _rotated(R: Array, v: Array) -> Array:
    return np.asarray(R[:, 0] * v[0] + R[:, 1] * v[1] + R[:, 2] * v[2])


def _rotated_back(R: Array, v: Array) -> Array:
    return np.asarray(R[0] * v[0] + R[1] * v[1] + R[2] * v[2])


def _inverse_transposed(axis: Array, at: Array, contact: Array) -> tuple[Array, Array]:
    """E (6, samples, leg, joint) and det J (samples, leg); E is infinite where a leg is singular."""
    J = cross(axis, contact[..., None] - at)
    dual = cross(J[..., [1, 2, 0]], J[..., [2, 0, 1]])
    volume = (J[..., 0] * dual[..., 0]).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        dual /= volume[..., None]
    return np.concatenate([dual, cross(contact[..., None], dual)]), volume
