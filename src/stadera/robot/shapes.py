"""Feet of a model, and simple shapes for links whose model file has meshes only, from kinematics."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError
from stadera.robot.model import Frame, Leg, Shape, Tree
from stadera.types import Array


def fitted_shapes(
    tree: Tree, legs: tuple[Leg, ...], shapes: tuple[Shape, ...], slenderness: float = 0.12, flatness: float = 0.6
) -> Iterator[Shape]:
    """Yields a capsule or box for every link, and a sphere for every foot, that `shapes` lacks.

    A leg link gets a capsule from its joint to the next joint or foot, of radius `slenderness` times its length; the
    trunk a box that spans the hips, of height `flatness` times its width.
    """
    if all(shape.link != tree.links[0] for shape in shapes):
        yield _trunk_box(tree, legs, flatness)
    for leg in legs:
        yield from _leg_shapes(tree, leg, [shape for shape in shapes if shape.link in leg.links], slenderness)


def _leg_shapes(tree: Tree, leg: Leg, own: Sequence[Shape], slenderness: float) -> Iterator[Shape]:
    last, foot = leg.links[-1], np.array(leg.foot_position)
    spheres = [shape for shape in own if shape.link == last and shape.kind == "sphere"]  # a foot is no shape of a link
    covered = {shape.link for shape in own if shape not in spheres}
    ends = (tree.translations[tree.joints.index(name)] for name in leg.joints[1:])
    for link, end in zip(leg.links, (*ends, foot), strict=True):
        if link not in covered and (length := _far(end)) > 1e-6:
            yield Shape(link, "capsule", (slenderness * length, length), _z_along(end / length), 0.5 * end)
    if leg.foot_radius > 0 and not spheres:
        yield Shape(last, "sphere", (leg.foot_radius,), np.eye(3), foot)


def _trunk_box(tree: Tree, legs: tuple[Leg, ...], flatness: float) -> Shape:
    hips = np.array([tree.translations[tree.joints.index(leg.joints[0])] for leg in legs])
    low, high = hips.min(axis=0), hips.max(axis=0)
    length, width = (max(float(side), 0.1) for side in (high - low)[:2])  # of two hips side by side too
    return Shape(tree.links[0], "box", (length, width, flatness * width), np.eye(3), 0.5 * (low + high))


def _z_along(direction: Array) -> Array:
    """A rotation whose third column is `direction` (unit)."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(direction, x), direction])


FLAT = 6
"""Components of the contact of a flat foot, and joints of a leg that determine them."""
_FOOT_NAME = re.compile(r"foot|toe", re.IGNORECASE)
_SOLE_NAME = re.compile(r"sole|foot|toe", re.IGNORECASE)


@dataclass(frozen=True)
class Foot:
    """A foot sphere in the frame of its link [m]; `note` states assumptions, and is empty if the file defines it."""

    frame: str
    position: tuple[float, float, float]
    radius: float
    note: str = ""


def find_foot(
    link: str, frames: Mapping[str, Frame], shapes: Iterable[Shape], frame: str | None = None, near: float = 0.2
) -> Foot:
    """Finds the foot of `link`; ModelError if there is none.

    Uses the `frame` that is given, else one on it whose name contains foot or toe (the farthest out, if several), with
    the sphere nearest to it, within `near` times the frame's distance from the knee; else the farthest sphere; else the
    far end of the farthest other primitive shape.
    """
    own = [shape for shape in shapes if shape.link == link]
    spheres = [shape for shape in own if shape.kind == "sphere"]
    if name := frame or _named(link, frames, _FOOT_NAME):
        return _foot_at_frame(name, frames[name], spheres, near)
    name = f"{link}_foot"
    if spheres:
        sphere = max(spheres, key=lambda s: _far(s.translation))
        return Foot(name, _triple(sphere.translation), sphere.size[0])
    if not own:
        raise ModelError(f"link {link!r} has no frame named foot or toe, and no primitive shape to find a foot on")
    point, radius = max(map(_far_end, own), key=lambda end: _far(end[0]))
    return Foot(name, _triple(point), radius, "taken at the far end of its link's geometry")


def find_sole(link: str, frames: Mapping[str, Frame], shapes: Iterable[Shape], frame: str | None = None) -> Foot:
    """Finds the point of a flat foot about which its contact's wrench is given: the `frame` given, else the one on
    `link` whose name contains sole, foot or toe, else the middle of its spheres, else the link's origin. No row depends
    on it.
    """
    spheres = [shape.translation for shape in shapes if shape.link == link and shape.kind == "sphere"]
    if name := frame or _named(link, frames, _SOLE_NAME):
        return Foot(name, _triple(frames[name].translation), 0.0)
    middle = np.mean(spheres, axis=0) if spheres else np.zeros(3)
    return Foot(f"{link}_foot", _triple(middle), 0.0, "a flat foot")


def _named(link: str, frames: Mapping[str, Frame], pattern: re.Pattern[str]) -> str:
    """The farthest frame on a link with such a name; empty if there is none."""
    named = [name for name, frame in frames.items() if frame.link == link and pattern.search(name) and name != link]
    return max(named, key=lambda name: _far(frames[name].translation), default="")


def _foot_at_frame(name: str, frame: Frame, spheres: list[Shape], near: float) -> Foot:
    nearest = min(spheres, key=lambda s: _far(s.translation - frame.translation), default=None)
    off = np.inf if nearest is None else _far(nearest.translation - frame.translation)
    if nearest is None or off > near * _far(frame.translation):
        return Foot(name, _triple(frame.translation), 0.0, "no sphere there, taken as a point at the frame")
    note = f"taken at the centre of the sphere, {1e3 * off:.1f} mm from the frame of that name" if off > 1e-6 else ""
    return Foot(name, _triple(nearest.translation), nearest.size[0], note)


def _far_end(shape: Shape) -> tuple[Array, float]:
    """The outermost end of a shape's longest axis, and the radius of the sphere there (0: a flat end)."""
    if shape.kind == "box":
        axis = int(np.argmax(shape.size))
        half, radius = 0.5 * shape.size[axis], 0.0
    else:
        axis = 2
        half, radius = 0.5 * shape.size[1], shape.size[0] if shape.kind == "capsule" else 0.0
    ends = [shape.translation + sign * half * shape.rotation[:, axis] for sign in (1.0, -1.0)]
    return max(ends, key=_far), radius


def _far(point: Array) -> float:
    return float(np.linalg.norm(point))


def _triple(v: Array) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
