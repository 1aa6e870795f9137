"""Fits simple shapes to links whose model file has meshes only, from kinematics."""

from collections.abc import Iterator, Sequence

import numpy as np

from stadera.robot.model import Leg, Shape, Tree
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
    last, foot = leg.links[2], np.array(leg.foot_position)
    spheres = [shape for shape in own if shape.link == last and shape.kind == "sphere"]  # a foot is no shape of a link
    covered = {shape.link for shape in own if shape not in spheres}
    hip, knee = (tree.translations[tree.joints.index(name)] for name in leg.joints[1:])
    for link, end in zip(leg.links, (hip, knee, foot), strict=True):
        if link not in covered and np.linalg.norm(end) > 1e-6:
            yield _capsule(link, end, slenderness)
    if leg.foot_radius > 0 and not spheres:
        yield Shape(last, "sphere", (leg.foot_radius,), np.eye(3), foot)


def _capsule(link: str, end: Array, slenderness: float) -> Shape:
    length = float(np.linalg.norm(end))
    return Shape(link, "capsule", (slenderness * length, length), _z_along(end / length), 0.5 * end)


def _trunk_box(tree: Tree, legs: tuple[Leg, ...], flatness: float) -> Shape:
    hips = np.array([tree.translations[tree.joints.index(leg.joints[0])] for leg in legs])
    low, high = hips.min(axis=0), hips.max(axis=0)
    length, width = float(high[0] - low[0]), float(high[1] - low[1])
    return Shape(tree.links[0], "box", (length, width, flatness * width), np.eye(3), 0.5 * (low + high))


def _z_along(direction: Array) -> Array:
    """A rotation whose third column is `direction` (unit)."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(direction, x), direction])
