"""Forward kinematics over arrays of configurations, everything in the trunk frame.

Joint i turns its link by q_i about its unit axis a_i, so with its fixed pose (R_i, p_i) in the parent link λ::

    R_link = R_λ R_i exp([a_i]x q_i),    p_link = p_λ + R_λ p_i
    exp([a]x q) = 1 + sin q [a]x + (1 - cos q) [a]x²                       (Rodrigues)

A point r fixed to a link moves, for each joint j on the way to it, by ∂r/∂q_j = (R_j a_j) x (r - p_j).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from stadera.errors import ModelError
from stadera.inertia import skew
from stadera.robot.model import Array, Robot, Tree


def forward_kinematics(tree: Tree, q: ArrayLike) -> tuple[Array, Array]:
    """Poses of all links in the trunk frame.

    Args:
        tree: n joints, n + 1 links.
        q: joint angles in the tree's order [rad], shape (N, n).

    Returns:
        Rotations (N, n + 1, 3, 3) and translations (N, n + 1, 3) [m] of the links' frames; the trunk's are identity
        and zero.

    Raises:
        ModelError: q has another shape.
    """
    angles = _checked(tree, q)
    samples, n = angles.shape
    rotations, translations = np.empty((samples, n + 1, 3, 3)), np.empty((samples, n + 1, 3))
    rotations[:, 0], translations[:, 0] = np.eye(3), 0.0
    sine, versine = np.sin(angles)[..., None, None], (1.0 - np.cos(angles))[..., None, None]
    for i, parent in enumerate(tree.parents):
        K = skew(tree.axes[i])
        turned = tree.rotations[i] @ (np.eye(3) + sine[:, i] * K + versine[:, i] * (K @ K))
        rotations[:, i + 1] = rotations[:, parent] @ turned
        translations[:, i + 1] = translations[:, parent] + rotations[:, parent] @ tree.translations[i]
    return rotations, translations


def foot_positions(robot: Robot, q: ArrayLike) -> Array:
    """Centres of the feet in the trunk frame [m], shape (N, 4, 3), legs in the robot's order; q is (N, n) [rad]."""
    return _feet(robot, *forward_kinematics(robot.tree, q))


def foot_jacobians(robot: Robot, q: ArrayLike) -> Array:
    """Jacobians of the feet with respect to their own leg's three joints, trunk frame [m/rad], shape (N, 4, 3, 3).

    `foot velocity = J @ joint velocity` for a trunk that stands still; the last axis is HAA, HFE, KFE.
    """
    axes, origins = joint_axes(robot, q)
    return point_jacobians(axes, origins, foot_positions(robot, q))


def joint_axes(robot: Robot, q: ArrayLike) -> tuple[Array, Array]:
    """The legs' joints in the trunk frame: axes (N, 4, 3, 3) and origins [m] (N, 4, 3, 3), joints in the last axis."""
    rotations, translations = forward_kinematics(robot.tree, q)
    index = np.array([[robot.tree.joints.index(name) for name in leg.joints] for leg in robot.legs])
    axes = (rotations[:, 1:] @ robot.tree.axes[:, :, None])[..., 0]
    return np.swapaxes(axes[:, index], -1, -2), np.swapaxes(translations[:, 1:][:, index], -1, -2)


def point_jacobians(axes: ArrayLike, origins: ArrayLike, points: ArrayLike) -> Array:
    """Jacobians [m/rad] (N, 4, 3, 3) of points (N, 4, 3) [m] that move with the legs' last links; see `joint_axes`."""
    arms = np.asarray(points)[..., None] - np.asarray(origins)
    return np.cross(np.asarray(axes), arms, axis=-2)


def _feet(robot: Robot, rotations: Array, translations: Array) -> Array:
    last = [robot.tree.links.index(leg.links[2]) for leg in robot.legs]
    local = np.array([leg.foot_position for leg in robot.legs])
    feet: Array = translations[:, last] + (rotations[:, last] @ local[:, :, None])[..., 0]
    return feet


def _checked(tree: Tree, q: ArrayLike) -> Array:
    angles = np.asarray(q, dtype=float)
    if angles.ndim != 2 or angles.shape[1] != len(tree.joints):
        raise ModelError(f"joint angles need shape (samples, {len(tree.joints)}), got {angles.shape}")
    return angles
