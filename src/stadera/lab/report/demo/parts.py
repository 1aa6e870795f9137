"""Appearance of a robot in the demo's scene: its meshes if available (HyQ), else rounded parts."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib import resources
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.lab.plant.payload import Tray
from stadera.robot.model import Leg, Robot

_WITH_MESHES = ("hyq",)

_COVER = 0.002  # m

_LIMBS = ((0.13, 0.13, 0.17), (0.13, 0.09, 0.17), (0.085, 0.05, 0.12))
"""Radii of hip, thigh and shank at both ends, and of their drives, as shares of the thigh's length."""


def robot_parts(robot: Robot) -> dict[str, Any]:
    """Plain values, metres in the link's frame: meshes, each packed once, and parts on the tree's numbered links."""
    found, joints = _bundled(robot.name), robot.tree.joints
    if not {part["joint"] for part in found["parts"]} <= {None, *joints}:  # another model by the same name
        found = {"meshes": {}, "parts": []}
    parts = [_mesh_part(part, joints) for part in found["parts"]]
    return {"meshes": found["meshes"], "parts": [*(parts or _rounded(robot)), _plate(robot), *_feet(robot)]}


def _bundled(name: str) -> dict[str, Any]:
    if name not in _WITH_MESHES:
        return {"meshes": {}, "parts": []}
    file = resources.files("stadera.lab.report") / "vendor" / f"{name}.json"
    return dict(json.loads(file.read_text(encoding="utf-8")))


def _mesh_part(part: dict[str, Any], joints: tuple[str, ...]) -> dict[str, Any]:
    joint = joints.index(part["joint"]) if part["joint"] else None
    place = {"link": 0 if joint is None else joint + 1, "at": part["at"], "turn": part["turn"]}
    return {"kind": "mesh", "mesh": part["mesh"], **place} | ({} if joint is None else {"joint": joint})


def _plate(robot: Robot) -> dict[str, Any]:
    """The plate on which boxes land; slightly higher than in the plant, so that it covers a back at the same height."""
    tray = Tray.of(robot)
    at = tray.centre + np.array([0.0, 0.0, _COVER])
    return {"link": 0, "kind": "plate", "size": short(2.0 * tray.half_size), "at": short(at), "turn": [0, 0, 0, 1]}


def _rounded(robot: Robot) -> Iterator[dict[str, Any]]:
    """Yields a trunk, and legs from joint to joint."""
    boxes = [shape for shape in robot.shapes if shape.link == robot.trunk and shape.kind == "box"]
    largest = max(boxes, key=lambda shape: float(np.prod(shape.size)), default=None)
    if largest is not None:  # lower by the thickness of the plate on top of it
        under = np.array([0.0, 0.0, 2.0 * Tray.of(robot).half_size[2]])
        turn = short(Rotation.from_matrix(largest.rotation).as_quat())
        size, at = short(largest.size), short(largest.translation - under)
        yield {"link": 0, "kind": "body", "size": size, "at": at, "turn": turn}
    for leg in robot.legs:
        yield from _limbs(robot, leg)


def _limbs(robot: Robot, leg: Leg) -> Iterator[dict[str, Any]]:
    """Yields for each link a limb to the next joint or foot, thinner downwards, and a drive about each joint's axis."""
    tree = robot.tree
    joints = [tree.joints.index(name) for name in leg.joints]
    ends = [*(tree.translations[j] for j in joints[1:]), np.array(leg.foot_position)]
    length = float(np.linalg.norm(ends[1])) or 0.3
    for k, (joint, end) in enumerate(zip(joints, ends, strict=True)):
        thick, thin, drive = (length * share for share in _LIMBS[k])
        yield {"link": joint + 1, "kind": "limb", "to": short(end), "radii": short([thick, thin])}
        axis = short(tree.axes[joint])
        drum = {"radius": drive, "width": 1.7 * drive}
        yield {"link": joint + 1, "kind": "drive", "joint": joint, "axis": axis, **drum}


def _feet(robot: Robot) -> Iterator[dict[str, Any]]:
    tree = robot.tree
    for leg in robot.legs:
        shank = tree.joints.index(leg.joints[2])
        length = float(np.linalg.norm(tree.translations[shank])) or 0.3
        radius = max(leg.foot_radius, 0.06 * length)
        yield {"link": shank + 1, "kind": "foot", "at": short(leg.foot_position), "radius": radius}


def short(values: Any) -> list[float]:
    """Rounds each value to six digits."""
    return [float(f"{value:.6g}") for value in values]
