"""Statics of a quadruped's legs over many samples: kinematics, contact points, and joint torques due to weight.

Each leg has three joints and a point foot. A point r fixed to the last link moves, for each joint at o_j with axis s_j,
by s_j x (r - o_j). All vectors are in the trunk frame. Arrays have components first, (3, samples, leg,
joint). `stadera.body.tree` adds motion; `stadera.body.instant` evaluates a single sample, as a 1 kHz controller needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from stadera.body.friction import JointFriction, joint_columns
from stadera.constants import SINGULAR
from stadera.robot.kinematics import checked_angles, forward_kinematics
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class LegPose:
    """Pose of the legs at some samples, trunk frame; legs in the robot's order, joints from the trunk outwards."""

    turn: Array  # (3, 3, samples, 4, 3), rotation from the links' axes to the trunk's
    joints: Array  # (3, samples, 4, 3) [m], positions of the joints, which are the links' origins
    axis: Array  # (3, samples, 4, 3), unit vectors of the joints
    feet: Array  # (3, samples, 4) [m], centres of the feet

    def jacobians(self, points: Array) -> Array:
        """J (3, samples, 4, 3) [m/rad] of points (3, samples, 4) [m] fixed to the legs' last links."""
        return cross(self.axis, points[..., None] - self.joints)


class LegModel:
    """Geometry, mass and friction of a robot's legs.

    Attributes:
        columns: (4, 3), index of each leg's joints in the tree's order.
        friction: of the joints, by leg.
        radius: of the feet [m]. link_mass: (4, 3) [kg], of the links, by leg. leg_mass: [kg], of all legs.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self.columns, self.friction = robot, joint_columns(robot), JointFriction.of(robot)
        self.radius = np.array([leg.foot_radius for leg in robot.legs])
        bodies = np.array([[robot.inertias[link].vector for link in leg.links] for leg in robot.legs])
        self.link_mass, self._com = bodies[..., 0], bodies[..., 1:4] / bodies[..., :1]
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
        tree, q = self.robot.tree, np.zeros((len(position), len(self.robot.tree.joints)))
        q[:, self.columns] = position
        rotations, translations = forward_kinematics(tree, q)
        turn, joints = rotations[:, self.columns + 1], translations[:, self.columns + 1]
        foot = np.array([leg.foot_position for leg in self.robot.legs])
        feet = joints[:, :, 2] + (turn[:, :, 2] @ foot[..., None])[..., 0]
        axis = (turn @ tree.axes[self.columns][..., None])[..., 0]
        first = (np.ascontiguousarray(np.moveaxis(values, -1, 0)) for values in (joints, axis, feet))
        return LegPose(np.moveaxis(turn, (3, 4), (0, 1)), *first)

    def contacts(self, feet: Array, normal: Array) -> Array:
        """Contact points of foot spheres at feet (3, samples, 4) [m] with a ground of unit normal (3, samples)."""
        return np.asarray(feet - self.radius * normal[:, :, None])

    def centres(self, pose: LegPose) -> Array:
        """Centres of mass of the links (3, samples, 4, 3) [m]."""
        return np.asarray(pose.joints + np.einsum("ijnlk,lkj->inlk", pose.turn, self._com))

    def weight_torques(self, pose: LegPose) -> Array:
        """H (3, samples, 4, 3) [kg·m]: joint torques at rest, h = Σ_i H_i a_i for a specific force a (3,).

        Joint j bears the links k from it outwards, h_j = Σ_k m_k (s_j x (c_k - o_j)) · a.
        """
        carried = _outwards(self.link_mass * self.centres(pose))
        return cross(pose.axis, carried - _outwards(self.link_mass) * pose.joints)

    def forces_at_rest(
        self, position: Array, effort: Array, specific_force: Array, unfelt: float = 1e-3
    ) -> tuple[Array, Array]:
        """Contact forces [N] of a robot at rest from its joint torques, f = J^-T (h - τ), without friction, and points
        of contact [m], both (samples, 4, 3), trunk frame.

        Args:
            position, effort: (samples, 4, 3) [rad, N·m], by leg.
            specific_force: (samples, 3) [m/s²], trunk axes; the feet's spheres touch the ground along it.
            unfelt: share of J's largest singular value below which a direction does not affect the torques, and gets no
                force (least squares).
        """
        up, pose = specific_force / np.linalg.norm(specific_force, axis=1, keepdims=True), self.pose(position)
        contact = self.contacts(pose.feet, up.T)
        transposed = pose.jacobians(contact).transpose(1, 2, 3, 0)
        torque = np.einsum("inlk,ni->nlk", self.weight_torques(pose), specific_force) - effort
        force = (np.linalg.pinv(transposed, rcond=unfelt) @ torque[..., None])[..., 0]
        return np.asarray(force), contact.transpose(1, 2, 0)


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


def cross(a: Array, b: Array) -> Array:
    """a x b, components first; what comes after the components may broadcast."""
    a, b = np.concatenate((a, a[:2])), np.concatenate((b, b[:2]))  # x y z x y
    out = a[1:4] * b[2:]
    out -= a[2:] * b[1:4]
    return np.asarray(out)


def _outwards(values: Array) -> Array:
    """Sums over the links from each joint outwards, along the last axis."""
    return np.cumsum(values[..., ::-1], axis=-1)[..., ::-1]
