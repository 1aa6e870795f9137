"""The normal of the ground under a robot, in trunk axes, from the contact points of its feet.

Of one that stands it is that of the polygon of its feet, which has the area ½ Σ p_i x p_i+1, a vector.

Of one that walks, the line d between two loaded feet lies in the ground's plane (for feet of equal radius). The sum of
d dᵀ over such lines, rotated with the trunk by the gyro and exponentially forgotten, has the normal as its eigenvector
of least eigenvalue; in a trot both diagonals contribute every half period. Directions that they leave open, after a
start or on one diagonal, are set by the vertical: the specific force averaged over a second, rotated in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, sqrt

import numpy as np

from stadera.compiled import compiled
from stadera.inertia import skews
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

    def follow(self, along: Array, turn: Array, duration: Array, used: Bools) -> Array:
        """The vertical at the end of each of B successive blocks, (B, 3).

        Args:
            along: (B, 3), directions of the mean specific force. turn: (B, 3, 3), of the trunk, see `turned`.
            duration: (B,) [s]. used: (B,), blocks that count.
        """
        keep, out = np.exp(-duration / self._settings.memory), np.array(along)
        for b in np.flatnonzero(used):
            if self.up is None:
                self.up = along[b]
            else:
                up = turn[b] @ self.up
                up += (1.0 - keep[b]) * (along[b] - up)
                self.up = up / sqrt(up @ up)
            out[b] = self.up
        return out

    def normals(self, up: Array, turn: Array, duration: Array, used: Bools, feet: Array, force: Array) -> Array:
        """The normal at the end of each of the blocks, (B, 3), predicted from those before it.

        Args:
            up, turn, duration, used: of `follow`. feet, force: (B, legs, 3) [m, N], at each block's end.
        """
        settings = self._settings
        carrying = (force @ up[:, :, None])[:, :, 0] > self._least
        lines = (feet[:, :, None] - feet[:, None]).reshape(len(up), -1, 3)  # each twice, and of each foot to itself
        square = (lines * lines).sum(axis=2)
        both = (carrying[:, :, None] & carrying[:, None]).reshape(square.shape) & (square > 0.0)
        weight = np.divide(0.5, square, out=np.zeros_like(square), where=both) * (duration / settings.memory)[:, None]
        more = (lines * weight[:, :, None]).swapaxes(1, 2) @ lines
        keep, known = np.exp(-duration / settings.memory), np.zeros((len(up), 3, 3))
        for b in np.flatnonzero(used):
            known[b] = keep[b] * (turn[b] @ self._lines @ turn[b].T)
            self._lines = known[b] + more[b]
        level = np.eye(3) - up[:, :, None] * up[:, None]
        normal = np.linalg.eigh(known + settings.level * level)[1][:, :, 0]
        return np.asarray(normal * np.where((normal * up).sum(axis=1) < 0.0, -1.0, 1.0)[:, None])


def turned(angular_velocity: Array, duration: Array) -> Array:
    """Rotations (B, 3, 3) that take trunk components of a world-fixed vector to those `duration` (B,) [s] later, at
    angular velocities (B, 3).
    """
    turn = skews(-duration[:, None] * angular_velocity)
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
    angle, order, across = np.empty(legs), np.empty(legs, dtype=np.int64), np.empty((2, 3))
    middle, area = np.empty(3), np.empty(3)
    for k in range(len(feet)):
        count, flat = 0, 0
        for leg in range(legs):
            count += stance[k, leg]
        for c in range(3):
            middle[c] = area[c] = 0.0
            for leg in range(legs):
                if stance[k, leg]:
                    middle[c] += feet[k, leg, c] / count
            out[k, c] = up[k, c]
            if abs(up[k, c]) < abs(up[k, flat]):
                flat = c
        if count < 3:
            continue
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
                angle[at], order[at] = angle[at - 1], order[at - 1]
                at -= 1
            angle[at], order[at] = turn, leg
            count += 1
        along = 0.0
        for at in range(count):
            one, other = order[at], order[(at + 1) % count]
            for c in range(3):
                a, b = (c + 1) % 3, (c + 2) % 3
                area[c] += (feet[k, one, a] - middle[a]) * (feet[k, other, b] - middle[b])
                area[c] -= (feet[k, one, b] - middle[b]) * (feet[k, other, a] - middle[a])
        size = sqrt(area[0] ** 2 + area[1] ** 2 + area[2] ** 2)
        for c in range(3):
            along += area[c] * up[k, c]
        if size > 0.0:
            for c in range(3):
                out[k, c] = area[c] / (size if along >= 0.0 else -size)
