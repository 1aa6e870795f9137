"""Forward kinematics over arrays of configurations, in the trunk frame.

Joint i turns its link by q_i about its unit axis a_i, so with its fixed pose (R_i, p_i) in the parent link λ::

    R_link = R_λ R_i exp([a_i]x q_i),    p_link = p_λ + R_λ p_i
    exp([a]x q) = 1 + sin q [a]x + (1 - cos q) [a]x²                       (Rodrigues)
"""

import numpy as np
from numpy.typing import ArrayLike

from stadera.errors import ModelError
from stadera.inertia import skew
from stadera.robot.model import Robot, Tree
from stadera.types import Array


def forward_kinematics(tree: Tree, q: ArrayLike) -> tuple[Array, Array]:
    """Poses of all links in the trunk frame, for joint angles q (N, n) [rad] in the tree's order, else ModelError.

    Returns rotations (N, n + 1, 3, 3) and translations (N, n + 1, 3) [m] of the links' frames; the trunk's are identity
    and zero.
    """
    angles = checked_angles(tree, q)
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
