"""A payload as a link of its own in a model file: fixed to the trunk, with its frame in its centre of mass."""

from __future__ import annotations

from dataclasses import dataclass
from xml.dom import minidom

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.robot.model import Array
from stadera.robot.write_xml import element, numbers


@dataclass(frozen=True, eq=False)
class PayloadLink:
    """What is fixed to the trunk.

    Attributes:
        body: its ten parameters, in the trunk frame. A tensor of zero about its centre of mass makes it a point mass.
        name: of the link.
        note: what whoever reads the file should know of the numbers; one sentence, or empty.

    Raises:
        ModelError: a mass that is not positive.
    """

    body: InertialParameters
    name: str = "payload"
    note: str = ""

    def __post_init__(self) -> None:
        if not self.body.mass > 0:
            raise ModelError(f"a payload needs a positive mass to be a link, got {self.body.mass:.6g} kg")

    @property
    def tensor(self) -> Array:
        """About its centre of mass, trunk axes, (3, 3) [kg·m²]; what rounding leaves of a point mass is zero."""
        tensor = self.body.inertia_com
        return np.where(np.abs(tensor) < 1e-12 * np.abs(self.body.inertia).max(), 0.0, tensor)


def add_to_urdf(document: minidom.Document, trunk: str, payload: PayloadLink) -> None:
    """Adds a link, and the fixed joint it hangs on.

    Raises:
        ModelError: the file has a link or a joint of that name already.
    """
    root, joint_name = _root(document), f"{payload.name}_joint"
    _check_free(document, ("link", payload.name), ("joint", joint_name))
    tensor = payload.tensor
    components = {f"i{'xyz'[i]}{'xyz'[j]}": numbers([tensor[i, j]]) for i in range(3) for j in range(i, 3)}
    inertial = document.createElement("inertial")
    inertial.appendChild(element(document, "origin", {"xyz": "0 0 0", "rpy": "0 0 0"}))
    inertial.appendChild(element(document, "mass", {"value": numbers([payload.body.mass])}))
    inertial.appendChild(element(document, "inertia", components))
    link = element(document, "link", {"name": payload.name})
    link.appendChild(inertial)
    joint = element(document, "joint", {"name": joint_name, "type": "fixed"})
    joint.appendChild(element(document, "origin", {"xyz": numbers(payload.body.com), "rpy": "0 0 0"}))
    joint.appendChild(element(document, "parent", {"link": trunk}))
    joint.appendChild(element(document, "child", {"link": payload.name}))
    _append(document, root, payload, link, joint)


def add_to_mjcf(document: minidom.Document, trunk: minidom.Element, origin: Array, payload: PayloadLink) -> None:
    """Adds a body without joints to the trunk's body, whose origin (3,) [m] is given in the trunk frame.

    Raises:
        ModelError: the file has a body of that name already.
    """
    _check_free(document, ("body", payload.name))
    moments, axes = np.linalg.eigh(payload.tensor)
    axes[:, 2] *= np.linalg.det(axes)
    inertial = {
        "pos": "0 0 0",
        "quat": numbers(Rotation.from_matrix(axes).as_quat(scalar_first=True)),
        "mass": numbers([payload.body.mass]),
        "diaginertia": numbers(np.maximum(moments, 0.0)),
    }
    body = element(document, "body", {"name": payload.name, "pos": numbers(payload.body.com - origin)})
    body.appendChild(element(document, "inertial", inertial))
    _append(document, trunk, payload, body)


def _append(document: minidom.Document, parent: minidom.Element, payload: PayloadLink, *nodes: minidom.Element) -> None:
    what = f" {payload.name}: the load that was weighed. {payload.note} ".replace("--", "- -")
    parent.appendChild(document.createTextNode("\n  "))
    parent.appendChild(document.createComment(what))
    for node in nodes:
        parent.appendChild(document.createTextNode("\n  "))
        parent.appendChild(node)
    parent.appendChild(document.createTextNode("\n"))


def _check_free(document: minidom.Document, *taken: tuple[str, str]) -> None:
    for tag, name in taken:
        if any(node.getAttribute("name") == name for node in document.getElementsByTagName(tag)):
            raise ModelError(f"the model has a {tag} {name!r} already; a payload needs a name of its own")


def _root(document: minidom.Document) -> minidom.Element:
    root = document.documentElement
    if root is None:
        raise ModelError("an XML document without a root")
    return root
