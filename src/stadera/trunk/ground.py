"""The normal of the ground under a robot, in trunk axes, from the contact points of its feet.

Of one that stands it is that of the polygon of its feet, which has the area ½ Σ p_i x p_i+1, a vector.

Of one that walks, the line d between two loaded feet lies in the ground's plane (for feet of equal radius). The sum of
d dᵀ over such lines, rotated with the trunk by the gyro and exponentially forgotten, has the normal as its eigenvector
of least eigenvalue; in a trot both diagonals contribute every half period. Directions that they leave open, after a
start or on one diagonal, are set by the vertical: the specific force averaged over a second, rotated in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, exp, sqrt

import numpy as np

from stadera.compiled import compiled
from stadera.inertia import skew
from stadera.types import Array, Bools


@dataclass(frozen=True)
class GroundSettings:
    """Settings of the ground's normal under a walking robot.

    Attributes:
        memory: time over which lines between feet and the vertical are averaged [s].
        load: share of the robot's weight, along the vertical, above which a foot counts as loaded.
        level: weight of the vertical against one second of lines between feet.
    """

    memory: float = 1.0
    load: float = 0.08
    level: float = 1e-3


class GroundNormal:
    """The ground's normal, updated block by block.

    Args:
        weight: of the robot [N].
        settings: None for the defaults.

    Attributes:
        up: (3,), the vertical in trunk axes; None before the first block.
    """

    def __init__(self, weight: float, settings: GroundSettings | None = None) -> None:
        self._settings = settings or GroundSettings()
        self._least = self._settings.load * weight
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
            keep = exp(-duration / self._settings.memory)
            self.up += (1.0 - keep) * (along - self.up)
            self.up /= np.linalg.norm(self.up)
            self._lines = keep * (turn @ self._lines @ turn.T)
        level = np.eye(3) - np.outer(self.up, self.up)
        normal = np.linalg.eigh(self._lines + self._settings.level * level)[1][:, 0]
        if normal @ self.up < 0.0:
            normal = -normal
        back = 0.5 * duration * angular_velocity  # from the block's end to its middle
        return np.asarray(normal + skew(back) @ normal)

    def learn(self, feet: Array, force: Array, duration: float) -> None:
        """Updates the normal from the feet (legs, 3) [m] at a block's end and the forces on them (legs, 3) [N]."""
        assert self.up is not None
        carrying = feet[force @ self.up > self._least]
        lines = (carrying[:, None] - carrying).reshape(-1, 3)  # each twice, and of each foot to itself
        square = (lines * lines).sum(axis=1)
        weight = np.divide(0.5, square, out=np.zeros_like(square), where=square > 0.0)
        self._lines += (duration / self._settings.memory) * (lines.T * weight @ lines)


def turned(angular_velocity: Array, duration: float) -> Array:
    """Rotation that takes trunk components of a world-fixed vector to those `duration` [s] later."""
    turn = skew(-duration * angular_velocity)
    return np.asarray(np.eye(3) + turn + 0.5 * turn @ turn)


def ground_normal(feet: Array, stance: Bools, up: Array) -> Array:
    """Unit normal (..., 3) of the polygon of the feet in stance, in their order about its middle, on the side of `up`
    (..., 3). With fewer than three feet it is `up`.

    Args:
        feet: (..., L, 3) [m]; stance: (..., L).
    """
    points = np.ascontiguousarray(feet.reshape(-1, *feet.shape[-2:]))
    stands, out = np.ascontiguousarray(stance).reshape(points.shape[:2]), np.empty((len(points), 3))
    _normals(points, stands, np.ascontiguousarray(up).reshape(out.shape), out)
    return out.reshape(up.shape)


@compiled("void(float64[:,:,::1], boolean[:,::1], float64[:,::1], float64[:,::1])")
def _normals(feet: Array, stance: Bools, up: Array, out: Array) -> None:
    """Writes the normals (N, 3) of polygons of feet (N, L, 3); arguments as of `ground_normal`."""
    legs = feet.shape[1]
    angle, arm, across = np.empty(legs), np.empty((legs, 3)), np.empty((2, 3))
    for k in range(len(feet)):
        count, middle, flat = 0, np.zeros(3), 0
        for leg in range(legs):
            if stance[k, leg]:
                count += 1
                middle += feet[k, leg]
        for c in range(3):
            out[k, c] = up[k, c]
            if abs(up[k, c]) < abs(up[k, flat]):
                flat = c
        if count < 3:
            continue
        middle /= count
        for row in range(2):  # two directions across `up`
            for c in range(3):
                a, b = (c + 1) % 3, (c + 2) % 3
                to_a = across[0, a] if row else (1.0 if a == flat else 0.0)
                to_b = across[0, b] if row else (1.0 if b == flat else 0.0)
                across[row, c] = up[k, a] * to_b - up[k, b] * to_a
        count = 0
        for leg in range(legs):
            if not stance[k, leg]:
                continue
            x = y = 0.0
            for c in range(3):
                x += (feet[k, leg, c] - middle[c]) * across[0, c]
                y += (feet[k, leg, c] - middle[c]) * across[1, c]
            at, turn = count, atan2(y, x)
            while at > 0 and angle[at - 1] > turn:
                angle[at], arm[at] = angle[at - 1], arm[at - 1]
                at -= 1
            angle[at], arm[at] = turn, feet[k, leg] - middle
            count += 1
        area, along = np.zeros(3), 0.0
        for at in range(count):
            one, other = arm[at], arm[(at + 1) % count]
            for c in range(3):
                area[c] += one[(c + 1) % 3] * other[(c + 2) % 3] - one[(c + 2) % 3] * other[(c + 1) % 3]
        size = sqrt(area[0] ** 2 + area[1] ** 2 + area[2] ** 2)
        for c in range(3):
            along += area[c] * up[k, c]
        if size > 0.0:
            for c in range(3):
                out[k, c] = area[c] / (size if along >= 0.0 else -size)
