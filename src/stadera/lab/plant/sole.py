"""Where feet touch: one sphere of a point foot, spheres at the corners of a flat one."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stadera.errors import ModelError
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Leg, Robot
from stadera.robot.shapes import FLAT
from stadera.types import Array

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
        ModelError: a flat foot with neither.
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
    points = np.concatenate([*corners, *_meshes(robot, leg)]) if boxes or robot.source else np.zeros((0, 3))
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


@lru_cache(maxsize=16)
def _geometry(path: Path) -> tuple[Any, Any]:
    """Pinocchio's model of a URDF and its collision geometry; packages of meshes are looked for above the file."""
    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    folders = [str(folder) for folder in path.parents]
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
