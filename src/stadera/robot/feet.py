"""Finds the point foot of a leg on its last link."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError
from stadera.robot.model import Frame, Shape
from stadera.types import Array

_FOOT_NAME = re.compile(r"foot|toe", re.IGNORECASE)


@dataclass(frozen=True)
class Foot:
    """A foot sphere in the frame of its link [m]; `note` states assumptions, and is empty if the file defines it."""

    frame: str
    position: tuple[float, float, float]
    radius: float
    note: str = ""


def find_foot(link: str, frames: Mapping[str, Frame], shapes: Iterable[Shape], near: float = 0.2) -> Foot:
    """Finds the foot of `link`; ModelError if there is none.

    Uses a frame on it whose name contains foot or toe (the farthest out, if several), with the sphere nearest to it,
    within `near` times the frame's distance from the knee; else the farthest sphere; else the far end of the farthest
    other primitive shape.
    """
    own = [shape for shape in shapes if shape.link == link]
    spheres = [shape for shape in own if shape.kind == "sphere"]
    named = [name for name, frame in frames.items() if frame.link == link and _FOOT_NAME.search(name) and name != link]
    if named:
        name = max(named, key=lambda n: _far(frames[n].translation))
        return _foot_at_frame(name, frames[name], spheres, near)
    name = f"{link}_foot"
    if spheres:
        sphere = max(spheres, key=lambda s: _far(s.translation))
        return Foot(name, _triple(sphere.translation), sphere.size[0])
    if not own:
        raise ModelError(f"link {link!r} has no frame named foot or toe, and no primitive shape to find a foot on")
    point, radius = max(map(_far_end, own), key=lambda end: _far(end[0]))
    return Foot(name, _triple(point), radius, "taken at the far end of its link's geometry")


def _foot_at_frame(name: str, frame: Frame, spheres: list[Shape], near: float) -> Foot:
    reach = near * _far(frame.translation)
    offset = [_far(s.translation - frame.translation) for s in spheres]
    if not spheres or min(offset) > reach:
        return Foot(name, _triple(frame.translation), 0.0, "no sphere there, taken as a point at the frame")
    nearest = spheres[int(np.argmin(offset))]
    note = ""
    if min(offset) > 1e-6:
        note = f"taken at the centre of the sphere, {1e3 * min(offset):.1f} mm from the frame of that name"
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
