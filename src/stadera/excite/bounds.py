"""Bounds on a leg's excitation: limits of position, velocity and torque, and clearance from all other bodies.

The trunk is held level and the other legs are at rest. Distances between primitive shapes are computed by coal, signed:
a negative one is the penetration depth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import coal
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from stadera.body import FrictionModel, JointMotion, JointTorqueRegressor
from stadera.constants import ROUNDING
from stadera.errors import IdentificationError
from stadera.excite.sinusoids import Sinusoids
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Leg, Robot, Shape, Tree
from stadera.robot.stance import standing_configuration
from stadera.types import Array

_Poses = tuple[Array, Array, Callable[[int, int], coal.Transform3s]]


@dataclass(frozen=True, eq=False)
class Clearance:
    """Bodies that one leg could collide with."""

    tree: Tree  # of the leg
    # on the leg's links, foot included, and those of trunk and other legs, with poses in the trunk frame
    shapes: tuple[Shape, ...]
    # (shapes,), place in the tree of the link that moves each; 0, the trunk, for what stands still
    links: NDArray[np.int64]
    # places of two shapes, the first one moving, and their least permitted distance [m]; of none of one link or of
    # neighbouring links
    pairs: tuple[tuple[int, int, float], ...]
    ground: float | None  # height of the ground in the trunk frame [m], None for no ground
    margin: float  # distance to keep [m]; pairs that are closer at rest only need to keep their distance at rest
    notes: tuple[str, ...] = ()  # on pairs whose shapes touch at rest, and which are therefore not checked
    far: float = 0.1  # distance beyond which a bound from enclosing spheres is used [m]

    @classmethod
    def of(cls, robot: Robot, leg: str, rest: ArrayLike, margin: float = 0.0, ground: float | None = None) -> Clearance:
        """Collects the surroundings of a robot's leg at a rest pose (n,) [rad], the other legs in the nominal stance;
        margin and height of a level ground in the trunk frame in [m]. Raises UnknownNameError: no such leg.
        IdentificationError: the leg is too close to the ground at rest.
        """
        own, tree, at_rest = robot.leg(leg), robot.leg_tree(leg), np.asarray(rest, dtype=float)[None]
        shapes = (*_of_leg(robot, own), *_standing(robot, [link for link in robot.tree.links if link not in own.links]))
        links = np.array([tree.links.index(s.link) if s.link in own.links else 0 for s in shapes])
        bare = cls(tree, shapes, links, tuple(_candidates(tree, shapes, links)), ground, margin)
        height = float(bare.height(at_rest)[0])
        if height < margin:
            raise IdentificationError(
                f"leg {own.name} of robot {robot.name}: at its rest pose its lowest point is {height:.3f} m above the "
                f"ground, {margin:g} m are asked for; raise the trunk by {margin - height:.3f} m or more"
            )
        pairs, touching = [], set()
        poses = bare._poses(at_rest)
        for k, (one, other, _) in enumerate(bare.pairs):
            distance = float(bare._exact(poses, k, np.arange(1))[0])
            if distance > 0:
                pairs.append((one, other, min(margin, distance)))
            else:
                touching.add((shapes[one].link, shapes[other].link))
        notes = (f"shapes of {a} and {b} touch at rest: not looked at for clearance" for a, b in sorted(touching))
        return replace(bare, pairs=tuple(pairs), notes=tuple(notes))

    def distance(self, position: Array) -> Array:
        """Least distance to any body at poses (samples, n) [rad], (samples,) [m]; above `far` a lower bound of it."""
        return self._least(position, kept=False, far=self.far)

    def slack(self, position: Array) -> Array:
        """`distance` minus the distance to keep: not negative if the pose is clear."""
        return self._least(position, kept=True, far=self.far)

    def height(self, position: Array) -> Array:
        """Height of the leg's lowest point above the ground, (samples,) [m]; infinite without ground."""
        if self.ground is None:
            return np.full(len(position), np.inf)
        rotations, centres, _ = self._poses(position)
        moving = np.flatnonzero(self.links)
        lowest = [centres[:, k, 2] - self.shapes[k].reach(rotations[:, k, 2]) for k in moving]
        return np.asarray(np.min(lowest, axis=0) - self.ground)

    def clear(self, position: Array) -> bool:
        """True if `slack` is nowhere negative, rounding aside, at poses (samples, n) [rad]."""
        return bool((self._least(position, kept=True, far=self.margin) >= -ROUNDING).all())

    def _least(self, position: Array, kept: bool, far: float) -> Array:
        least = self.height(position) - (self.margin if kept else 0.0)
        poses = self._poses(position)
        apart = self._between_spheres(poses)
        for k, (_, _, least_allowed) in enumerate(self.pairs):
            allowed, found = least_allowed if kept else 0.0, apart[:, k]
            # pairs that cannot be the closest need no exact distance
            near = np.flatnonzero(found < np.minimum(least + allowed, far))
            found[near] = self._exact(poses, k, near)
            least = np.minimum(least, found - allowed)
        return least

    def _poses(self, position: Array) -> _Poses:
        """Rotations (samples, shapes, 3, 3) and centres (samples, shapes, 3) of the shapes, trunk frame, and coal's
        transform by places of sample and shape, made once.
        """
        rotations, translations = (values[:, self.links] for values in forward_kinematics(self.tree, position))
        offsets = np.array([shape.translation for shape in self.shapes])
        centres = translations + (rotations @ offsets[:, :, None])[..., 0]
        rotations = rotations @ np.array([shape.rotation for shape in self.shapes])
        return rotations, centres, cache(lambda i, k: coal.Transform3s(rotations[i, k], centres[i, k]))

    def _between_spheres(self, poses: _Poses) -> Array:
        """Distances of the spheres that enclose the shapes of each pair, (samples, pairs) [m]."""
        radii, (one, other) = np.array([solid.aabb_radius for solid in self._solids]), self._places
        apart = poses[1][:, one] - poses[1][:, other]
        return np.asarray(np.sqrt(np.einsum("nki,nki->nk", apart, apart)) - (radii[one] + radii[other]))

    def _exact(self, poses: _Poses, pair: int, samples: NDArray[np.int64]) -> Array:
        """Distance of a pair's shapes at some of the samples, (k,) [m]."""
        (_, _, place), (one, other, _) = poses, self.pairs[pair]
        measure = coal.ComputeDistance(self._solids[one], self._solids[other])
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        out = np.empty(len(samples))
        for i, sample in enumerate(samples.tolist()):
            result.clear()
            out[i] = measure(place(sample, one), place(sample if self.links[other] else 0, other), request, result)
        return out

    @cached_property
    def _places(self) -> NDArray[np.int64]:
        """Of the pairs' shapes, (2, pairs)."""
        return np.array([pair[:2] for pair in self.pairs], dtype=int).reshape(-1, 2).T

    @cached_property
    def _solids(self) -> list[Any]:
        kinds = {"sphere": coal.Sphere, "capsule": coal.Capsule, "cylinder": coal.Cylinder, "box": coal.Box}
        solids = [kinds[shape.kind](*shape.size) for shape in self.shapes]
        for solid in solids:
            solid.computeLocalAABB()
        return solids


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


def _of_leg(robot: Robot, leg: Leg) -> Iterator[Shape]:
    """Yields the shapes of a leg's links, and the foot's sphere if it is not among them."""
    own, foot = [shape for shape in robot.shapes if shape.link in leg.links], np.asarray(leg.foot_position)
    yield from own
    spheres = [s.translation for s in own if s.kind == "sphere" and s.link == leg.links[-1]]
    if not any(np.linalg.norm(centre - foot) < 1e-3 for centre in spheres):
        yield Shape(leg.links[-1], "sphere", (leg.foot_radius,), np.eye(3), foot)


def _standing(robot: Robot, links: list[str]) -> Iterator[Shape]:
    """Yields shapes on these links with the robot in its nominal stance, posed in the trunk frame."""
    rotations, translations = forward_kinematics(robot.tree, standing_configuration(robot)[None])
    for shape in robot.shapes:
        if shape.link in links:
            k = robot.tree.links.index(shape.link)
            yield shape.moved(shape.link, rotations[0, k], translations[0, k])


def _candidates(tree: Tree, shapes: Sequence[Shape], links: NDArray[np.int64]) -> Iterator[tuple[int, int, float]]:
    """Yields pairs of shapes whose links are neither the same nor neighbours."""
    parent = {link: tree.links[tree.parents[i]] for i, link in enumerate(tree.links[1:])}
    solid = [k for k, shape in enumerate(shapes) if shape.size[0] > 0 or not links[k]]
    for k in solid:
        for m in (m for m in solid if links[k] and (m < k or not links[m])):
            one, other = shapes[k].link, shapes[m].link
            if other not in (one, parent[one]) and parent.get(other) != one:
                yield k, m, 0.0


@dataclass(frozen=True)
class Margins:
    """Margins between an excitation and the leg's limits."""

    position: float = 0.05  # distance from each joint limit [rad]
    reach: float = 1.0  # largest distance of a joint from the rest pose [rad]
    velocity: float = 0.7  # share of the joint's velocity limit that may be used
    effort: float = 0.7  # share of the joint's effort limit that may be used by the torque predicted by the prior model
    distance: float = 0.01  # least distance between the leg and all other bodies [m]

    def __post_init__(self) -> None:
        if not (self.position >= 0 and self.distance >= 0 and self.reach > 0):
            raise IdentificationError(f"margins must not be negative, the reach positive; got {self}")
        if not (0 < self.velocity <= 1 and 0 < self.effort <= 1):
            raise IdentificationError(f"shares of velocity and effort limits lie between 0 and 1; got {self}")


@dataclass(frozen=True, eq=False)
class LegBounds:
    """Bounds on one leg's joints with the trunk held level; margins are already subtracted."""

    robot: Robot
    leg: str
    rest: Array  # (n,) [rad], the pose at the start and the end
    lower: Array  # (n,) [rad]; the rest pose is within
    upper: Array  # (n,) [rad]
    velocity: Array  # (n,) [rad/s], infinite if the model states none
    effort: Array  # (n,) [N·m], infinite if the model states none
    clearance: Clearance  # from trunk, other legs, the leg itself and the ground

    @classmethod
    def of(cls, robot: Robot, leg: str, margins: Margins | None = None, ground: float | None = None) -> LegBounds:
        """Computes the bounds of a robot's leg around its nominal stance, above a level ground at a height in the trunk
        frame [m], None for none. Raises UnknownNameError: no such leg. IdentificationError: it is too close to the
        ground. ModelError: the robot has no nominal stance.
        """
        margins, joints = margins or Margins(), robot.leg(leg).joints
        pose = standing_configuration(robot)[[robot.tree.joints.index(joint) for joint in joints]]
        limits = [robot.limits[joint] for joint in joints]
        lower, upper, velocity, effort = np.array([[x.lower, x.upper, x.velocity, x.effort] for x in limits]).T
        return cls(
            robot,
            robot.leg(leg).name,
            pose,
            np.minimum(pose, np.maximum(lower + margins.position, pose - margins.reach)),
            np.maximum(pose, np.minimum(upper - margins.position, pose + margins.reach)),
            margins.velocity * velocity,
            margins.effort * effort,
            Clearance.of(robot, leg, pose, margins.distance, ground),
        )

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the leg's joints."""
        return self.robot.leg(self.leg).joints

    @cached_property
    def _model(self) -> tuple[JointTorqueRegressor, dict[str, float]]:
        leg = self.robot.leg(self.leg)
        regressor = JointTorqueRegressor(self.robot.leg_tree(self.leg), FrictionModel.full())
        bodies = {link: self.robot.inertias[link].to_dict() for link in leg.links}
        joints = {joint: vars(self.robot.dynamics[joint]) for joint in leg.joints}
        return regressor, {f"{of}.{name}": v for of, terms in (bodies | joints).items() for name, v in terms.items()}

    def torque(self, motion: JointMotion) -> Array:
        """Torque of the motion predicted by the prior model, friction included, (samples, n) [N·m]."""
        regressor, values = self._model
        return regressor.predict(motion, values)

    def gravity_torque(self, position: Array) -> Array:
        """Torque that holds poses (samples, n), predicted by the prior model, (samples, n) [N·m]."""
        still = np.zeros_like(position)
        return self.torque(JointMotion(position, still, still))

    def at_rest(self) -> str:
        """What the rest pose violates, in words: torque limits (it is within those of positions), else a distance."""
        torque = np.abs(self.gravity_torque(self.rest[None])[0])
        weak = [
            f"{joint} needs {needed:.3g} N·m to hold the leg and may have {limit:.3g}"
            for joint, needed, limit in zip(self.joints, torque, self.effort, strict=True)
            if needed > limit
        ]
        return ", ".join(weak) or "the leg is too close to the trunk, another leg or the ground"

    @cached_property
    def clearance_map(self) -> ClearanceMap:
        """The clearance, tabulated over the position bounds."""
        return ClearanceMap.of(self.clearance, self.lower, self.upper)

    def excess(self, motion: JointMotion) -> float:
        """Largest violation of the bounds, ≤ 0 within, as a share of the range, the velocity or the effort bound."""
        q = motion.position
        span = np.maximum(self.upper - self.lower, 1e-9)
        over = max(float(((q - self.upper) / span).max()), float(((self.lower - q) / span).max()))
        over = max(over, float((np.abs(motion.velocity) / self.velocity).max()) - 1.0)
        return max(over, float((np.abs(self.torque(motion)) / self.effort).max()) - 1.0)


def fitting_factor(motion: Sinusoids, bounds: LegBounds, step: float = 0.99, rate: float = 100.0) -> float:
    """Factor by which the motion must be scaled towards the rest pose to satisfy the bounds, 1 if it does: the first
    power of `step` that fits at samples of `rate` [Hz]. Raises IdentificationError: the rest pose itself violates the
    bounds.
    """
    factor = 1.0
    while not _fits(motion.drawn_in(factor), bounds, rate):
        factor *= step
        if factor < 0.01:
            raise IdentificationError(f"leg {bounds.leg}: the rest pose itself is out of bounds: {bounds.at_rest()}")
    return factor


def _fits(motion: Sinusoids, bounds: LegBounds, rate: float) -> bool:
    """True if the motion satisfies the bounds. The cheapest tests come first."""
    samples = motion.sample(rate)
    if bounds.excess(samples) > ROUNDING:
        return False
    return all(bounds.clearance.clear(samples.position[::every]) for every in (20, 2))
