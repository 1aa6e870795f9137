"""Reads URDF. A number that cannot be parsed (ixx="0,05") is refused; other readers ignore its element."""

import xml.etree.ElementTree as ET
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.limits import Limits
from stadera.robot.model import JointDynamics, JointLimits, Shape
from stadera.robot.modelfile import FileJoint, FileLink, ModelFile
from stadera.types import Array

_KINDS: dict[str, Any] = {"revolute": "turns", "continuous": "turns", "prismatic": "slides", "fixed": "fixed"}
_KINDS |= dict.fromkeys(("floating", "planar"), "other")
_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_LONG = {"radius": 1, "length": 1}
_SIZES: dict[Any, dict[str, int]] = {"box": {"size": 3}, "sphere": {"radius": 1}, "cylinder": _LONG, "capsule": _LONG}
"""By kind of shape, the attributes of its size, and how many numbers each has."""


def read_urdf(path: Path, root: ET.Element, limits: Limits) -> ModelFile:
    """Reads a URDF whose XML has been parsed. Raises ModelError: its joints are no tree, a number is malformed, or a
    link's mass is negative. LimitError: a chain of joints is too long.
    """
    try:
        links = _tree(root)
        shapes = tuple(shape for link in root.findall("link") for shape in _link_shapes(link))
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error
    depth = [0] * len(links)
    for k, link in enumerate(links[1:], start=1):
        depth[k] = depth[link.parent] + 1
        limits.require("depth", depth[k], path, "joints one behind the other")
    meshed = {_name(link) for link in root.findall("link") if link.find(".//mesh") is not None}
    file = ModelFile(path, root.get("name") or path.stem, links, links[0].name, {}, shapes)
    return replace(file, trunk=_trunk_name(file, meshed))


def _tree(root: ET.Element) -> tuple[FileLink, ...]:
    """The links from the root outwards, joints on one link by their names. A root that floats on a link, such as the
    world, is the root.
    """
    elements, joints = _by_name(root, "link"), _by_name(root, "joint")
    ends = {name: (_end(joints[name], "parent", elements), _end(joints[name], "child", elements)) for name in joints}
    below: dict[str, list[str]] = {link: [] for link in elements}
    above: dict[str, str] = {}
    for name in sorted(joints):
        parent, child = ends[name]
        below[parent].append(name)
        if (other := above.setdefault(child, name)) != name:
            raise ModelError(f"link {child!r} has two parents, by joints {other!r} and {name!r}")
    roots = [link for link in elements if link not in above]
    if len(roots) != 1:
        raise ModelError(f"a robot has one root link, and the file {', '.join(roots) or 'none'}")
    start, first = roots[0], next(iter(below[roots[0]]), "")
    if first and joints[first].get("type") == "floating":
        start = ends[first][1]
    found = [FileLink(start, -1, np.eye(3), np.zeros(3), _body(elements[start]))]
    waiting = [(0, name) for name in reversed(below[start])]
    while waiting:
        at, name = waiting.pop()
        link, pose = ends[name][1], _pose(joints[name], joints[name].find("origin"))
        waiting += [(len(found), each) for each in reversed(below[link])]
        found.append(FileLink(link, at, *pose, _body(elements[link]), _joint(joints[name])))
    if start == roots[0] and len(found) < len(elements):
        raise ModelError("its joints form a ring")
    return tuple(found)


def _by_name(root: ET.Element, tag: str) -> dict[str, ET.Element]:
    found = {_name(each): each for each in root.findall(tag)}
    if len(found) < len(root.findall(tag)):
        raise ModelError(f"two {tag}s have one name")
    return found


def _joint(joint: ET.Element) -> FileJoint | None:
    """The joint of an element; None if it is fixed."""
    name, kind = _name(joint), joint.get("type", "")
    if kind not in _KINDS:
        raise ModelError(f"joint {name!r} is of type {kind!r}; valid: {', '.join(_KINDS)}")
    found, axis = joint.find("axis"), np.array([1.0, 0.0, 0.0])
    if found is not None:
        axis = np.array(_read_numbers(joint, found, "xyz", 3))
    if _KINDS[kind] == "fixed":
        return None
    if _KINDS[kind] != "other" and not (length := float(np.linalg.norm(axis))) > 0.0:
        raise ModelError(f"joint {name!r} has an axis of no length")
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    if limit is None and kind in ("revolute", "prismatic"):
        raise ModelError(f"joint {name!r} is of type {kind} and has no <limit>")
    limits, torques = JointLimits(), JointDynamics()
    if limit is not None:
        lower, upper = (_read_numbers(joint, limit, each, 1)[0] for each in ("lower", "upper"))
        most = [_read_numbers(joint, limit, each, 1, required=True)[0] for each in ("velocity", "effort")]
        limits = JointLimits(*((-np.inf, np.inf) if kind == "continuous" else (lower, upper)), *most)
    if dynamics is not None:
        damping, friction = (_read_numbers(joint, dynamics, each, 1)[0] for each in ("damping", "friction"))
        torques = JointDynamics(viscous=damping, coulomb=friction)
    return FileJoint(name, _KINDS[kind], axis / (length if _KINDS[kind] != "other" else 1.0), limits, torques)


def _trunk_name(file: ModelFile, meshed: set[str], dummy: float = 1e-3) -> str:
    """The root link; if that is only the root of the tree (no mesh, and a mass of less than a share `dummy`), the
    heaviest link with a shape that is fixed to it at identity.
    """
    root, shown = file.links[0], meshed | {shape.link for shape in file.shapes}
    there = [
        link
        for link, (at, R, p) in zip(file.links, file.carried(file.joints), strict=True)
        if at == 0 and link.name in shown and max(np.abs(R - np.eye(3)).max(), np.abs(p).max()) < 1e-9
    ]
    heaviest = max(there, key=lambda link: link.body.mass, default=root)
    is_dummy = root.name not in meshed and root.body.mass < dummy * heaviest.body.mass
    return (heaviest if is_dummy else root).name


# -- elements of the XML ----------------------------------------------------------------------------------------------
def _name(element: ET.Element) -> str:
    name = element.get("name")
    if not name:
        raise ModelError(f"a {element.tag} has no name")
    return name


def _end(joint: ET.Element, tag: str, links: Collection[str]) -> str:
    """The link at one end of a joint, its parent or child, one of the file's."""
    end = joint.find(tag)
    if end is None or not (link := end.get("link")):
        raise ModelError(f"joint {_name(joint)!r} has no {tag} link")
    if link not in links:
        raise ModelError(f"joint {_name(joint)!r} is on link {link!r}, which the file does not have")
    return link


def _body(link: ET.Element) -> InertialParameters:
    """A link's own ten parameters in its frame; zero without an inertial."""
    inertial = link.find("inertial")
    if inertial is None:
        return InertialParameters.zero()
    mass, tensor = inertial.find("mass"), inertial.find("inertia")
    if mass is None or tensor is None:
        raise ModelError(f"link {_name(link)!r}: its <inertial> needs <mass> and <inertia>")
    rotation, translation = _pose(link, inertial.find("origin"))
    components = [_read_numbers(link, tensor, name, 1, required=True)[0] for name in _TENSOR]
    value = _read_numbers(link, mass, "value", 1, required=True)[0]
    return InertialParameters(np.array([value, 0.0, 0.0, 0.0, *components])).transformed(rotation, translation)


def _link_shapes(link: ET.Element) -> list[Shape]:
    """Primitive shapes of one link: its collision shapes, or its visual ones if it has no primitive collision."""
    for kind in ("collision", "visual"):
        shapes = [shape for element in link.findall(kind) if (shape := _shape(link, element))]
        if shapes:
            return shapes
    return []


def _shape(link: ET.Element, element: ET.Element) -> Shape | None:
    for kind, sizes in _SIZES.items():
        if (found := element.find(f"geometry/{kind}")) is not None:
            size = [_read_numbers(link, found, attribute, count) for attribute, count in sizes.items()]
            return Shape(_name(link), kind, sum(size, ()), *_pose(link, element.find("origin")))
    return None


def _pose(owner: ET.Element, origin: ET.Element | None) -> tuple[Array, Array]:
    if origin is None:
        return np.eye(3), np.zeros(3)
    turn, place = (_read_numbers(owner, origin, attribute, 3) for attribute in ("rpy", "xyz"))
    (a, b, c), (ca, cb, cc) = np.sin(turn), np.cos(turn)  # of roll, pitch and yaw about fixed axes
    x, y = [cc * cb, cc * b * a - c * ca, cc * b * ca + c * a], [c * cb, c * b * a + cc * ca, c * b * ca - cc * a]
    return np.array([x, y, [-b, cb * a, cb * ca]]), np.array(place)


def _read_numbers(
    owner: ET.Element, element: ET.Element, attribute: str, count: int, required: bool = False
) -> tuple[float, ...]:
    """The numbers of an attribute; zeros if it is absent."""
    text = element.get(attribute)
    if text is None and not required:
        return (0.0,) * count
    try:
        found = tuple(float(word) for word in (text or "").split())
    except ValueError:
        found = ()
    if len(found) != count or not np.isfinite(found).all():
        what = f"<{element.tag} {attribute}={text!r}>" if text is not None else f"<{element.tag}> without {attribute}:"
        raise ModelError(f"{owner.tag} {_name(owner)!r}: {what} needs {count} number(s), with decimal points")
    return found
