"""Where feet touch: one sphere of a point foot, spheres at the corners of a flat one; and which component of its
contact a leg with one joint less does not tell.

Of the six components of a flat foot's contact w = [f ; m] five joints tell five, of the three of a point's w = f two
joints tell two. The last one is u = aᵀ m about, or u = aᵀ f along, an axis a, of one more joint there without mass:

    [ Jᵀ      ]       [ h - τ ]           [ h - τ ]   [ 0 ]
    [ 0ᵀ , aᵀ ] w  =  [   u   ],    w = B [   0   ] + [ B_u ] u

The foot's normal force N bounds u. |m| about an axis of a sole: rolling by half its width, pitching by half its length,
turning by friction μ N on half the diagonal. A foot that touches along a line has next to no width. |f| along an axis:
friction, μ N, since a foot that stands does not slip. μ is one: that of rubber on dry concrete (Serway and Jewett,
Physics for Scientists and Engineers, table 5.1), more than most grounds have. The axis is that, of the trunk's axes
with all joints at zero, with which all components differ most from singular, in a posture bent by 0.3 rad, relative to
the bound.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stadera.boundary import foreign
from stadera.errors import ModelError
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Frame, Leg, Robot, Shape
from stadera.robot.modelfile import FileJoint
from stadera.robot.shapes import FLAT, Foot
from stadera.types import Array

_BENT = 0.3  # rad, see the module's text
_FRICTION = 1.0  # μ, see the module's text
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
    points = np.concatenate([np.zeros((0, 3)), *corners, *_meshes(robot.source, leg.joints[-1])])
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


def find_wheel(path: Path, link: str, joint: FileJoint, shapes: Iterable[Shape]) -> Foot:
    """The wheel that is a leg's last link: a foot's sphere of its radius about its axle. ModelError: the file has no
    shape of it.
    """
    own = [shape for shape in shapes if shape.link == link]
    rims = [(shape.translation, shape.size[0]) for shape in own if shape.kind in ("sphere", "cylinder", "capsule")]
    if not rims:
        unknown = f"it ends in the wheel {link!r}, and neither a cylinder nor a mesh tells its radius"
        try:
            points = np.concatenate([np.zeros((0, 3)), *_meshes(path, joint.name)])
        except ModelError as error:
            raise ModelError(f"{unknown}: {str(error).removeprefix(f'{path}: ')}") from error
        if not len(points):
            raise ModelError(unknown)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        rims = [(middle, float(np.linalg.norm(np.cross(points - middle, joint.axis), axis=1).max()))]
    middle, radius = max(rims, key=lambda rim: rim[1])
    x, y, z = (joint.axis * (joint.axis @ middle)).tolist()
    note = f"a wheel of {1e3 * radius:.0f} mm radius, which touches the ground below its axle"
    return Foot(f"{link}_foot", (x, y, z), radius, note)


def with_unfelt(robot: Robot) -> Robot:
    """The robot with `Leg.unfelt` of legs with a joint less than their contacts have components, and contacts of such
    flat feet in the middle of the soles; with notes on soles that are not known.
    """
    few = [leg for leg in robot.legs if leg.contact > len(leg.joints)]
    if not few:
        return robot
    notes: list[str] = []
    found = {leg.name: _with_unfelt(robot, leg, notes) for leg in few}
    frames = {leg.foot: Frame(leg.links[-1], np.eye(3), np.array(leg.foot_position)) for leg in found.values()}
    legs = tuple(found.get(leg.name, leg) for leg in robot.legs)
    own = {foot: frame for foot, frame in frames.items() if foot.endswith("_foot")}
    return replace(robot, legs=legs, frames={**robot.frames, **own}, notes=(*robot.notes, *notes))


def _with_unfelt(robot: Robot, leg: Leg, notes: list[str]) -> Leg:
    tree = robot.leg_tree(leg.name)
    level = forward_kinematics(tree, np.zeros((1, len(tree.joints))))[0][0, -1]  # the trunk's axes: those of the sole
    place, bounds = np.array(leg.foot_position), np.full(3, _FRICTION)
    if leg.contact == FLAT:
        try:
            points, _ = sole(robot, leg)
            place, (long, wide) = points.mean(axis=0), 0.5 * np.ptp(points @ level.T, axis=0)[:2]
        except ModelError as error:
            long, wide = _UNKNOWN * robot.leg_length
            size = f"{2e3 * long:.0f} by {2e3 * wide:.0f} mm about {leg.foot}"
            notes.append(f"foot {leg.foot}: the size of its sole is not known, taken as {size}; {error}")
        bounds = np.maximum([wide, long, _FRICTION * 0.5 * np.hypot(long, wide)], LEAST_RADIUS)
    low, high = np.array([(robot.limits[joint].lower, robot.limits[joint].upper) for joint in leg.joints]).T
    turns, origins = (x[0] for x in forward_kinematics(tree, np.clip(_BENT, low, high)[None]))
    s = (turns[1:] @ tree.axes[:, :, None])[..., 0]
    rows = np.hstack([np.cross(s, origins[-1] + turns[-1] @ place - origins[1:]), s])[:, : leg.contact]
    axes = turns[-1] @ level.T  # columns: axes of the sole
    volumes = [abs(np.linalg.det(np.vstack([rows, np.r_[np.zeros(leg.contact - 3), axis]]))) for axis in axes.T]
    best = int(np.argmax(volumes / bounds))
    (x, y, z), (a, b, c) = place.tolist(), level.T[:, best].tolist()
    return replace(leg, foot_position=(x, y, z), unfelt=(a, b, c), unfelt_bound=float(bounds[best]))


@lru_cache(maxsize=16)
def _geometry(path: Path) -> tuple[Any, Any]:
    """Pinocchio's model of a URDF and its collision geometry; packages of meshes are looked for above the file."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    folders = [str(folder) for folder in path.parents]
    with foreign(path, "its collision meshes cannot be read", ModelError):  # of a file without its package
        return model, pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.COLLISION, package_dirs=folders)


def _meshes(path: Path | None, joint: str) -> list[Array]:
    """Vertices (k, 3) [m] of the collision meshes of the link that a joint moves, in its frame."""
    if path is None or path.suffix not in (".urdf", ".xml", ".mjcf"):
        return []
    if path.suffix != ".urdf":
        from stadera.robot.mjcf import mesh_vertices

        return mesh_vertices(path, joint)
    model, geometry = _geometry(path)
    found = []
    for shape in geometry.geometryObjects:
        if shape.parentJoint == model.getJointId(joint) and hasattr(shape.geometry, "vertices"):
            vertices = np.asarray(shape.geometry.vertices()) * np.asarray(shape.meshScale)
            found.append(vertices @ shape.placement.rotation.T + shape.placement.translation)
    return found
