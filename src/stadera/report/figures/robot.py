"""A robot of rounded parts: a body, limbs that taper outwards, drives about the joints' axes, feet.

The demo's page builds them in 3D; figures show them from any side, each part the hull of a few balls.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from stadera.report.figures.model import Series
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Leg, Robot, Shape
from stadera.types import Array

Kind = Literal["body", "limb", "drive", "foot"]
_COLOURS: dict[Kind, str] = {"limb": "limb", "drive": "drive", "body": "shell", "foot": "foot"}
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
_CIRCLE = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])


@dataclass(frozen=True, eq=False)
class RobotPart:
    """The hull of balls fixed to a link; of a limb and of a drive the first and the last are the ends of its axis.

    Attributes:
        link: as in the robot's tree, the trunk's 0; links of joints outside the legs follow.
        centres, radii: (k, 3) and (k,) [m], link frame; balls of a drive are flat discs across its axis.
    """

    kind: Kind
    link: int
    centres: Array
    radii: Array


def limbs(robot: Robot, leg: Leg) -> Iterator[RobotPart]:
    """For each link of a leg a limb to the next joint or foot, thinner outwards, and a drive about its joint's axis;
    then the foot.
    """
    tree, half = robot.tree, 0.5 * robot.leg_length
    joints = [tree.joints.index(name) for name in leg.joints]
    ends = np.array([*(tree.translations[j] for j in joints[1:]), leg.foot_position])
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(ends, axis=1))])
    way /= way[-1] or 1.0
    for k, joint in enumerate(joints):
        thick = half * (0.14 - 0.09 * way[k : k + 2])
        yield RobotPart("limb", joint + 1, np.array([np.zeros(3), ends[k]]), thick)
        drum = half * (0.17 - 0.1 * way[k])
        along = 0.85 * drum * tree.axes[joint]
        yield RobotPart("drive", joint + 1, np.array([-along, along]), np.full(2, drum))
    radius = max(leg.foot_radius, 0.06 * half)
    yield RobotPart("foot", joints[-1] + 1, soles(robot, leg), np.full(len(soles(robot, leg)), radius))


def trunk_box(robot: Robot) -> Shape | None:
    """The largest box of the trunk, None if it has none that is as large as half a leg."""
    boxes = [shape for shape in robot.shapes if shape.link == robot.trunk and shape.kind == "box"]
    largest = max(boxes, key=lambda shape: float(np.prod(shape.size)), default=None)
    return largest if largest is not None and max(largest.size) > 0.5 * robot.leg_length else None


def soles(robot: Robot, leg: Leg) -> Array:
    """Points (k, 3) [m] at which a foot touches the ground, frame of the leg's last link: the centre of a point foot,
    the spheres of a flat one.
    """
    spheres = [s.translation for s in robot.shapes if s.link == leg.links[-1] and s.kind == "sphere"]
    return np.array(spheres if leg.contact != 3 and len(spheres) > 2 else [leg.foot_position])


def poses(robot: Robot, position: Array) -> tuple[Array, Array]:
    """Rotations (N, links, 3, 3) and origins (N, links, 3) [m] of all links in the trunk frame, those outside the legs
    at their reference; `position` (N, joints) [rad] in the tree's order.
    """
    rotations, origins = forward_kinematics(robot.tree, position)
    if robot.extra is None:
        return rotations, origins
    turned, placed = zip(*robot.extra.poses(robot.extra.reference), strict=True)
    R, p = (np.repeat(np.array(values)[None], len(position), axis=0) for values in (turned, placed))
    return np.concatenate([rotations, R], axis=1), np.concatenate([origins, p], axis=1)


def outlines(
    robot: Robot, position: Array, view: Array, turn: Array | None = None, shift: Array | None = None
) -> Iterator[tuple[str, Array]]:
    """The robot's parts as seen along a direction, from the back to the front: a colour, and corners (N, 24, 2) [m].

    Args:
        position: (N, joints) [rad], in the tree's order.
        view: (2, 3), the axes of the figure in the world's. turn, shift: (N, 3, 3) and (N, 3) [m], pose of the trunk in
            the world; None for the trunk's axes.
    """
    rotations, origins = poses(robot, position)
    if turn is not None and shift is not None:
        rotations, origins = turn[:, None] @ rotations, origins @ turn.transpose(0, 2, 1) + shift[:, None]
    parts = [*_body(robot), *_outside(robot), *(part for leg in robot.legs for part in limbs(robot, leg))]
    for kind, colour in _COLOURS.items():
        for part in (part for part in parts if part.kind == kind):
            yield colour, _seen(part, view @ rotations[:, part.link], origins[:, part.link] @ view.T)


def silhouette(robot: Robot, position: Array, view: Array) -> tuple[Series, ...]:
    """The robot as seen along a direction, from the back to the front.

    Args:
        position: (joints,) [rad], in the tree's order.
        view: (2, 3), the axes of the figure in the trunk's.
    """
    parts: dict[str, list[Array]] = {}
    for colour, corners in outlines(robot, position[None], view):
        parts.setdefault(colour, []).append(corners[0])
    return tuple(_area(own, colour) for colour, own in parts.items())


def outline(points: Array) -> Array:
    """The closed hull of points (k, 2), counterclockwise, (n, 2); a line for points on one."""
    hull = _hull(points)
    return np.concatenate([hull, hull[:1]])


def _body(robot: Robot) -> Iterator[RobotPart]:
    """The trunk's box, rounded; without one, the hull of what hangs from the trunk."""
    if (box := trunk_box(robot)) is not None:
        radius = 0.3 * min(box.size)
        signs = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
        corners = (signs * (0.5 * np.array(box.size) - radius)) @ box.rotation.T + box.translation
        yield RobotPart("body", 0, corners, np.full(8, radius))
    else:
        extra = robot.extra
        roots = [] if extra is None else [p for p, on in zip(extra.translations, extra.parents, strict=True) if on < 0]
        centres = np.array([*robot.hips, *roots])
        yield RobotPart("body", 0, centres, np.full(len(centres), 0.1 * robot.leg_length))


def _outside(robot: Robot) -> Iterator[RobotPart]:
    """Limbs of joints outside the legs; a link from which several branch is a body."""
    extra = robot.extra
    if extra is None:
        return
    first, radius = len(robot.tree.links), 0.045 * robot.leg_length
    for k in range(len(extra.joints)):
        ends = [extra.translations[c] for c, parent in enumerate(extra.parents) if parent == k]
        ends = ends or [extra.bodies[k].com]  # where the next joints are, else the centre of mass
        kind: Kind = "body" if len(ends) > 1 and max(np.linalg.norm(ends, axis=1)) > 4.0 * radius else "limb"
        wide = 2.0 * radius if kind == "body" else radius
        yield RobotPart(kind, first + k, np.array([np.zeros(3), *ends]), np.full(len(ends) + 1, wide))


def _seen(part: RobotPart, axes: Array, origin: Array) -> Array:
    """Corners (N, 24, 2) [m] of a part: its points farthest in directions all around, of discs across a drive's axis,
    of balls else; the link's axes (N, 2, 3) and origin (N, 2) as seen.
    """
    middles = part.centres @ axes.transpose(0, 2, 1) + origin[:, None]  # (N, k, 2)
    rims = part.radii[:, None, None] * _CIRCLE
    if part.kind == "drive":
        along = part.centres[-1] - part.centres[0]
        across = axes @ np.linalg.svd(along[None])[2][1:].T
        inside = _CIRCLE @ across  # the direction in each disc that leads farthest
        inside = inside / np.maximum(np.linalg.norm(inside, axis=2, keepdims=True), 1e-12)
        rims = (part.radii[0] * inside @ across.transpose(0, 2, 1))[:, None]
    corners = middles[:, :, None] + rims  # (N, k, 24, 2)
    farthest = (corners * _CIRCLE).sum(axis=3).argmax(axis=1)
    return np.asarray(np.take_along_axis(corners, farthest[:, None, :, None], axis=1)[:, 0])


def _hull(points: Array) -> Array:
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):  # on one line, or too few
        along = points @ np.linalg.svd(points - points.mean(axis=0))[2][0]
        return points[[int(np.argmin(along)), int(np.argmax(along))]]


def _area(parts: list[Array], colour: str) -> Series:
    closed = [np.concatenate([hull, hull[:1], np.full((1, 2), np.nan)]) for hull in parts]
    x, y = np.concatenate(closed)[:-1].T
    return Series(x, y, "", colour, 0.6, fill="self", dense=0.4)
