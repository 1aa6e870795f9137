"""Reads and writes URDF: bodies and joints through Pinocchio, shapes and single links from the XML.

urdfdom ignores an inertial that it cannot parse (ixx="0,05"). So every number that is used is parsed here as well, and
Pinocchio's inertia of each moving link is compared with the sum over the links fixed to it.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import pinocchio as pin

from stadera.constants import ROUNDING, SAME
from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.limits import Limits
from stadera.robot.model import JointDynamics, Shape
from stadera.robot.modelfile import ModelFile
from stadera.robot.xml import Document, PayloadLink, check_free, description, element, named, numbers, put_child
from stadera.types import Array

_DUMMY_MASS_RATIO = 1e-3  # a root this light compared with its fixed child is only the root of the tree
_JOINT_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1, "velocity": 1, "effort": 1},
    "dynamics": {"damping": 1, "friction": 1},
}
_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_Kind = Literal["box", "sphere", "cylinder", "capsule"]
_SIZES: dict[_Kind, tuple[tuple[str, int], ...]] = {
    "box": (("size", 3),),
    "sphere": (("radius", 1),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
}


def read_urdf(path: Path, root: ET.Element) -> ModelFile:
    """Reads a URDF whose XML has been parsed, and whose chains of joints are short enough (`require_depth`). Raises
    ModelError: Pinocchio cannot build a model from it, a number is malformed, or a link's mass is negative.
    """
    try:
        bodies = {_name(link): _body(link) for link in root.findall("link")}
        shapes = tuple(shape for link in root.findall("link") for shape in _link_shapes(link))
        children = {_name(joint): _child(joint) for joint in root.findall("joint")}
        for joint in root.findall("joint"):
            _check_joint(joint)
        model = _build(ET.tostring(root, "unicode"))
        _check_bodies(model, bodies)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error
    masses = {link: body.mass for link, body in bodies.items()}
    return ModelFile(
        path=path,
        name=root.get("name") or path.stem,
        model=model,
        trunk=_trunk_name(model, masses, _with_mesh(root), {shape.link for shape in shapes}),
        links={name: children[name] for name in model.names if name in children},
        masses=masses,
        shapes=shapes,
    )


def require_depth(root: ET.Element, path: Path, limits: Limits) -> None:
    """Checks the length of the chains of joints in a URDF. Raises LimitError: a chain is too long."""
    links = ((joint.find("parent"), joint.find("child")) for joint in root.findall("joint"))
    above = {c.get("link"): p.get("link") for p, c in links if p is not None and c is not None}
    depth: dict[str | None, int] = {}
    for link in above:
        chain: list[str | None] = []
        while link in above and link not in depth and len(chain) <= limits.depth:
            chain.append(link)
            link = above[link]
        for k, one in enumerate(reversed(chain), start=1 + depth.get(link, 0)):
            depth[one] = k
            limits.require("depth", k, path, "joints one behind the other")


def _build(text: str) -> Any:
    try:
        model = pin.buildModelFromXML(text)
        if model.njoints < 2 or model.joints[1].shortname() != "JointModelFreeFlyer":
            model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"not a URDF that Pinocchio can build: {str(error).splitlines()[0]}") from error
    return model


def _check_bodies(model: Any, bodies: Mapping[str, InertialParameters]) -> None:
    """Compares each of Pinocchio's moving bodies with the sum of the file's links on it."""
    expected: dict[int, InertialParameters] = {}
    links: dict[int, list[str]] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name in bodies:
            joint, pose = frame.parentJoint, frame.placement
            body = bodies[frame.name].transformed(pose.rotation, pose.translation)
            expected[joint] = expected.get(joint, InertialParameters.zero()) + body
            links.setdefault(joint, []).append(frame.name)
    for joint, body in expected.items():
        found = InertialParameters.from_pinocchio(model.inertias[joint]).vector
        size = np.repeat([np.linalg.norm(part) for part in np.split(body.vector, [1, 4])], [1, 3, 6])
        if joint and (np.abs(found - body.vector) > SAME * size + ROUNDING).any():
            raise ModelError(f"Pinocchio reads other inertial values than the file states: {', '.join(links[joint])}")


def _trunk_name(model: Any, masses: Mapping[str, float], meshed: set[str], shaped: set[str]) -> str:
    """The root link; if that is a dummy (no mass, no mesh), the heaviest link with a shape that is fixed to it at
    identity.
    """
    fixed = [f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint == 1]
    root: str = fixed[0].name
    bodies = [f.name for f in fixed if f.placement.isIdentity(1e-9) and f.name in meshed | shaped]
    heaviest: str = max(bodies, key=lambda name: masses[name], default=root)
    dummy = root not in meshed and masses[root] < _DUMMY_MASS_RATIO * masses[heaviest]
    return heaviest if dummy else root


# -- elements of the XML ----------------------------------------------------------------------------------------------
def _with_mesh(root: ET.Element) -> set[str]:
    return {_name(link) for link in root.findall("link") if link.find(".//mesh") is not None}


def _name(element: ET.Element) -> str:
    name = element.get("name")
    if not name:
        raise ModelError(f"a {element.tag} has no name")
    return name


def _child(joint: ET.Element) -> str:
    child = joint.find("child")
    if child is None or not child.get("link"):
        raise ModelError(f"joint {_name(joint)!r} has no child link")
    return str(child.get("link"))


def _check_joint(joint: ET.Element) -> None:
    for tag, attributes in _JOINT_NUMBERS.items():
        if (element := joint.find(tag)) is not None:
            for attribute, count in attributes.items():
                _read_numbers(joint, element, attribute, count)


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
    for kind in get_args(_Kind):
        if (found := element.find(f"geometry/{kind}")) is not None:
            size = [_read_numbers(link, found, attribute, count) for attribute, count in _SIZES[kind]]
            return Shape(_name(link), kind, sum(size, ()), *_pose(link, element.find("origin")))
    return None


def _pose(owner: ET.Element, origin: ET.Element | None) -> tuple[Array, Array]:
    if origin is None:
        return np.eye(3), np.zeros(3)
    turn, place = (_read_numbers(owner, origin, attribute, 3) for attribute in ("rpy", "xyz"))
    return pin.rpy.rpyToMatrix(*turn), np.array(place)


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


# -- writing ---------------------------------------------------------------------------------------------------------
def write_urdf(
    document: Document,
    source: Path,
    inertias: Mapping[str, InertialParameters],
    fixed: Mapping[str, list[str]],
    dynamics: Mapping[str, JointDynamics],
) -> None:
    """Writes these inertias (by moving link, in its frame), none for the bodies fixed to it, and these joints' friction
    into the URDF `source`; armature and offset go into a comment.
    """
    root = document.root
    for link, inertia in inertias.items():
        put_child(named(root, "link", link, source), _inertial(inertia.mass, inertia.com, inertia.inertia_com))
        for name in fixed[link]:
            body = named(root, "link", name, source)
            for inertial in body.findall("inertial"):
                body.remove(inertial)
    for joint, values in dynamics.items():
        owner = named(root, "joint", joint, source)
        target = owner.find("dynamics")
        target = ET.SubElement(owner, "dynamics") if target is None else target
        target.attrib |= {"damping": numbers(values.viscous), "friction": numbers(values.coulomb)}
    document.remark(description(inertias, dynamics, ("armature", "offset")))


def add_payload(root: ET.Element, trunk: str, payload: PayloadLink) -> None:
    """Adds the payload's link, and the fixed joint that connects it to the trunk. Raises ModelError: the file already
    has a link or a joint of that name.
    """
    joint_name = f"{payload.name}_joint"
    check_free(root, "link", payload.name)
    check_free(root, "joint", joint_name)
    link = element("link", {"name": payload.name}, _inertial(payload.body.mass, np.zeros(3), payload.tensor))
    joint = element(
        "joint",
        {"name": joint_name, "type": "fixed"},
        element("origin", {"xyz": numbers(payload.body.com), "rpy": "0 0 0"}),
        element("parent", {"link": trunk}),
        element("child", {"link": payload.name}),
    )
    payload.append_to(root, link, joint)


def _inertial(mass: float, com: Array, tensor: Array) -> ET.Element:
    """The <inertial> element; URDF states the inertia about the centre of mass, here in the link's own axes."""
    components = {f"i{'xyz'[i]}{'xyz'[j]}": numbers(tensor[i, j]) for i in range(3) for j in range(i, 3)}
    return element(
        "inertial",
        {},
        element("origin", {"xyz": numbers(com), "rpy": "0 0 0"}),
        element("mass", {"value": numbers(mass)}),
        element("inertia", components),
    )
