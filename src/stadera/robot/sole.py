"""Where feet touch: one sphere of a point foot, spheres at the corners of a flat one; and which moment of a flat foot a
leg of five joints does not tell.

Of the six components of its contact, five joints tell five. The sixth is the moment about an axis of the sole, which
the foot's force and half the sole's size bound: that of rolling by half its width, of pitching by half its length, and
of turning by friction, of a coefficient of one on half the diagonal. A foot that touches along a line has next to no
width. The axis is that with which the six differ most from singular, in a posture bent by 0.3 rad, relative to the
bound.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stadera.boundary import foreign
from stadera.errors import ModelError
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Frame, Leg, Robot
from stadera.robot.shapes import FLAT
from stadera.types import Array

_BENT = 0.3  # rad, see the module's text
_UNKNOWN = np.array([0.15, 0.06])  # half length and width of a sole of which the model states nothing, in leg lengths

LEAST_RADIUS = 1e-3
"""Radius of a foot of which the model states none [m]."""


def foot_radius(leg: Leg) -> float:
    """Radius of the foot's spheres in the plant [m]; a millimetre where the model knows none."""
    return leg.foot_radius or LEAST_RADIUS


def sole(robot: Robot, leg: Leg) -> tuple[Array, float]:
    """Centres (k, 3) [m] of a foot's spheres in its last link's frame, and their radius [m].

    A flat foot has the spheres of its link, or the corners of the rectangle around the lowest part of the link's boxes
    and collision meshes, with the sole as with all joints at zero.

    Raises:
        ModelError: a flat foot with neither, or a file whose collision meshes cannot be read.
    """
    if leg.contact != FLAT:
        return np.array([leg.foot_position]), foot_radius(leg)
    own = [shape for shape in robot.shapes if shape.link == leg.links[-1]]
    spheres = [shape for shape in own if shape.kind == "sphere"]
    if len(spheres) >= 3:
        return np.array([s.translation for s in spheres]), float(np.mean([s.size[0] for s in spheres]))
    signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    boxes = [shape for shape in own if shape.kind == "box"]
    corners = [(signs * box.size) @ box.rotation.T + box.translation for box in boxes]
    points = np.concatenate([np.zeros((0, 3)), *corners, *_meshes(robot, leg)])
    if not len(points):
        raise ModelError(f"robot {robot.name}: the flat foot {leg.foot} has no spheres, boxes or meshes to stand on")
    tree = robot.leg_tree(leg.name)
    level = forward_kinematics(tree, np.zeros((1, len(tree.joints))))[0][0, -1]
    seen = points @ level.T  # in the trunk's axes
    low, thick = seen[:, 2].min(), 0.1 * np.ptp(seen[:, :2], axis=0).max()
    touching = seen[seen[:, 2] < low + thick]
    (x, y, _), (X, Y, _) = touching.min(axis=0), touching.max(axis=0)
    radius = foot_radius(leg)
    return np.array([[a, b, low + radius] for a in (x, X) for b in (y, Y)]) @ level, radius


def with_unfelt_moments(robot: Robot) -> Robot:
    """The robot with `Leg.unfelt` of its flat feet on five joints, and their contacts in the middle of the soles."""
    few = [leg for leg in robot.legs if leg.contact == FLAT > len(leg.joints)]
    found = {leg.name: _with_unfelt(robot, leg) for leg in few}
    if not found:
        return robot
    frames = {leg.foot: Frame(leg.links[-1], np.eye(3), np.array(leg.foot_position)) for leg in found.values()}
    legs = tuple(found.get(leg.name, leg) for leg in robot.legs)
    return replace(
        robot, legs=legs, frames={**robot.frames, **{f: x for f, x in frames.items() if f.endswith("_foot")}}
    )


def _with_unfelt(robot: Robot, leg: Leg) -> Leg:
    tree = robot.leg_tree(leg.name)
    level = forward_kinematics(tree, np.zeros((1, len(tree.joints))))[0][0, -1]  # the trunk's axes: those of the sole
    try:
        points, _ = sole(robot, leg)
        place, (long, wide) = points.mean(axis=0), 0.5 * np.ptp(points @ level.T, axis=0)[:2]
    except ModelError:
        place, (long, wide) = np.array(leg.foot_position), _UNKNOWN * robot.leg_length
    arms = np.maximum([wide, long, 0.5 * np.hypot(long, wide)], LEAST_RADIUS)
    low, high = np.array([(robot.limits[joint].lower, robot.limits[joint].upper) for joint in leg.joints]).T
    turns, origins = (x[0] for x in forward_kinematics(tree, np.clip(_BENT, low, high)[None]))
    s = (turns[1:] @ tree.axes[:, :, None])[..., 0]
    told = np.hstack([np.cross(s, origins[-1] + turns[-1] @ place - origins[1:]), s])
    axes = turns[-1] @ level.T  # columns: axes of the sole
    volumes = [abs(np.linalg.det(np.vstack([told, np.r_[np.zeros(3), axis]]))) for axis in axes.T]
    best = int(np.argmax(volumes / arms))
    (x, y, z), (a, b, c) = place.tolist(), level.T[:, best].tolist()
    return replace(leg, foot_position=(x, y, z), unfelt=(a, b, c), unfelt_arm=float(arms[best]))


@lru_cache(maxsize=16)
def _geometry(path: Path) -> tuple[Any, Any]:
    """Pinocchio's model of a URDF and its collision geometry; packages of meshes are looked for above the file."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    folders = [str(folder) for folder in path.parents]
    with foreign(path, "its collision meshes cannot be read", ModelError):  # of a file without its package
        return model, pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.COLLISION, package_dirs=folders)


def _meshes(robot: Robot, leg: Leg) -> list[Array]:
    """Vertices of the collision meshes of a leg's last link, in its frame."""
    if robot.source is None or robot.source.suffix != ".urdf":
        return []
    model, geometry = _geometry(robot.source)
    joint = model.getJointId(leg.joints[-1])
    found = []
    for shape in geometry.geometryObjects:
        if shape.parentJoint == joint and hasattr(shape.geometry, "vertices"):
            vertices = np.asarray(shape.geometry.vertices()) * np.asarray(shape.meshScale)
            found.append(vertices @ shape.placement.rotation.T + shape.placement.translation)
    return found
