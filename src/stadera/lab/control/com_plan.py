"""Plans the motion of the centre of mass over coming supports: a quadratic programme with the zero-moment point.

With the centre of mass at height h above the contacts, moving horizontally, the contact forces pass through the
zero-moment point (Vukobratović)

    z = c - (h / g) c̈,

which must lie in the support polygon. The motion has piecewise constant jerk. Over the coming phases,

    min  ∫ ‖τ² c̈‖² + β ‖τ³ c⃛‖² + γ ‖c - goal‖² + δ ‖τ ċ‖² [while a leg swings]  dt  +  penalty on missing margins
    s.t. n_i · z ≤ d_i - margin + lacking,   n_i · c ≤ d_i - margin + lacking,       at rest at the end

with τ = √(h / g) and a chosen δ. For slow walks the result is the paper's: the body moves while four feet are
loaded, and rests over the next triangle while a leg swings. If time is short it keeps moving, and the zero-moment
point keeps the margin. Every plan ends at rest over four feet, so that a plan without successor stops safely.

A support polygon is stored as half-planes n_i · p ≤ d_i with unit outward normals n_i, so d_i - n_i · p is the
distance to edge i, positive inside, and the least of them is the static stability margin of a point p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import proxsuite
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull, QhullError

from stadera.constants import GRAVITY
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
        try:
            hull = flat[ConvexHull(flat, qhull_options="Qt").vertices]  # counter-clockwise, without points on an edge
        except QhullError:
            wanted = "three contacts that are not in one line"
            raise PlanError(f"a support polygon needs {wanted}, got {flat.tolist()}") from None
        corners = np.roll(hull, -np.lexsort((hull[:, 1], hull[:, 0]))[0], axis=0)  # from the leftmost
        edges = np.roll(corners, -1, axis=0) - corners
        normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1, keepdims=True)
        return cls(corners, normals, (normals * corners).sum(axis=1))

    def margin(self, point: ArrayLike) -> float:
        """The static stability margin [m] of a centre of mass (2,) or (3,): distance to the nearest edge, negative
        outside.
        """
        return float((self.distances - self.normals @ np.asarray(point, dtype=float)[:2]).min())

    @property
    def centroid(self) -> Array:
        """Centroid of the area, (2,) [m]."""
        a, b = self.corners, np.roll(self.corners, -1, axis=0)
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        return np.asarray(((a + b) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum()))

    def goal(self, wish: ArrayLike, margin: float) -> Array:
        """The point (2,) [m] nearest to `wish` with this margin [m] to every edge, or the largest one (to 1e-9)."""
        target = np.asarray(wish, dtype=float)[:2]
        if (best := self._nearest(target, margin)) is not None:
            return best
        # towards the point of largest margin: the largest feasible margin by bisection
        low, high, found = 0.0, margin, self.centroid
        for _ in range(40):
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
        for corner in map(list, combinations(range(len(limits)), 2)):
            if abs(np.linalg.det(self.normals[corner])) > 1e-9:
                candidates.append(np.asarray(np.linalg.solve(self.normals[corner], limits[corner]), dtype=float))
        points = np.array(candidates)
        inside = (points @ self.normals.T <= limits + 1e-12).all(axis=1)
        if not inside.any():
            return None
        points = points[inside]
        return np.asarray(points[np.argmin(((points - target) ** 2).sum(axis=1))])


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


@dataclass(frozen=True)
class PlanWeights:
    """Weights of the programme, and settings of its solution."""

    longest: float = 0.08  # longest piece of constant jerk [s]
    infinite: float = 1e20  # value that the solver treats as no bound
    jerk: float = 1e-3  # β
    near: float = 0.5  # γ
    rest: float = 20.0  # the largest δ
    lacking_zmp: tuple[float, float] = (20.0, 2e3)  # cost of a missing margin, linear [m] and quadratic
    lacking_com: tuple[float, float] = (2.0, 2e2)  # likewise
    # successive accuracies [SI units] and iterations; a coarse plan is better than none
    attempts: tuple[tuple[float, int], ...] = ((1e-6, 500), (1e-4, 5000))


_WEIGHTS = PlanWeights()


@dataclass(frozen=True, eq=False)
class SupportPhase:
    """A period with the same feet in stance."""

    duration: float  # [s], positive
    support: SupportPolygon  # polygon for the zero-moment point
    goal: Array  # (2,) [m], preferred position of the centre of mass
    rests: bool  # whether the body should preferably rest: a leg swings


@dataclass(frozen=True, eq=False)
class ComPlan:
    """Horizontal motion of the centre of mass, with piecewise constant jerk; at rest after its end."""

    times: Array  # (k + 1,) [s], ends of the pieces
    states: Array  # (k + 1, 3, 2), position [m], velocity [m/s] and acceleration [m/s²] at these times
    jerks: Array  # (k, 2) [m/s³]

    @classmethod
    def standing(cls, time: float, position: Array) -> ComPlan:
        """A plan at rest at a position (2,) [m], from a time [s] on."""
        state = np.zeros((2, 3, 2))
        state[:, 0] = position
        return cls(np.array([time, time + 1.0]), state, np.zeros((1, 2)))

    @property
    def end(self) -> float:
        """Time from which it is at rest [s]."""
        return float(self.times[-1])

    def at(self, time: float) -> Array:
        """Position, velocity and acceleration (3, 2) at a time [s]."""
        k = int(np.searchsorted(self.times, time, side="right")) - 1
        if k >= len(self.jerks):
            return np.asarray(self.states[-1])
        k = max(k, 0)
        t = time - self.times[k]
        return _moved(self.states[k], self.jerks[k], t)


def plan_com(
    time: float, start: Array, phases: Sequence[SupportPhase], height: float, margin: float, rest: float = 1.0
) -> ComPlan:
    """The best motion through the phases, from a state (3, 2) of position, velocity and acceleration at a time [s].

    The centre of mass is at a height [m] over the contacts, the margin [m] is that of zero-moment point and centre of
    mass to the polygons' edges, and `rest` the weight of the body's rest while a leg swings, from 1 to 0 for none.
    """
    start = np.asarray(start, dtype=float)
    programme = _Programme(phases, start, height / GRAVITY, margin, _WEIGHTS.rest * rest)
    jerks = programme.solved()
    states = [start]
    for jerk, step in zip(jerks, programme.steps, strict=True):
        states.append(_moved(states[-1], jerk, step))
    return ComPlan(time + np.concatenate([[0.0], np.cumsum(programme.steps)]), np.array(states), jerks)


def _moved(state: Array, jerk: Array, t: float) -> Array:
    c, v, a = state
    return np.array([c + t * v + t * t / 2 * a + t**3 / 6 * jerk, v + t * a + t * t / 2 * jerk, a + t * jerk])


class _Programme:
    """The programme in the jerks of x, those of y, and the missing margins of each phase (z, then c).

    `tau2` is h / g [s²], `rest` δ; of the k pieces, `steps` (k,) are the lengths [s] and `owner` (k,) the phases, and
    `maps` and `free` give the states at their ends, see `_response`.
    """

    def __init__(self, phases: Sequence[SupportPhase], start: Array, tau2: float, margin: float, rest: float) -> None:
        self.phases, self.tau2, self.margin, self.rest = phases, tau2, margin, rest
        counts = [max(int(np.ceil(phase.duration / _WEIGHTS.longest)), 1) for phase in phases]
        self.steps = np.concatenate([np.full(n, phase.duration / n) for n, phase in zip(counts, phases, strict=True)])
        self.owner: NDArray[np.int_] = np.repeat(np.arange(len(phases)), counts)
        self.maps, self.free = _response(self.steps, start)

    def solved(self) -> Array:
        """Jerks (k, 2)."""
        n, m = len(self.steps), len(self.phases)
        hessian, gradient = self._cost()
        rows, bounds = self._supports()
        least = np.full(len(bounds), -_WEIGHTS.infinite)
        rows = np.vstack([rows, np.hstack([np.zeros((2 * m, 2 * n)), np.eye(2 * m)])])
        bounds, least = np.append(bounds, np.full(2 * m, _WEIGHTS.infinite)), np.append(least, np.zeros(2 * m))
        last, rest = np.zeros((4, 2 * n + 2 * m)), np.zeros(4)
        for k, (what, axis) in enumerate(((1, 0), (1, 1), (2, 0), (2, 1))):
            last[k, axis * n : (axis + 1) * n] = self.maps[what][-1]
            rest[k] = -self.free[what][-1, axis]
        for accuracy, most in _WEIGHTS.attempts:
            result = proxsuite.proxqp.dense.solve(
                H=hessian, g=gradient, A=last, b=rest, C=rows, l=least, u=bounds, eps_abs=accuracy, max_iter=most
            )
            if result.info.status == proxsuite.proxqp.PROXQP_SOLVED and np.isfinite(result.x).all():
                return np.asarray(result.x[: 2 * n].reshape(2, n).T)
        raise PlanError("no way of the centre of mass found through the phases ahead")

    def _cost(self) -> tuple[Array, Array]:
        n, m = len(self.steps), len(self.phases)
        tau2, (position, speed, push) = self.tau2, self.maps
        rests = np.array([self.phases[k].rests for k in self.owner], dtype=float)
        goals = np.array([self.phases[k].goal for k in self.owner])
        weight = self.steps[:, None]
        hessian, gradient = np.zeros((2 * n + 2 * m,) * 2), np.zeros(2 * n + 2 * m)
        block = tau2**2 * push.T @ (weight * push) + _WEIGHTS.near * position.T @ (weight * position)
        block += self.rest * tau2 * speed.T @ ((rests[:, None] * weight) * speed)
        block += np.diag(_WEIGHTS.jerk * tau2**3 * self.steps)
        for axis in range(2):
            free = [part[:, axis] for part in self.free]
            part = slice(axis * n, (axis + 1) * n)
            hessian[part, part] = block
            gradient[part] = tau2**2 * push.T @ (self.steps * free[2])
            gradient[part] += _WEIGHTS.near * position.T @ (self.steps * (free[0] - goals[:, axis]))
            gradient[part] += self.rest * tau2 * speed.T @ (self.steps * rests * free[1])
        for k, (linear, quadratic) in enumerate((_WEIGHTS.lacking_zmp, _WEIGHTS.lacking_com)):
            part = slice(2 * n + k * m, 2 * n + (k + 1) * m)
            hessian[part, part] = quadratic * np.eye(m)
            gradient[part] = linear
        return hessian, gradient

    def _supports(self) -> tuple[Array, Array]:
        """Rows and bounds that keep both points in their supports at pieces' ends and at the beginning of a swing."""
        m = len(self.phases)
        position, _, push = self.maps
        rows, bounds = [], []
        for k, phase in enumerate(self.phases):
            mine = np.flatnonzero(self.owner == k)
            if phase.rests and mine[0] > 0:
                mine = np.append(mine[0] - 1, mine)
            polygon = phase.support
            for which, map_, free in (
                (0, position - self.tau2 * push, self.free[0] - self.tau2 * self.free[2]),
                (1, position, self.free[0]),
            ):
                if which == 1 and not phase.rests:
                    continue
                lacking = np.zeros((len(mine), 2 * m))
                lacking[:, which * m + k] = -1.0
                for normal, distance in zip(polygon.normals, polygon.distances, strict=True):
                    rows.append(np.hstack([normal[0] * map_[mine], normal[1] * map_[mine], lacking]))
                    bounds.append(distance - self.margin - free[mine] @ normal)
        return np.vstack(rows), np.concatenate(bounds)


def _response(steps: Array, start: Array) -> tuple[list[Array], list[Array]]:
    """States at the pieces' ends: maps (n, n) from an axis' jerks; parts without jerk (n, 2)."""
    n = len(steps)
    maps, free = np.zeros((3, n, n)), np.zeros((3, n, 2))
    one, state = np.zeros((3, n)), start
    for k, t in enumerate(steps):
        step = np.array([[1.0, t, t * t / 2], [0.0, 1.0, t], [0.0, 0.0, 1.0]])
        one, state = step @ one, step @ state
        one[:, k] += (t**3 / 6, t * t / 2, t)
        maps[:, k], free[:, k] = one, state
    return list(maps), list(free)
