"""A legged robot as a floating tree with contacts, and its dynamics at many samples.

A leg with contact forces f obeys h = τ + Jᵀ f, with τ the torques of the actuators, h what its rigid bodies, rotors and
friction need in this motion, and J the Jacobian of its contact for a held trunk. A leg has at least as many joints as
its contact has components, three for a point and six for a flat foot, so the force follows from its own joints, in
contact or not, f = J^-T (h - τ). Five joints do not tell the moment about one axis of a flat foot, nor two joints the
force along one axis of a point foot: it is taken to be zero, as of one more joint there without mass, and
`State.unfelt` is what a unit of it does. The trunk's inertial wrench is that of the contacts minus that of all other
links' own inertia. With w_j the inertial wrench of link j and p_l the
contact of leg l, force above moment about the trunk's origin,

    A(a, α, ω) θ = b,      b = Σ_l [f_l ; m_l + p_l x f_l] - Σ_j w_j = Σ_k E_k (h_k - τ_k) - Σ_j w_j

over the joints k of all legs and all links j but the trunk. The columns E_k are the trunk's wrench for a unit of torque
at joint k; by them a leg near its singularity is weighted down. All vectors are in trunk axes, and the trunk's motion
enters only through its angular velocity ω, angular acceleration α and specific force a: orientation, slope, direction
of gravity and velocity are not needed.

A point foot is a sphere of radius r: p = p_foot - r n with n the ground's normal. A foot in the air has f = 0 for any
contact point, so one normal serves all feet. Joints outside the legs (arms, a head, a turning lidar) move as they are
logged, and their links' wrenches are part of Σ_j w_j.

Rows are linear in q̈ and α. Under a filter with weights w_k that are zero at both ends, central differences of the
velocities can be transferred to the weights,

    Σ_k w_k G_k (v_k+1 - v_k-1) / 2T = -Σ_k v_k (w_k+1 G_k+1 - w_k-1 G_k-1) / 2T

which is the momentum G v filtered by parts. So differentiating first and filtering the ROWS afterwards is exact, and
amplifies only noise that the filter removes. Filtering the signals first is not exact, since G depends on the legs'
posture.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stadera.body.friction import direction
from stadera.body.kernel import evaluate
from stadera.errors import ModelError
from stadera.inertia import skews
from stadera.robot.model import Robot
from stadera.types import Array, Bools


class Motion(NamedTuple):
    """Motion of a robot at N samples, in trunk axes.

    Attributes:
        position, velocity, acceleration: (N, n) of all joints of a `Body` [rad or m, ...].
        angular_velocity, angular_acceleration, specific_force: (N, 3), of the trunk, at its origin.
        normal: (3,) or (N, 3), unit vector of the ground's normal.
    """

    position: Array
    velocity: Array
    acceleration: Array
    angular_velocity: Array
    angular_acceleration: Array
    specific_force: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class State:
    """Dynamics of a robot at N samples: n joints, L legs.

    Attributes:
        torque: (N, n) [N·m], h without friction: of rigid bodies and rotors.
        inertial: (N, L + 1, 6) [N, N·m], wrenches of the links of each leg and, last, of all other links.
        to_wrench: (N, n, 6), E; zero for joints outside the legs.
        columns: (N, n, 6, 10), derivatives of b by the ten parameters of each link; empty if not asked for.
        unfelt: (N, L, 6), the trunk's wrench for a unit of the contact's moment about or force along `Body.about`; zero
            of other legs.
        feet: (N, L, 3) [m], centres of the feet. pace: (N, L, 3) [m/s], ω x p + J q̇.
        volume: (N, L), det J, near zero where a leg is singular.
        origin, axis: (N, n, 3), of the joints.
    """

    torque: Array
    inertial: Array
    to_wrench: Array
    columns: Array
    unfelt: Array
    feet: Array
    pace: Array
    volume: Array
    origin: Array
    axis: Array


@dataclass(frozen=True, eq=False)
class Body:
    """A floating tree with contacts. Joints are in topological order.

    Attributes:
        joints: their names. parents: (n,), the joint whose link carries each; n for the trunk.
        rotations, translations, axes: (n, 3, 3), (n, 3) and (n, 3), pose of each joint in its parent link at zero [m],
            and unit vector. slides: (n,), True for a prismatic joint.
        parameters: (n, 10), of each joint's link, in its frame.
        armature, viscous, coulomb, offset: (n,) [kg·m², N·m·s/rad, N·m, N·m], of the joints; zero outside the tree.
        legs: joints of each leg, from the trunk outwards.
        sizes: (L,), components of each leg's contact, 3 or 6. points: (L, 3) [m], in the last link; radii: (L,) [m].
        about: (L, 3), in the last link, `Leg.unfelt`.
        lumped: (10,), links outside the legs that the trunk's parameters contain at a reference position.

    Raises:
        ModelError: a leg with too few joints for the components of its contact.
    """

    joints: tuple[str, ...]
    parents: NDArray[np.int64]
    rotations: Array
    translations: Array
    axes: Array
    slides: Bools
    parameters: Array
    armature: Array
    viscous: Array
    coulomb: Array
    offset: Array
    legs: tuple[tuple[int, ...], ...]
    sizes: NDArray[np.int64]
    points: Array
    radii: Array
    about: Array
    lumped: Array

    def __post_init__(self) -> None:
        for leg, size, about in zip(self.legs, self.sizes, self.about, strict=True):
            if len(leg) < size - about.any():
                named = ", ".join(self.joints[j] for j in leg)
                raise ModelError(f"a contact of {size} components needs as many joints; leg has {named}")

    @classmethod
    def of(cls, robot: Robot, others: bool = True) -> Body:
        """Of a robot: its tree's joints, then, if `others`, those of `Robot.extra`."""
        tree, extra, n = robot.tree, robot.extra if others else None, len(robot.tree.joints)
        total = n + (len(extra.joints) if extra is not None else 0)
        parents = [p - 1 if p > 0 else total for p in tree.parents]
        bodies = [robot.inertias[link].vector for link in tree.links[1:]]
        turns, arms, axes = [tree.rotations], [tree.translations], [tree.axes]
        slides, lumped = [False] * n, np.zeros(10)
        if extra is not None:
            parents += [n + p if p >= 0 else total for p in extra.parents]
            bodies += [body.vector for body in extra.bodies]
            turns, arms, axes = [*turns, extra.rotations], [*arms, extra.translations], [*axes, extra.axes]
            slides, lumped = slides + list(extra.sliding), extra.lumped.vector
        dynamics = np.array([astuple(robot.dynamics[joint]) for joint in tree.joints]).T
        dynamics = np.pad(dynamics, ((0, 0), (0, total - n)))
        return cls(
            tree.joints + (extra.joints if extra is not None else ()),
            np.array(parents, dtype=np.int64),
            np.concatenate(turns),
            np.concatenate(arms),
            np.concatenate(axes),
            np.array(slides),
            np.array(bodies),
            dynamics[0],
            dynamics[1],
            dynamics[2],
            dynamics[3],
            tuple(tuple(tree.joints.index(joint) for joint in leg.joints) for leg in robot.legs),
            np.array([leg.contact for leg in robot.legs], dtype=np.int64),
            np.array([leg.foot_position for leg in robot.legs], dtype=float),
            np.array([leg.foot_radius for leg in robot.legs], dtype=float),
            np.array([leg.unfelt for leg in robot.legs], dtype=float),
            np.array(lumped),
        )

    @cached_property
    def leg_of(self) -> NDArray[np.int64]:
        """The leg of each joint, (n,); L for one outside the legs."""
        out = np.full(len(self.joints), len(self.legs))
        for k, leg in enumerate(self.legs):
            out[list(leg)] = k
        return out

    @cached_property
    def in_legs(self) -> NDArray[np.int64]:
        """The joints of all legs, leg by leg."""
        return np.concatenate([np.array(leg, dtype=np.int64) for leg in self.legs])

    @cached_property
    def starts(self) -> list[int]:
        """Place of each leg's first joint in `in_legs`."""
        return [0, *np.cumsum([len(leg) for leg in self.legs])[:-1].tolist()]

    @cached_property
    def most(self) -> int:
        """Number of joints of the longest leg."""
        return max(len(leg) for leg in self.legs)

    @cached_property
    def _padded(self) -> NDArray[np.int64]:
        return np.array([[*leg, *[-1] * (self.most - len(leg))] for leg in self.legs], dtype=np.int64)

    @cached_property
    def _all_bear(self) -> Bools:
        return np.ones(len(self.legs), dtype=bool)

    def friction(self, velocity: Array, sliding: Array) -> Array:
        """Torque of friction and offsets (N, n) [N·m]; the velocities `sliding` determine Coulomb friction's direction
        (`stadera.body.friction`).
        """
        return np.asarray(self.viscous * velocity + self.offset + self.coulomb * direction(sliding))

    def left(self, state: State, motion: Motion, effort: Array) -> Array:
        """h - τ of the legs' joints (N, joints of the legs), friction included, from efforts (N, n or more)."""
        J = self.in_legs
        return np.asarray((state.torque + self.friction(motion.velocity, motion.velocity))[:, J] - effort[:, J])

    def contacts(self, state: State, left: Array) -> Array:
        """Wrenches of the contacts (N, L, 6) [N, N·m], of h - τ of the legs' joints."""
        felt = state.to_wrench[:, self.in_legs] * left[..., None]
        return np.asarray(np.add.reduceat(felt, self.starts, axis=1))

    def target(self, state: State, contacts: Array) -> Array:
        """b (N, 6), of the contacts' wrenches; that of one leg is its contact's minus that of its links."""
        return np.asarray(contacts.sum(axis=1) - state.inertial.sum(axis=1))

    def by_contact(self, to_wrench: Array, axis: Array, force: Array) -> Array:
        """Derivatives (..., L, 6, 3) of the wrench of each leg's contact by its point of application.

        Moving the point of a force f by δ changes joint torque k by s_k · (δ x f) = (f x s_k) · δ and the moment on the
        trunk by δ x f. A contact that transmits moments has no such point.

        Args:
            to_wrench, axis: (..., J, 6) and (..., J, 3), E and s of the legs' joints. force: (..., L, 3) [N].
        """
        f = skews(force)  # f x s_k and f x δ
        across = f[..., self.leg_of[self.in_legs], :, :] @ axis[..., None]
        out = -np.add.reduceat(to_wrench[..., None] * across[..., None, :, 0], self.starts, axis=-3)
        out[..., 3:, :] -= f
        out[..., self.sizes == 6, :, :] = 0.0
        return np.asarray(out)

    def at(
        self, motion: Motion, columns: bool = False, contacts: Array | None = None, bears: Bools | None = None
    ) -> State:
        """The dynamics at some samples.

        Args:
            columns: compute `State.columns`.
            contacts: (N, L, 3) [m], of the contacts from the centres of the feet; None for the feet's spheres on a
                ground of the motion's normal.
            bears: (L,), legs whose contact forces act on the trunk, E = 0 of the others; None for all.
        """
        samples, n, legs = *motion.position.shape, len(self.legs)
        joints, trunk, offset = np.empty((samples, n, 3)), np.empty((samples, 3, 3)), np.empty((samples, legs, 3))
        for k in range(3):
            joints[:, :, k], trunk[:, k] = motion[k], motion[3 + k]
        if contacts is None:
            contacts = -self.radii[:, None] * motion.normal[..., None, :]
        offset[:] = contacts
        out = State(
            np.empty((samples, n)),
            np.empty((samples, legs + 1, 6)),
            np.empty((samples, n, 6)),
            np.empty((samples if columns else 0, n, 6, 10)),
            np.empty((samples, legs, 6)),
            np.empty((samples, legs, 3)),
            np.empty((samples, legs, 3)),
            np.empty((samples, legs)),
            np.empty((samples, n, 3)),
            np.empty((samples, n, 3)),
        )
        evaluate(
            self.parents,
            self.rotations,
            self.translations,
            self.axes,
            self.slides,
            self.parameters,
            self.leg_of,
            self._padded,
            self.sizes,
            self.points,
            self.about,
            self._all_bear if bears is None else bears,
            joints,
            trunk,
            offset,
            *vars(out).values(),
        )
        out.torque[:] += self.armature * motion.acceleration
        return out
