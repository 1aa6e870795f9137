"""Geometry of the feet: support polygons seen from above, and the plane of the ground.

A convex polygon is stored as half-planes n_i · p ≤ d_i with unit outward normals n_i, so d_i - n_i · p is the distance
to edge i, positive inside, and the least of them is the static stability margin of a point p.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError

from stadera.errors import StaderaError
from stadera.types import Array


class PlanError(StaderaError):
    """The plan is impossible."""


@dataclass(frozen=True, eq=False)
class SupportPolygon:
    """The convex hull of contacts, projected along gravity."""

    corners: Array  # (k, 2) [m], counter-clockwise
    normals: Array  # (k, 2), unit outward normals of the edges; edge i goes from corner i to the next
    distances: Array  # (k,) [m], of the edges from the origin along their normals

    @classmethod
    def of(cls, points: ArrayLike) -> SupportPolygon:
        """The hull of points (n, 2) or (n, 3) [m]; heights are ignored."""
        flat = np.asarray(points, dtype=float)[:, :2]
        corners = _hull(flat)
        if len(corners) < 3:
            raise PlanError(f"a support polygon needs three contacts that are not in one line, got {flat.tolist()}")
        edges = np.roll(corners, -1, axis=0) - corners
        normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1, keepdims=True)
        return cls(corners, normals, (normals * corners).sum(axis=1))

    def margins(self, point: ArrayLike) -> Array:
        """Distances (k,) [m] of a point (2,) or (3,) from the edges, negative beyond one."""
        return np.asarray(self.distances - self.normals @ np.asarray(point, dtype=float)[:2])

    def margin(self, point: ArrayLike) -> float:
        """The static stability margin [m] of a centre of mass: distance to the nearest edge, negative outside."""
        return float(self.margins(point).min())

    @property
    def centroid(self) -> Array:
        """Centroid of the area, (2,) [m]."""
        a, b = self.corners, np.roll(self.corners, -1, axis=0)
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        return np.asarray(((a + b) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum()))

    def goal(self, wish: ArrayLike, margin: float, bisections: int = 40) -> Array:
        """The point (2,) [m] nearest to `wish` with this margin [m] to every edge, or the largest one (to 1e-9)."""
        target = np.asarray(wish, dtype=float)[:2]
        if (best := self._nearest(target, margin)) is not None:
            return best
        # towards the point of largest margin: the largest feasible margin by bisection
        low, high, found = 0.0, margin, self.centroid
        for _ in range(bisections):
            middle = 0.5 * (low + high)
            point = self._nearest(target, middle)
            if point is None:
                high = middle
            else:
                low, found = middle, point
        return found

    def _nearest(self, target: Array, margin: float) -> Array | None:
        """Nearest point of the shrunk polygon: the target itself, its foot on one edge, or a corner."""
        limits = self.distances - margin
        candidates = [target]
        over = self.normals @ target - limits
        candidates += [target - o * n for o, n in zip(over, self.normals, strict=True) if o > 0]
        k = len(limits)
        for i in range(k):
            for j in range(i + 1, k):
                pair = self.normals[[i, j]]
                if abs(np.linalg.det(pair)) > 1e-9:
                    candidates.append(np.asarray(np.linalg.solve(pair, limits[[i, j]]), dtype=float))
        points = np.array(candidates)
        inside = (points @ self.normals.T <= limits + 1e-12).all(axis=1)
        if not inside.any():
            return None
        points = points[inside]
        return np.asarray(points[np.argmin(((points - target) ** 2).sum(axis=1))])


def _hull(points: Array) -> Array:
    """Corners of the convex hull, counter-clockwise from the leftmost, without points on an edge; fewer if flat."""
    try:
        corners = points[ConvexHull(points, qhull_options="Qt").vertices]
    except QhullError:
        return points[:0]
    first = np.lexsort((corners[:, 1], corners[:, 0]))[0]
    return np.roll(corners, -first, axis=0)


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """The plane z = height + slope · (x, y), as fitted to feet."""

    height: float  # [m]
    slope: Array  # (2,)

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
