"""Writes inertial parameters, joint friction and a payload into the XML of a URDF."""

from collections.abc import Mapping
from pathlib import Path
from xml.dom import minidom

from stadera.inertia import InertialParameters
from stadera.robot import xml
from stadera.robot.model import JointDynamics
from stadera.robot.xml import PayloadLink, element, named, numbers
from stadera.types import Array


def write_urdf(
    source: Path,
    inertias: Mapping[str, InertialParameters],
    fixed: Mapping[str, list[str]],
    dynamics: Mapping[str, JointDynamics],
) -> minidom.Document:
    """Writes these inertias (by moving link, in its frame), none for the bodies fixed to it, and these joints' friction
    into the URDF `source`; armature and offset go into a comment.
    """
    document = xml.parse_document(source)
    for link, inertia in inertias.items():
        inertial = _inertial(document, inertia.mass, inertia.com, inertia.inertia_com)
        xml.put_child(named(document, "link", link, source), inertial)
        for name in fixed[link]:
            body = named(document, "link", name, source)
            for inertial in xml.children(body, "inertial"):
                body.removeChild(inertial)
    for joint, values in dynamics.items():
        joint_element = named(document, "joint", joint, source)
        present = xml.children(joint_element, "dynamics")
        target = present[0] if present else joint_element.appendChild(document.createElement("dynamics"))
        target.setAttribute("damping", numbers(values.viscous))
        target.setAttribute("friction", numbers(values.coulomb))
    xml.describe(document, inertias, dynamics, ("armature", "offset"))
    return document


def add_payload(document: minidom.Document, trunk: str, payload: PayloadLink) -> None:
    """Adds the payload's link, and the fixed joint that connects it to the trunk. Raises ModelError: the file already
    has a link or a joint of that name.
    """
    joint_name = f"{payload.name}_joint"
    xml.check_free(document, "link", payload.name)
    xml.check_free(document, "joint", joint_name)
    inertial = _inertial(document, payload.body.mass, (0.0, 0.0, 0.0), payload.tensor)
    link = element(document, "link", {"name": payload.name}, inertial)
    joint = element(
        document,
        "joint",
        {"name": joint_name, "type": "fixed"},
        element(document, "origin", {"xyz": numbers(payload.body.com), "rpy": "0 0 0"}),
        element(document, "parent", {"link": trunk}),
        element(document, "child", {"link": payload.name}),
    )
    xml.append_after_comment(document, xml.root_of(document), payload.comment, (link, joint))


def _inertial(
    document: minidom.Document, mass: float, com: Array | tuple[float, ...], tensor: Array
) -> minidom.Element:
    """The <inertial> element; URDF states the inertia about the centre of mass, here in the link's own axes."""
    components = {f"i{'xyz'[i]}{'xyz'[j]}": numbers(tensor[i, j]) for i in range(3) for j in range(i, 3)}
    return element(
        document,
        "inertial",
        {},
        element(document, "origin", {"xyz": numbers(com), "rpy": "0 0 0"}),
        element(document, "mass", {"value": numbers(mass)}),
        element(document, "inertia", components),
    )
