"""Writes inertial parameters, joint dynamics and a payload into the XML of an MJCF."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.dom import minidom

import numpy as np

from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.robot import xml
from stadera.robot.model import JointDynamics
from stadera.robot.xml import PayloadLink, element, named, numbers
from stadera.types import Array


def write_mjcf(
    source: Path,
    target: Path,
    inertias: Mapping[str, InertialParameters],
    origins: Mapping[str, Array],
    fixed: Mapping[str, list[str]],
    dynamics: Mapping[str, JointDynamics],
) -> minidom.Document:
    """Writes these inertias, zero ones for `fixed` bodies, and these joints' dynamics into the MJCF `source`.

    Included files are merged, as an include means. Default classes stay: values are written to the elements themselves,
    which overrides them.

    Args:
        target: the file to be written; if it is in another folder, relative asset folders become absolute.
        inertias: by moving link, in the link's frame (the body's axes, origin at the joint's anchor).
        origins: by moving link, the body's origin in the link's frame [m]. fixed: by moving link, the bodies fixed to
            it.
        dynamics: by joint; the offset goes into a comment.

    Raises:
        ModelError: an inertia that MuJoCo would refuse, or a file whose inertias are all computed from its shapes.
    """
    document = xml.parse_document(source)
    _draw_in_includes(document, source.parent)
    _check_compiler(document, source)
    if target.resolve().parent != source.resolve().parent:
        _point_to_assets(document, source.resolve().parent)
    for link, inertia in inertias.items():
        about_body = inertia.shifted(-origins[link])
        _check_possible(link, about_body)
        inertial = _inertial(document, about_body.mass, about_body.com, about_body.inertia_com)
        xml.put_child(named(document, "body", link, source), inertial)
        for name in fixed[link]:
            nothing = {"pos": "0 0 0", "mass": "0", "diaginertia": "0 0 0"}
            xml.put_child(named(document, "body", name, source), element(document, "inertial", nothing))
    for joint, values in dynamics.items():
        joint_element = named(document, "joint", joint, source)
        joint_element.setAttribute("damping", numbers(values.viscous))
        joint_element.setAttribute("frictionloss", numbers(values.coulomb))
        joint_element.setAttribute("armature", numbers(values.armature))
    xml.describe(document, inertias, dynamics, ("offset",))
    return document


def add_payload(document: minidom.Document, trunk: minidom.Element, origin: Array, payload: PayloadLink) -> None:
    """Adds the payload as a body without joints to the trunk, whose body origin (3,) [m] is given in the trunk frame.
    Raises ModelError: the file has a body of that name already.
    """
    xml.check_free(document, "body", payload.name)
    inertial = _inertial(document, payload.body.mass, np.zeros(3), payload.tensor)
    body = element(document, "body", {"name": payload.name, "pos": numbers(payload.body.com - origin)}, inertial)
    xml.append_after_comment(document, trunk, payload.comment, (body,))


def _inertial(document: minidom.Document, mass: float, com: Array, tensor: Array) -> minidom.Element:
    """Principal moments about the centre of mass, and the rotation to their axes (quaternion wxyz)."""
    from scipy.spatial.transform import Rotation

    moments, axes = np.linalg.eigh(tensor)
    axes[:, 2] *= np.linalg.det(axes)
    attributes = {
        "pos": numbers(com),
        "quat": numbers(Rotation.from_matrix(axes).as_quat(scalar_first=True)),
        "mass": numbers(mass),
        "diaginertia": numbers(np.maximum(moments, 0.0)),
    }
    return element(document, "inertial", attributes)


def _check_possible(link: str, inertia: InertialParameters) -> None:
    moments = np.linalg.eigvalsh(inertia.inertia_com)
    if not (moments > 0).all() or moments[0] + moments[1] < moments[2]:
        raise ModelError(
            f"link {link!r} has principal moments {', '.join(f'{m:.6g}' for m in moments)} kg·m², which no body has "
            "and MJCF does not hold; identify it physically consistent"
        )


def _draw_in_includes(document: minidom.Document, folder: Path) -> None:
    while includes := document.getElementsByTagName("include"):
        include = includes[0]
        parent, inner = include.parentNode, xml.parse_document(folder / include.getAttribute("file")).documentElement
        if inner is None or not isinstance(parent, minidom.Element):
            raise ModelError(f"{folder / include.getAttribute('file')}: an include that is not inside the model")
        for node in list(inner.childNodes):
            copy: Any = document.importNode(node, True)
            parent.insertBefore(copy, include)
        parent.removeChild(include)


def _check_compiler(document: minidom.Document, source: Path) -> None:
    for compiler in document.getElementsByTagName("compiler"):
        if compiler.getAttribute("inertiafromgeom") == "true" or compiler.hasAttribute("settotalmass"):
            raise ModelError(f"{source}: its compiler makes inertias itself (inertiafromgeom or settotalmass)")


def _point_to_assets(document: minidom.Document, folder: Path) -> None:
    """Makes the folders of meshes and textures absolute; both default to the model's own folder."""
    root = xml.root_of(document)
    if not document.getElementsByTagName("asset"):
        return
    if not xml.children(root, "compiler"):
        xml.put_child(root, document.createElement("compiler"))
    compilers = xml.children(root, "compiler")
    kinds = ("assetdir", "meshdir", "texturedir")
    said = {name: c.getAttribute(name) for c in compilers for name in kinds if c.hasAttribute(name)}
    for name in ("meshdir", "texturedir"):
        relative = said.get(name, said.get("assetdir", ""))
        for compiler in compilers:
            compiler.setAttribute(name, str(folder / relative))
