"""Whether the trunk may lie on the ground, which then carries a part of it that no leg feels."""

from __future__ import annotations

import numpy as np

from stadera.body.statics import foot_positions
from stadera.robot.model import Robot, Shape
from stadera.types import Array

LOW = 0.1
"""Clearance of the trunk over the feet below which it may lie on the ground, share of the leg's length [1]. Shapes of
trunks are coarse, and robots crouch to half of their legs' length.
"""


def lying(robot: Robot, position: Array, up: Array) -> Array:
    """Which of some postures have the trunk's lowest point at the height of the feet's lowest.

    Args:
        position: (n, joints) [rad], in the tree's order.
        up: (n, 3), the vertical in trunk axes.

    Returns:
        (n,) bool.
    """
    lowest = np.min([_lowest(shape, up) for shape in robot.shapes if shape.link == robot.trunk], axis=0)
    feet = np.einsum("nli,ni->nl", foot_positions(robot, position), up)
    ground = (feet - np.array([leg.foot_radius for leg in robot.legs])).min(axis=1)
    return np.asarray(lowest - ground < LOW * robot.leg_length)


def _lowest(shape: Shape, up: Array) -> Array:
    """Least height (n,) [m] of a shape's points along unit vectors (n, 3), in its link's frame."""
    along = up @ shape.rotation
    match shape.kind:
        case "box":
            reach = 0.5 * np.abs(along) @ np.array(shape.size)
        case "sphere":
            reach = np.full(len(up), shape.size[0])
        case "capsule":
            reach = shape.size[0] + 0.5 * shape.size[1] * np.abs(along[:, 2])
        case "cylinder":
            across = np.sqrt(np.maximum(1.0 - along[:, 2] ** 2, 0.0))
            reach = shape.size[0] * across + 0.5 * shape.size[1] * np.abs(along[:, 2])
    return np.asarray(up @ shape.translation - reach)
