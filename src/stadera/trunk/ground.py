"""The normal of the ground under a robot, in trunk axes, from the contact points of its feet.

Of one that stands it is that of the polygon of its feet, which has the area ½ Σ p_i x p_i+1, a vector.

Of one that walks, the line d between two loaded feet lies in the ground's plane (for feet of equal radius). The sum of
d dᵀ over such lines, rotated with the trunk by the gyro and exponentially forgotten, has the normal as its eigenvector
of least eigenvalue; in a trot both diagonals contribute every half period. Directions that they leave open, after a
start or on one diagonal, are set by the vertical: the specific force averaged over a second, rotated in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from stadera.inertia import skews
from stadera.types import Array, Bools

_UNIT = np.eye(3)


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
        level = _UNIT - up[:, :, None] * up[:, None]
        normal = np.linalg.eigh(known + settings.level * level)[1][:, :, 0]
        return np.asarray(normal * np.where((normal * up).sum(axis=1) < 0.0, -1.0, 1.0)[:, None])


def turned(angular_velocity: Array, duration: Array) -> Array:
    """Rotations (B, 3, 3) that take trunk components of a world-fixed vector to those `duration` (B,) [s] later, at
    angular velocities (B, 3).
    """
    turn = skews(-duration[:, None] * angular_velocity)
    return np.asarray(_UNIT + turn + 0.5 * turn @ turn)


def ground_normal(feet: Array, stance: Bools, up: Array) -> Array:
    """Unit normal (..., 3) of the polygon of the feet in stance, in their order about its middle, on the side of `up`
    (..., 3). With fewer than three feet it is `up`.

    Args:
        feet: (..., L, 3) [m]; stance: (..., L).
    """
    points, stands, up_of = feet.reshape(-1, *feet.shape[-2:]), stance.reshape(-1, feet.shape[-2]), up.reshape(-1, 3)
    count = stands.sum(axis=1)
    middle = (points * stands[..., None]).sum(axis=1) / np.maximum(count, 1)[:, None]
    away = np.where(stands[..., None], points - middle[:, None], 0.0)
    turn = skews(up_of)
    first = np.matvec(turn, np.eye(3)[np.abs(up_of).argmin(axis=1)])  # two directions across `up`
    second = np.matvec(turn, first)
    angle = np.arctan2(np.matvec(away, second), np.matvec(away, first))
    order = np.argsort(np.where(stands, angle, np.inf), axis=1, kind="stable")
    ring = np.take_along_axis(away, order[..., None], axis=1)  # those off the ground are zero, and come last
    each = np.arange(ring.shape[1])
    following = ring[np.arange(len(ring))[:, None], np.where(each + 1 < count[:, None], each + 1, 0)]
    area = np.matvec(skews(ring), following).sum(axis=1)
    size = np.linalg.norm(area, axis=1)
    size = np.where(np.vecdot(area, up_of) < 0.0, -size, size)[:, None]
    flat = (count[:, None] < 3) | (size == 0.0)
    return np.where(flat, up_of, area / np.where(flat, 1.0, size)).reshape(up.shape)
