"""Forward kinematics over arrays of configurations, in the trunk frame.

Joint i turns its link by q_i about its unit axis a_i, so with its fixed pose (R_i, p_i) in the parent link λ::

    R_link = R_λ R_i exp([a_i]x q_i),    p_link = p_λ + R_λ p_i
    exp([a]x q) = 1 + sin q [a]x + (1 - cos q) [a]x²                       (Rodrigues)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from stadera.errors import ModelError
from stadera.inertia import skew
from stadera.types import Array

if TYPE_CHECKING:
    from stadera.robot.model import Leg, Robot, Tree


def forward_kinematics(tree: Tree, q: ArrayLike) -> tuple[Array, Array]:
    """Poses of all links in the trunk frame, for joint angles q (N, n) [rad] in the tree's order, else ModelError.

    Returns rotations (N, n + 1, 3, 3) and translations (N, n + 1, 3) [m] of the links' frames; the trunk's are identity
    and zero.
    """
    angles = checked_angles(tree, q)
    return link_poses(tree.parents, tree.rotations, tree.translations, tree.axes, angles)


def link_poses(
    parents: Sequence[int], rotations: Array, translations: Array, axes: Array, q: Array, slides: Sequence[bool] = ()
) -> tuple[Array, Array]:
    """The same of joints given as the arrays of a `Tree`; a joint that slides has its way [m] in q (N, n)."""
    samples, n = q.shape
    R, p = np.empty((samples, n + 1, 3, 3)), np.empty((samples, n + 1, 3))
    R[:, 0], p[:, 0] = np.eye(3), 0.0
    angles = np.where(slides, 0.0, q) if len(slides) else q
    sine, versine = np.sin(angles)[..., None, None], (1.0 - np.cos(angles))[..., None, None]
    for i, parent in enumerate(parents):
        K = skew(axes[i])
        R[:, i + 1] = R[:, parent] @ (rotations[i] @ (np.eye(3) + sine[:, i] * K + versine[:, i] * (K @ K)))
        p[:, i + 1] = p[:, parent] + R[:, parent] @ translations[i]
        if len(slides) and slides[i]:
            p[:, i + 1] += R[:, i + 1] @ axes[i] * q[:, i, None]
    return R, p


def leg_kinematics(tree: Tree, leg: Leg, q: Array) -> tuple[Array, Array, Array]:
    """Of a leg's own tree at angles q (N, n) [rad], trunk axes: rotation of its last link (N, 3, 3), centre of its foot
    (N, 3) [m], and the derivatives (N, n, 6) of the foot's place, then of the link's rotation.
    """
    rotations, translations = forward_kinematics(tree, q)
    foot = translations[:, -1] + rotations[:, -1] @ np.array(leg.foot_position)
    axes = (rotations[:, 1:] @ tree.axes[:, :, None])[..., 0]
    slope = np.concatenate([np.cross(axes, foot[:, None] - translations[:, 1:]), axes], axis=2)
    return rotations[:, -1], foot, slope


def foot_positions(robot: Robot, q: ArrayLike) -> Array:
    """Centres of the feet in the trunk frame [m], shape (N, legs, 3), legs in the robot's order; q is (N, n) [rad].
    Raises ModelError: q has another shape.
    """
    rotations, translations = forward_kinematics(robot.tree, q)
    last = [robot.tree.links.index(leg.links[-1]) for leg in robot.legs]
    feet = np.array([leg.foot_position for leg in robot.legs])
    return np.asarray(translations[:, last] + np.einsum("nlij,lj->nli", rotations[:, last], feet))


def checked_angles(tree: Tree, q: ArrayLike) -> Array:
    """Joint angles as an array (samples, joints). Raises ModelError: q has another shape."""
    angles = np.asarray(q, dtype=float)
    if angles.ndim != 2 or angles.shape[1] != len(tree.joints):
        raise ModelError(f"joint angles need shape (samples, {len(tree.joints)}), got {angles.shape}")
    return angles
