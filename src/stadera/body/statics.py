"""Model of a robot's legs over many samples: kinematics, contact points, and joint torques due to the links' weight.

Each leg has three joints and a point foot. Joint j turns its link by q_j about its unit axis a_j, so with its fixed
pose (B, p) in the link before

    R_link = R_before B exp([a_j]x q_j),    exp([a]x q) = 1 + sin q [a]x + (1 - cos q) [a]x²       (Rodrigues)

A point r fixed to the last link moves, for each joint at o_j with axis s_j in trunk axes, by s_j x (r - o_j).

All vectors are in the trunk frame. Arrays have components first, (3, samples, leg, joint), so that each operation runs
over whole vectors; in memory the samples come last, (3, leg, joint, samples), since loops over three numbers are slow.
`stadera.body` adds velocities and accelerations; `stadera.body.instant` evaluates the
same model for a single sample with Pinocchio, as a 1 kHz controller needs: it takes 11 µs instead of 250.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stadera.body.friction import JointFriction, joint_columns
from stadera.constants import SINGULAR
from stadera.inertia import skew
from stadera.robot.kinematics import checked_angles, forward_kinematics
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class LegPose:
    """Pose of the legs at some samples, trunk frame; legs in the robot's order, joints from the trunk outwards."""

    turn: Array  # (3, 3, samples, 4, 3), rotation from the links' axes to the trunk's
    arms: Array  # (3, samples, 4, 3) [m], from the previous joint to each joint; from the trunk's origin to the first
    joints: Array  # (3, samples, 4, 3) [m], positions of the joints, which are the links' origins
    axis: Array  # (3, samples, 4, 3), unit vectors of the joints
    feet: Array  # (3, samples, 4) [m], centres of the feet

    @classmethod
    def of(cls, parts: PoseParts) -> LegPose:
        """From arrays with samples last."""
        arms, joints, axis = (part.transpose(0, 3, 1, 2) for part in parts[1:4])
        return cls(parts.turn.transpose(0, 1, 4, 2, 3), arms, joints, axis, parts.feet.transpose(0, 2, 1))

    def jacobians(self, points: Array) -> Array:
        """J (3, samples, 4, 3) [m/rad] of points (3, samples, 4) [m] fixed to the legs' last links."""
        return cross(self.axis, points[..., None] - self.joints)


class PoseParts(NamedTuple):
    """`LegPose` with samples last."""

    turn: Array
    arms: Array
    joints: Array
    axis: Array
    feet: Array


class LegStatics(NamedTuple):
    """Statics of the legs at some samples, trunk frame; samples last."""

    pose: PoseParts  # of the legs
    contact: Array  # (3, 4, samples) [m], points of contact
    jacobian: Array  # (3, 4, 3, samples) [m/rad], J of the points of contact, components first, then leg and joint
    to_force: Array  # (3, 4, 3, samples) [1/m], J^-T; in near-singular legs the least-squares inverse
    carried: Array  # (3, 4, 3, samples) [kg·m], H: joint torques at rest are h = Σ_i H_i a_i
    moment: Array  # (3, 4, samples) [kg·m], first moment of each leg

    def torque(self, specific_force: Array) -> Array:
        """h (4, 3, samples) [N·m] that the legs' weight requires at specific forces (samples, 3) [m/s²]."""
        return np.asarray((self.carried * specific_force.T[:, None, None]).sum(axis=0))

    def force(self, torque: Array) -> Array:
        """Contact forces (3, 4, samples) [N] for torques h - τ (4, 3, samples) [N·m]."""
        return np.asarray((self.to_force * torque).sum(axis=2))


class LegModel:
    """Geometry, mass and friction of a robot's legs.

    Attributes:
        columns: (4, 3), index of each leg's joints in the tree's order.
        friction: of the joints, by leg.
        turns, arms, axes: rotations, arms [m] and axes of the joints in the link before. foot, radius: of the feet [m].
        link_mass: (4, 3) [kg], of the links, by leg. moment, tensor: first moment and inertia about the joint, link
            axes. leg_mass: [kg], of all legs.
        length: of the shortest leg, hip to foot when fully extended [m].
        least_volume: det J [m³] below which a leg counts as singular.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self.columns, self.friction = robot, joint_columns(robot), JointFriction.of(robot)
        tree = robot.tree
        axes, fixed = tree.axes[self.columns], tree.rotations[self.columns]
        K = np.array([[skew(axis) for axis in leg] for leg in axes])  # (leg, joint, 3, 3)
        # rotation to the previous link's axes: B + sin q B K + (1 - cos q) B K²; constants are (..., leg, joint, 1)
        self.turns = [_last(fixed), _last(fixed @ K), _last(fixed @ K @ K)]
        self.arms, self.axes = _last(tree.translations[self.columns]), _last(axes)
        self.foot = _last(np.array([leg.foot_position for leg in robot.legs])[:, None])[:, :, 0]
        self.radius = np.array([leg.foot_radius for leg in robot.legs])
        bodies = np.array([[robot.inertias[link].vector for link in leg.links] for leg in robot.legs])
        self.link_mass = bodies[..., 0]
        self.moment, self.tensor = _last(bodies[..., 1:4]), _last(bodies[..., [[4, 5, 6], [5, 7, 8], [6, 8, 9]]])
        self.leg_mass = float(self.link_mass.sum())

    @staticmethod
    @lru_cache(maxsize=16)
    def of(robot: Robot) -> LegModel:
        """The model of a robot, cached."""
        return LegModel(robot)

    @property
    def length(self) -> float:
        """`Robot.leg_length`."""
        return self.robot.leg_length

    @property
    def least_volume(self) -> float:
        """det J [m³] below which a leg counts as singular."""
        return SINGULAR * self.length**3

    def pose(self, position: Array) -> LegPose:
        """Pose of the legs at joint angles (samples, 4, 3) [rad], by leg."""
        return LegPose.of(self.parts(position.transpose(1, 2, 0)))

    def parts(self, position: Array) -> PoseParts:
        """Pose with samples last, at joint angles (4, 3, samples) [rad]."""
        q = np.ascontiguousarray(position)
        local = self.turns[0] + np.sin(q) * self.turns[1] + (1.0 - np.cos(q)) * self.turns[2]
        turn, arm = np.empty_like(local), np.empty(local.shape[1:])
        turn[..., 0, :], arm[..., 0, :] = local[..., 0, :], self.arms[..., 0, :]
        for j in (1, 2):
            before, own = turn[..., j - 1, :], local[..., j, :]
            arm[..., j, :] = rotated(before, self.arms[..., j, :])
            np.multiply(before[:, 0, None], own[0], out=turn[..., j, :])
            for k in (1, 2):
                turn[..., j, :] += before[:, k, None] * own[k]
        joints = arm.copy()
        for j in (1, 2):
            joints[..., j, :] += joints[..., j - 1, :]
        feet = joints[..., 2, :] + rotated(turn[..., 2, :], self.foot)
        return PoseParts(turn, arm, joints, rotated(turn, self.axes), feet)

    def contacts(self, feet: Array, normal: Array) -> Array:
        """Contact points of foot spheres at feet (3, samples, 4) [m] with a ground of unit normal (3, samples)."""
        return np.asarray(feet - self.radius * normal[:, :, None])

    def centres(self, pose: LegPose) -> Array:
        """Centres of mass of the links (3, samples, 4, 3) [m]."""
        return np.asarray(pose.joints + rotated(pose.turn, np.moveaxis(self.moment, -1, 1)) / self.link_mass)

    def weight_torques(self, pose: LegPose) -> Array:
        """H (3, samples, 4, 3) [kg·m]: joint torques at rest, h = Σ_i H_i a_i for a specific force a (3,).

        Joint j bears the links k from it outwards, h_j = Σ_k m_k (s_j x (c_k - o_j)) · a.
        """
        carried = outwards(self.link_mass * self.centres(pose))
        return cross(pose.axis, carried - outwards(self.link_mass) * pose.joints)

    def statics(self, position: Array, up: Array, unfelt: float = 1e-3) -> LegStatics:
        """What the contact forces of a robot at rest follow from, besides its joint torques.

        Args:
            position: (samples, 4, 3) [rad], by leg.
            up: (samples, 3), unit vectors, trunk axes; the feet's spheres touch the ground along it.
            unfelt: share of J's largest singular value below which a direction does not affect the torques.
        """
        parts = self.parts(position.transpose(1, 2, 0))
        contact = parts.feet - self.radius[:, None] * up.T[:, None]
        jacobian = cross(parts.axis, contact[:, :, None] - parts.joints)
        mass = self.link_mass[..., None]
        first = outwards(mass * parts.joints + rotated(parts.turn, self.moment), -2)
        carried = cross(parts.axis, first - outwards(mass, -2) * parts.joints)
        return LegStatics(parts, contact, jacobian, _to_force(jacobian, unfelt), carried, first[:, :, 0])

    def forces_at_rest(
        self, position: Array, effort: Array, specific_force: Array, unfelt: float = 1e-3
    ) -> tuple[Array, Array]:
        """Contact forces [N] of a robot at rest from its joint torques, f = J^-T (h - τ), without friction, and points
        of contact [m], both (samples, 4, 3), trunk frame.

        In a near-singular leg, directions that do not affect the torques get no force (least squares).

        Args:
            position, effort: (samples, 4, 3) [rad, N·m], by leg.
            specific_force: (samples, 3) [m/s²], trunk axes; the feet's spheres touch the ground along it.
        """
        statics = self.statics(position, specific_force / np.linalg.norm(specific_force, axis=1, keepdims=True), unfelt)
        torque = statics.torque(specific_force) - effort.transpose(1, 2, 0)
        return statics.force(torque).transpose(2, 1, 0), statics.contact.transpose(2, 1, 0)


def foot_positions(robot: Robot, q: ArrayLike) -> Array:
    """Centres of the feet in the trunk frame [m], shape (N, legs, 3), legs in the robot's order; q is (N, n) [rad].
    Raises ModelError: q has another shape.
    """
    rotations, translations = forward_kinematics(robot.tree, q)
    last = [robot.tree.links.index(leg.links[-1]) for leg in robot.legs]
    feet = np.array([leg.foot_position for leg in robot.legs])
    return np.asarray(translations[:, last] + np.einsum("nlij,lj->nli", rotations[:, last], feet))


def nominal_feet(robot: Robot) -> Array:
    """Centres of the feet in the nominal stance, trunk frame [m], (4, 3), legs in the robot's order."""
    return np.asarray(foot_positions(robot, standing_configuration(robot)[None])[0])


def foot_jacobians(robot: Robot, q: ArrayLike) -> Array:
    """Jacobians of the feet with respect to their own leg's three joints (HAA, HFE, KFE, the last axis), trunk frame
    [m/rad], (N, 4, 3, 3): `foot velocity = J @ joint velocity` for a trunk that stands still. ModelError for another
    shape of q.
    """
    model = LegModel.of(robot)
    pose = model.pose(checked_angles(robot.tree, q)[:, model.columns])
    return np.ascontiguousarray(pose.jacobians(pose.feet).transpose(1, 2, 0, 3))


def inverse_transposed(jacobians: Array, axis: int = -1) -> tuple[Array, Array]:
    """J^-T (3, samples, leg, joint), and det J [m³] (samples, leg), the joints along `axis` of J.

    The columns of J^-T are (j_k+1 x j_k+2) / det J; infinite or NaN where a leg is singular.
    """
    J = jacobians
    dual = cross(J.take([1, 2, 0], axis), J.take([2, 0, 1], axis))
    volume = (J.take(0, axis) * dual.take(0, axis)).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        dual /= np.expand_dims(volume, axis)
    return dual, volume


def _to_force(jacobian: Array, unfelt: float) -> Array:
    """Least-squares inverses of J^T (3, leg, joint, samples).

    Where |J| |J^-1| < 1 / `unfelt` in Frobenius' norm, which bounds the ratio of the singular values from above, it is
    the inverse itself, which takes a tenth of the time.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        inverse, _ = inverse_transposed(jacobian, -2)
        regular = (jacobian**2).sum(axis=(0, 2)) * (inverse**2).sum(axis=(0, 2)) < unfelt**-2
    if not regular.all():
        leg, sample = np.nonzero(~regular)
        transposed = jacobian[:, leg, :, sample].transpose(0, 2, 1)
        inverse[:, leg, :, sample] = np.linalg.pinv(transposed, rcond=unfelt)
    return inverse


def cross(a: Array, b: Array) -> Array:
    """a x b, components first; what comes after the components may broadcast."""
    a, b = np.concatenate((a, a[:2])), np.concatenate((b, b[:2]))  # x y z x y
    out = a[1:4] * b[2:]
    out -= a[2:] * b[1:4]
    return np.asarray(out)


def rotated(R: Array, v: Array) -> Array:
    """R v, components first."""
    out = R[:, 0] * v[0]
    out += R[:, 1] * v[1]
    out += R[:, 2] * v[2]
    return np.asarray(out)


def rotated_back(R: Array, v: Array) -> Array:
    """Rᵀ v, components first."""
    out = R[0] * v[0]
    out += R[1] * v[1]
    out += R[2] * v[2]
    return np.asarray(out)


def outwards(values: Array, axis: int = -1) -> Array:
    """Sums over the links from each joint outwards, along their axis."""
    out = np.array(values, order="K")
    links = np.moveaxis(out, axis, 0)
    for k in range(len(links) - 2, -1, -1):  # a cumulative sum along an axis that is not the last is slow
        links[k] += links[k + 1]
    return out


def _last(values: Array) -> Array:
    """(leg, joint, ...) to (..., leg, joint, 1)."""
    return np.ascontiguousarray(np.moveaxis(values, (0, 1), (-2, -1))[..., None])
