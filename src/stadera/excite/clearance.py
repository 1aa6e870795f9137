"""Clearance of a swinging leg from the trunk, the other legs, itself and the ground, from the model's shapes.

The trunk is held level and the other legs are at rest. Distances between primitive shapes are computed by coal, signed:
a negative one is the penetration depth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import coal
import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import map_coordinates

from stadera.errors import IdentificationError
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Leg, Robot, Shape, Tree
from stadera.robot.stance import standing_configuration
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class _Pair:
    """A pair of shapes, the first one moving; `allowed` is their least permitted distance [m]."""

    first: int
    second: int  # index among the moving shapes, or among the fixed ones if `still`
    still: bool
    allowed: float


@dataclass(frozen=True, eq=False)
class Clearance:
    """Bodies that one leg could collide with."""

    tree: Tree  # of the leg
    moving: tuple[Shape, ...]  # shapes on the leg's links, foot included
    still: tuple[Shape, ...]  # shapes of trunk and other legs, with poses in the trunk frame
    pairs: tuple[_Pair, ...]  # shapes whose distance is checked, excluding those of one link or of neighbouring links
    ground: float | None  # height of the ground in the trunk frame [m], None for no ground
    margin: float  # distance to keep [m]; pairs that are closer at rest only need to keep their distance at rest
    notes: tuple[str, ...] = ()  # pairs whose shapes touch at rest, and which are therefore not checked
    far: float = 0.1  # distance beyond which a bound from enclosing spheres is used [m]

    @classmethod
    def of(cls, robot: Robot, leg: str, rest: ArrayLike, margin: float = 0.0, ground: float | None = None) -> Clearance:
        """Collects the surroundings of a robot's leg at a rest pose (n,) [rad], the other legs in the nominal stance;
        margin and height of a level ground in the trunk frame in [m].

        Raises:
            UnknownNameError: no such leg.
            IdentificationError: the leg is too close to the ground at rest.
        """
        own = robot.leg(leg)
        tree = robot.leg_tree(leg)
        moving = tuple(_with_foot(own, [shape for shape in robot.shapes if shape.link in own.links]))
        still = tuple(_standing(robot, [link for link in robot.tree.links if link not in own.links]))
        bare = cls(tree, moving, still, tuple(_candidates(tree, moving, still)), ground, margin)
        at_rest = np.asarray(rest, dtype=float)[None]
        height = float(bare.height(at_rest)[0])
        if height < margin:
            raise IdentificationError(
                f"leg {own.name} of robot {robot.name}: at its rest pose its lowest point is {height:.3f} m above the "
                f"ground, {margin:g} m are asked for; raise the trunk by {margin - height:.3f} m or more"
            )
        pairs, notes = _evaluated(bare, at_rest)
        return cls(tree, moving, still, pairs, ground, margin, notes)

    def distance(self, position: Array) -> Array:
        """Least distance to any body at poses (samples, n) [rad], (samples,) [m]; above `far` a lower bound of it."""
        return self._least(position, kept=False)

    def slack(self, position: Array) -> Array:
        """`distance` minus the distance to keep: not negative if the pose is clear."""
        return self._least(position, kept=True)

    def height(self, position: Array) -> Array:
        """Height of the leg's lowest point above the ground, (samples,) [m]; infinite without ground."""
        if self.ground is None:
            return np.full(len(position), np.inf)
        rotations, centres = self._poses(position)
        below = np.stack([shape.reach(rotations[:, k, 2]) for k, shape in enumerate(self.moving)], axis=1)
        lowest: Array = (centres[:, :, 2] - below).min(axis=1)
        return lowest - self.ground

    def _least(self, position: Array, kept: bool) -> Array:
        least = self.height(position) - (self.margin if kept else 0.0)
        measure = _Measure(self, *self._poses(position))
        for pair in self.pairs:
            allowed = pair.allowed if kept else 0.0
            # pairs that cannot be the closest need no exact distance
            least = np.minimum(least, measure(pair, np.minimum(least + allowed, self.far)) - allowed)
        return least

    def pair_distances(self, position: Array) -> Iterator[Array]:
        """Distance of each pair at poses (samples, n) [rad], (samples,) [m]; above `far` a lower bound of it."""
        measure = _Measure(self, *self._poses(position))
        return (measure(pair, np.full(len(position), self.far)) for pair in self.pairs)

    def _poses(self, position: Array) -> tuple[Array, Array]:
        """Rotations (samples, shapes, 3, 3) and centres (samples, shapes, 3) of the moving shapes, trunk frame."""
        rotations, translations = forward_kinematics(self.tree, position)
        links = [self.tree.links.index(shape.link) for shape in self.moving]
        own = np.array([shape.rotation for shape in self.moving])
        offsets = np.array([shape.translation for shape in self.moving])
        centres = translations[:, links] + (rotations[:, links] @ offsets[:, :, None])[..., 0]
        return rotations[:, links] @ own, centres


@dataclass(frozen=True, eq=False)
class _Measure:
    """Distances of pairs of shapes, for poses of the moving ones in the trunk frame (see `Clearance._poses`)."""

    shapes: Clearance
    rotations: Array
    centres: Array

    @cached_property
    def _solids(self) -> tuple[list[Any], list[Any]]:
        return [_solid(shape) for shape in self.shapes.moving], [_solid(shape) for shape in self.shapes.still]

    @cached_property
    def _fixed(self) -> list[Any]:
        return [coal.Transform3s(shape.rotation, shape.translation) for shape in self.shapes.still]

    def __call__(self, pair: _Pair, within: Array) -> Array:
        """The pair's distance, (samples,) [m]: exact if it may be below `within` (samples,), else a lower bound."""
        k, m = pair.first, pair.second
        other = (self.shapes.still if pair.still else self.shapes.moving)[m]
        apart = self.centres[:, k] - (other.translation if pair.still else self.centres[:, m])
        out = np.sqrt(np.einsum("ni,ni->n", apart, apart)) - _enclosing(self.shapes.moving[k]) - _enclosing(other)
        near = np.flatnonzero(out < within)
        if len(near):
            measure = coal.ComputeDistance(self._solids[0][k], self._solids[int(pair.still)][m])
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            for i in near:
                pose = coal.Transform3s(self.rotations[i, k], self.centres[i, k])
                where = self._fixed[m] if pair.still else coal.Transform3s(self.rotations[i, m], self.centres[i, m])
                result.clear()
                out[i] = measure(pose, where, request, result)
        return np.asarray(out)


@dataclass(frozen=True, eq=False)
class ClearanceMap:
    """Clearance tabulated over a box of poses and interpolated linearly: fast but approximate."""

    lower: Array  # (n,) [rad], of the grid
    step: Array  # (n,) [rad]
    values: Array  # (points, points, ...) [m], an axis for each joint

    @classmethod
    def of(cls, clearance: Clearance, lower: Array, upper: Array, most: int = 3400) -> ClearanceMap:
        """Tabulates the box from `lower` to `upper`, (n,) each [rad], in at most so many poses."""
        poses, shape = poses_between(lower, upper, most)
        step = np.maximum((upper - lower) / (np.array(shape) - 1), 1e-9)
        return cls(lower, step, clearance.slack(poses).reshape(shape))

    def slack(self, position: Array) -> Array:
        """`Clearance.slack` for poses (samples, n) [rad], (samples,) [m]; outside the box that of its nearest pose."""
        at = ((position - self.lower) / self.step).T
        return np.asarray(map_coordinates(self.values, at, order=1, mode="nearest"))

    def lowered(self, position: Array, slack: Array) -> ClearanceMap:
        """Returns the table lowered around poses (samples, n) until it is not above `slack` (samples,) there."""
        last = np.array(self.values.shape) - 2
        cell = np.clip(np.floor((position - self.lower) / self.step).astype(int), 0, last)
        excess = np.maximum(self.slack(position) - slack, 0.0)
        values = self.values.copy()
        for corner in np.ndindex(*[2] * values.ndim):
            at = tuple((cell + corner).T)
            np.minimum.at(values, at, self.values[at] - excess)
        return replace(self, values=values)


def poses_between(lower: Array, upper: Array, most: int) -> tuple[Array, tuple[int, ...]]:
    """A grid of at most so many poses (k, n) in a box, its corners included, and its shape."""
    points = max(int(most ** (1.0 / len(lower)) + 1e-9), 2)
    axes = [np.linspace(low, high, points) for low, high in zip(lower, upper, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(lower)), (points,) * len(lower)


def _with_foot(leg: Leg, shapes: list[Shape]) -> Iterator[Shape]:
    """Yields the shapes, and the foot's sphere if it is not among them."""
    yield from shapes
    foot = np.asarray(leg.foot_position)
    near = (
        np.linalg.norm(s.translation - foot) < 1e-3 for s in shapes if s.kind == "sphere" and s.link == leg.links[-1]
    )
    if not any(near):
        yield Shape(leg.links[-1], "sphere", (leg.foot_radius,), np.eye(3), foot)


def _standing(robot: Robot, links: list[str]) -> Iterator[Shape]:
    """Yields shapes on these links with the robot in its nominal stance, posed in the trunk frame."""
    rotations, translations = forward_kinematics(robot.tree, standing_configuration(robot)[None])
    for shape in robot.shapes:
        if shape.link in links:
            k = robot.tree.links.index(shape.link)
            yield shape.moved(shape.link, rotations[0, k], translations[0, k])


def _candidates(tree: Tree, moving: tuple[Shape, ...], still: tuple[Shape, ...]) -> Iterator[_Pair]:
    """Yields pairs of shapes whose links are neither the same nor neighbours."""
    parent = {link: tree.links[tree.parents[i]] for i, link in enumerate(tree.links[1:])}
    solid = [k for k, shape in enumerate(moving) if shape.size[0] > 0]
    for k in solid:
        link = moving[k].link
        for m, other in enumerate(still):
            if other.link != parent[link]:
                yield _Pair(k, m, True, 0.0)
        for m in solid:
            if m < k and moving[m].link not in (link, parent[link]) and parent[moving[m].link] != link:
                yield _Pair(k, m, False, 0.0)


def _evaluated(bare: Clearance, rest: Array) -> tuple[tuple[_Pair, ...], tuple[str, ...]]:
    """The pairs that are apart at rest, with their distances to keep, and a note on the others."""
    pairs, touching = [], set()
    for pair, distance in zip(bare.pairs, bare.pair_distances(rest), strict=True):
        other = (bare.still if pair.still else bare.moving)[pair.second]
        if distance[0] > 0:
            pairs.append(_Pair(pair.first, pair.second, pair.still, min(bare.margin, float(distance[0]))))
        else:
            touching.add((bare.moving[pair.first].link, other.link))
    notes = (f"shapes of {a} and {b} touch at rest: not looked at for clearance" for a, b in sorted(touching))
    return tuple(pairs), tuple(notes)


def _solid(shape: Shape) -> Any:
    match shape.kind:
        case "sphere":
            return coal.Sphere(shape.size[0])
        case "capsule":
            return coal.Capsule(*shape.size)
        case "cylinder":
            return coal.Cylinder(*shape.size)
        case "box":
            return coal.Box(*shape.size)


def _enclosing(shape: Shape) -> float:
    """Radius of the sphere around the shape's centre that encloses it [m]."""
    match shape.kind:
        case "sphere":
            return shape.size[0]
        case "capsule":
            return shape.size[0] + 0.5 * shape.size[1]
        case "cylinder":
            return float(np.hypot(shape.size[0], 0.5 * shape.size[1]))
        case "box":
            return 0.5 * float(np.linalg.norm(shape.size))
