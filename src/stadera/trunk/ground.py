"""Estimates the normal of the ground under a walking robot, in trunk axes, from the contact points of its feet.

The line d between two loaded feet lies in the ground's plane (for feet of equal radius). The sum of d dᵀ over such
lines, rotated with the trunk by the gyro and exponentially forgotten, has the normal as its eigenvector of least
eigenvalue; in a trot both diagonals contribute every half period. Directions that they leave open, after a start or on
one diagonal, are set by the vertical: the specific force averaged over a second, rotated in the same way.
"""

from __future__ import annotations

from math import exp

import numpy as np

from stadera.inertia import skew
from stadera.types import Array

_MEMORY = 1.0  # s
LEAST_LOAD = 0.08  # of the robot's weight, along the vertical: above it a foot counts as loaded
_BELIEF = 1e-3  # weight of the vertical against one second of lines between feet


class GroundNormal:
    """The ground's normal, updated block by block.

    Args:
        weight: of the robot [N].

    Attributes:
        up: (3,), the vertical in trunk axes; None before the first block.
    """

    def __init__(self, weight: float) -> None:
        self._least = LEAST_LOAD * weight
        self._lines = np.zeros((3, 3))
        self.up: Array | None = None

    def ahead(self, specific_force: Array, angular_velocity: Array, duration: float) -> Array:
        """Predicts the normal (3,) in the middle of the next block from its duration [s] and mean IMU values (3,)."""
        along = specific_force / np.linalg.norm(specific_force)
        if self.up is None:
            self.up = along
        else:
            turn = turned(angular_velocity, duration)
            self.up = turn @ self.up
            self.up += (1.0 - exp(-duration / _MEMORY)) * (along - self.up)
            self.up /= np.linalg.norm(self.up)
            self._lines = exp(-duration / _MEMORY) * (turn @ self._lines @ turn.T)
        level = np.eye(3) - np.outer(self.up, self.up)
        normal = np.linalg.eigh(self._lines + _BELIEF * level)[1][:, 0]
        if normal @ self.up < 0.0:
            normal = -normal
        back = 0.5 * duration * angular_velocity  # from the block's end to its middle
        return np.asarray(normal + skew(back) @ normal)

    def learn(self, feet: Array, force: Array, duration: float) -> None:
        """Updates the normal from the feet (legs, 3) [m] at a block's end and the forces on them (legs, 3) [N]."""
        assert self.up is not None
        carrying = feet[force @ self.up > self._least]
        first, second = np.triu_indices(len(carrying), 1)
        lines = carrying[first] - carrying[second]
        lines = lines / np.linalg.norm(lines, axis=1, keepdims=True)
        self._lines += (duration / _MEMORY) * (lines.T @ lines)


def turned(angular_velocity: Array, duration: float) -> Array:
    """Rotation that takes trunk components of a world-fixed vector to those `duration` [s] later."""
    turn = skew(-duration * angular_velocity)
    return np.asarray(np.eye(3) + turn + 0.5 * turn @ turn)
