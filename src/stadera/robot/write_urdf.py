"""Writes inertial parameters and joint friction into the XML of a URDF."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.dom import minidom

from stadera.inertia import InertialParameters
from stadera.robot.model import JointDynamics
from stadera.robot.write_xml import children, describe, element, named, numbers, parse_document, put_child


def write_urdf(
    source: Path,
    inertias: Mapping[str, InertialParameters],
    fixed: Mapping[str, list[str]],
    dynamics: Mapping[str, JointDynamics],
) -> minidom.Document:
    """The URDF `source` with these inertias, those of `fixed` bodies taken away, and these joints' friction.

    Args:
        source: the file.
        inertias: by moving link, in the link's frame.
        fixed: by moving link, the links fixed to it.
        dynamics: by joint; armature and offset go to a comment.
    """
    document = parse_document(source)
    for link, inertia in inertias.items():
        put_child(named(document, "link", link, source), _inertial(document, inertia))
        for name in fixed[link]:
            body = named(document, "link", name, source)
            for inertial in children(body, "inertial"):
                body.removeChild(inertial)
    for joint, values in dynamics.items():
        joint_element = named(document, "joint", joint, source)
        present = children(joint_element, "dynamics")
        target = present[0] if present else joint_element.appendChild(document.createElement("dynamics"))
        target.setAttribute("damping", numbers([values.viscous]))
        target.setAttribute("friction", numbers([values.coulomb]))
    describe(document, inertias, dynamics, ("armature", "offset"))
    return document


def _inertial(document: minidom.Document, inertia: InertialParameters) -> minidom.Element:
    """URDF states the inertia about the centre of mass, here in the link's own axes."""
    inertial = document.createElement("inertial")
    tensor = inertia.inertia_com
    components = {f"i{'xyz'[i]}{'xyz'[j]}": numbers([tensor[i, j]]) for i in range(3) for j in range(i, 3)}
    inertial.appendChild(element(document, "origin", {"xyz": numbers(inertia.com), "rpy": "0 0 0"}))
    inertial.appendChild(element(document, "mass", {"value": numbers([inertia.mass])}))
    inertial.appendChild(element(document, "inertia", components))
    return inertial
