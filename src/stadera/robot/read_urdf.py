"""Reads a URDF: bodies and joints through Pinocchio, shapes and single masses from the XML."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np

from stadera.errors import ModelError
from stadera.robot.model import Shape
from stadera.robot.modelfile import ModelFile

_DUMMY_MASS_RATIO = 1e-3  # a root this light next to what is fixed to it is there for the tree's sake alone


def read_urdf(path: Path, root: ET.Element) -> ModelFile:
    """Read a URDF whose XML is already parsed.

    Raises:
        ModelError: Pinocchio cannot build a model from it, or a link's mass is negative.
    """
    masses = {_name(link, path): _mass(link, path) for link in root.findall("link")}
    shapes = tuple(shape for link in root.findall("link") for shape in _link_shapes(link, path))
    children = {_name(joint, path): _child(joint, path) for joint in root.findall("joint")}
    model = _build(path)
    return ModelFile(
        path=path,
        name=root.get("name") or path.stem,
        model=model,
        trunk=_trunk_name(model, masses, _with_mesh(root), {shape.link for shape in shapes}),
        links={name: children[name] for name in model.names if name in children},
        masses=masses,
        shapes=shapes,
    )


def _build(path: Path) -> Any:
    import pinocchio as pin

    try:
        model = pin.buildModelFromUrdf(str(path))
        if model.njoints < 2 or model.joints[1].shortname() != "JointModelFreeFlyer":
            model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"{path}: not a URDF that Pinocchio can build: {str(error).splitlines()[0]}") from error
    return model


def _trunk_name(model: Any, masses: dict[str, float], meshed: set[str], shaped: set[str]) -> str:
    """The root link; where that is a dummy (no mass, no mesh), the heaviest link with a shape fixed at identity."""
    import pinocchio as pin

    fixed = [f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint == 1]
    root: str = fixed[0].name
    bodies = [f.name for f in fixed if f.placement.isIdentity(1e-9) and f.name in meshed | shaped]
    heaviest: str = max(bodies, key=lambda name: masses[name], default=root)
    dummy = root not in meshed and masses[root] < _DUMMY_MASS_RATIO * masses[heaviest]
    return heaviest if dummy else root


def _with_mesh(root: ET.Element) -> set[str]:
    return {str(link.get("name")) for link in root.findall("link") if link.find(".//mesh") is not None}


def _name(element: ET.Element, path: Path) -> str:
    name = element.get("name")
    if not name:
        raise ModelError(f"{path}: a {element.tag} has no name")
    return name


def _child(joint: ET.Element, path: Path) -> str:
    child = joint.find("child")
    if child is None or not child.get("link"):
        raise ModelError(f"{path}: joint {joint.get('name')!r} has no child link")
    return str(child.get("link"))


def _mass(link: ET.Element, path: Path) -> float:
    mass = link.find("inertial/mass")
    return 0.0 if mass is None else _numbers(mass, "value", path, (0.0,))[0]


def _link_shapes(link: ET.Element, path: Path) -> list[Shape]:
    """Primitive shapes of one link: its collision shapes, or its visual ones where it has no primitive collision."""
    for kind in ("collision", "visual"):
        shapes = [shape for element in link.findall(kind) if (shape := _shape(_name(link, path), element, path))]
        if shapes:
            return shapes
    return []


def _shape(link: str, element: ET.Element, path: Path) -> Shape | None:
    rotation, translation = _origin(element.find("origin"), path)
    geometry = element.find("geometry")
    if geometry is None:
        return None
    if (box := geometry.find("box")) is not None:
        return Shape(link, "box", _numbers(box, "size", path, (0.0,) * 3), rotation, translation)
    if (sphere := geometry.find("sphere")) is not None:
        return Shape(link, "sphere", _numbers(sphere, "radius", path, (0.0,)), rotation, translation)
    if (cylinder := geometry.find("cylinder")) is not None:
        size = _numbers(cylinder, "radius", path, (0.0,)) + _numbers(cylinder, "length", path, (0.0,))
        return Shape(link, "cylinder", size, rotation, translation)
    if (capsule := geometry.find("capsule")) is not None:
        size = _numbers(capsule, "radius", path, (0.0,)) + _numbers(capsule, "length", path, (0.0,))
        return Shape(link, "capsule", size, rotation, translation)
    return None


def _origin(origin: ET.Element | None, path: Path) -> tuple[Any, Any]:
    import pinocchio as pin

    if origin is None:
        return np.eye(3), np.zeros(3)
    zero = (0.0, 0.0, 0.0)
    return pin.rpy.rpyToMatrix(*_numbers(origin, "rpy", path, zero)), np.array(_numbers(origin, "xyz", path, zero))


def _numbers(element: ET.Element, attribute: str, path: Path, default: tuple[float, ...]) -> tuple[float, ...]:
    text = element.get(attribute)
    if text is None:
        return default
    try:
        numbers = tuple(float(word) for word in text.split())
    except ValueError:
        numbers = ()
    if len(numbers) != len(default):
        raise ModelError(f"{path}: <{element.tag} {attribute}={text!r}> needs {len(default)} number(s)")
    return numbers
