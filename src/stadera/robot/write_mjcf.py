"""Writes inertial parameters and joint dynamics into the XML of an MJCF."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.dom import minidom

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.robot.model import Array, JointDynamics
from stadera.robot.write_xml import children, describe, element, named, numbers, parse_document, put_child


def write_mjcf(
    source: Path,
    target: Path,
    inertias: Mapping[str, InertialParameters],
    origins: Mapping[str, Array],
    fixed: Mapping[str, list[str]],
    dynamics: Mapping[str, JointDynamics],
) -> minidom.Document:
    """The MJCF `source` with these inertias, those of `fixed` bodies zero, and these joints' dynamics.

    Included files are drawn in, which is what an include means; default classes stay, and what is written here is
    stated on the element itself and so wins over them.

    Args:
        source: the file.
        target: where it will be written; elsewhere than the source, relative asset folders become absolute.
        inertias: by moving link, in the link's frame (the body's axes, origin at the joint's anchor).
        origins: by moving link, the body's origin in the link's frame [m].
        fixed: by moving link, the bodies fixed to it.
        dynamics: by joint; offset goes to a comment.

    Raises:
        ModelError: an inertia that MuJoCo would refuse, or a file whose inertias are all made from its shapes.
    """
    document = parse_document(source)
    _draw_in_includes(document, source.parent)
    _check_compiler(document, source)
    if target.resolve().parent != source.resolve().parent:
        _point_to_assets(document, source.resolve().parent)
    for link, inertia in inertias.items():
        about_body = inertia.shifted(-origins[link])
        put_child(named(document, "body", link, source), element(document, "inertial", _inertial(link, about_body)))
        for name in fixed[link]:
            nothing = {"pos": "0 0 0", "mass": "0", "diaginertia": "0 0 0"}
            put_child(named(document, "body", name, source), element(document, "inertial", nothing))
    for joint, values in dynamics.items():
        joint_element = named(document, "joint", joint, source)
        joint_element.setAttribute("damping", numbers([values.viscous]))
        joint_element.setAttribute("frictionloss", numbers([values.coulomb]))
        joint_element.setAttribute("armature", numbers([values.armature]))
    describe(document, inertias, dynamics, ("offset",))
    return document


def _inertial(link: str, inertia: InertialParameters) -> dict[str, str]:
    """Principal moments about the centre of mass and the turn to their axes (quaternion wxyz)."""
    moments, axes = np.linalg.eigh(inertia.inertia_com)
    if not (moments > 0).all() or moments[0] + moments[1] < moments[2]:
        raise ModelError(
            f"link {link!r} has principal moments {', '.join(f'{m:.6g}' for m in moments)} kg·m², which no body has "
            "and MJCF does not hold; identify it physically consistent"
        )
    axes[:, 2] *= np.linalg.det(axes)
    quaternion = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    return {
        "pos": numbers(inertia.com),
        "quat": numbers(quaternion),
        "mass": numbers([inertia.mass]),
        "diaginertia": numbers(moments),
    }


def _draw_in_includes(document: minidom.Document, folder: Path) -> None:
    while includes := document.getElementsByTagName("include"):
        include = includes[0]
        parent, inner = include.parentNode, parse_document(folder / include.getAttribute("file")).documentElement
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
    """Make the folders of meshes and textures absolute; both are the model's own folder where nothing is said."""
    root = document.documentElement
    if root is None or not document.getElementsByTagName("asset"):
        return
    if not children(root, "compiler"):
        put_child(root, document.createElement("compiler"))
    compilers = children(root, "compiler")
    kinds = ("assetdir", "meshdir", "texturedir")
    said = {name: c.getAttribute(name) for c in compilers for name in kinds if c.hasAttribute(name)}
    for name in ("meshdir", "texturedir"):
        relative = said.get(name, said.get("assetdir", ""))
        for compiler in compilers:
            compiler.setAttribute(name, str(folder / relative))
