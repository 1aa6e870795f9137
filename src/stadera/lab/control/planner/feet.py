"""Footholds along a path, and the ground plane estimated from the feet.

The body's path is an arc: with speed v and turn rate r its pose (x, y, ψ) obeys ẋ = v cos ψ, ẏ = v sin ψ, ψ̇ = r. Each
foot has a nominal position relative to the path's pose. A foot stays in place for the next three steps after landing,
so it is placed at its nominal position in the middle of that time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.types import Array


@dataclass(frozen=True, eq=False)
class PathPose:
    """A pose of the path, seen from above, in the odometry frame: (2,) [m], and the heading [rad]."""

    position: Array
    heading: float

    def ahead(self, speed: float, turn: float, time: float) -> PathPose:
        """The pose on the path after a time [s], along the chord of the arc."""
        angle = turn * time
        chord = speed * time * float(np.sinc(0.5 * angle / np.pi))
        direction = self.heading + 0.5 * angle
        step = chord * np.array([np.cos(direction), np.sin(direction)])
        return PathPose(self.position + step, self.heading + angle)

    def place(self, offset: Array) -> Array:
        """Transforms a point (2,) [m] relative to the pose to the odometry frame."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        return np.asarray(self.position + np.array([[c, -s], [s, c]]) @ offset)


@dataclass(frozen=True, eq=False)
class Footholds:
    """Nominal positions of the feet relative to the path's pose.

    Attributes:
        offsets: (4, 2) [m], ahead and to the left of the path's pose.
    """

    offsets: Array

    @classmethod
    def of(cls, feet: Array, heading: float) -> tuple[Footholds, PathPose]:
        """Computed from the positions of the feet (4, 3) [m]: the path starts in their middle."""
        middle = feet[:, :2].mean(axis=0)
        c, s = np.cos(heading), np.sin(heading)
        return cls((feet[:, :2] - middle) @ np.array([[c, -s], [s, c]])), PathPose(middle, heading)

    def next(self, leg: int, path: PathPose, speed: float, turn: float, step: float, ahead: float = 1.5) -> Array:
        """Foothold, (2,) [m], if the path has this pose at landing and steps take `step` [s];
        `ahead` is how many steps later the middle of the stance that follows is.
        """
        return path.ahead(speed, turn, ahead * step).place(self.offsets[leg])


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """The plane z = height + slope · (x, y), as fitted to feet.

    Attributes:
        height: [m]. slope: (2,).
    """

    height: float
    slope: Array

    @classmethod
    def of(cls, feet: Array) -> GroundPlane:
        """Least squares through points (n, 3) [m], n ≥ 3."""
        columns = np.column_stack([np.ones(len(feet)), feet[:, :2]])
        found = np.asarray(np.linalg.lstsq(columns, feet[:, 2], rcond=None)[0], dtype=float)
        return cls(float(found[0]), found[1:])

    def at(self, point: Array) -> float:
        """Its height at a point (2,) [m]."""
        return float(self.height + self.slope @ point[:2])

    @property
    def normal(self) -> Array:
        """Unit normal, upwards, (3,)."""
        normal = np.array([-self.slope[0], -self.slope[1], 1.0])
        return np.asarray(normal / np.linalg.norm(normal))


def facing(normal: Array, heading: float) -> Array:
    """Rotation (3, 3) of a trunk parallel to a plane with this unit normal (3,), with a heading [rad]."""
    c, s = np.cos(heading), np.sin(heading)
    nose = np.array([c, s, -(normal[0] * c + normal[1] * s) / normal[2]])
    nose /= np.linalg.norm(nose)
    return np.column_stack([nose, np.cross(normal, nose), normal])
