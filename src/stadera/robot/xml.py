"""XML documents that keep their comments, and a payload's link, for the writers of both formats."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.dom import minidom

import numpy as np

from stadera.boundary import foreign
from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.robot.model import JointDynamics
from stadera.robot.xmltree import expanded, is_xacro
from stadera.types import Array

_UNITS = {"armature": "kg m^2", "offset": "N m"}


def parse_document(path: Path) -> minidom.Document:
    """Parses a whole file, comments included; a xacro after expansion. Raises ModelError: not XML."""
    with foreign(path, "not XML", ModelError):
        return minidom.parseString(expanded(path)) if is_xacro(path) else minidom.parse(str(path))


def root_of(document: minidom.Document) -> minidom.Element:
    """The root element. Raises ModelError: there is none."""
    if document.documentElement is None:
        raise ModelError("an XML document without a root")
    return document.documentElement


def named(document: minidom.Document, tag: str, name: str, source: Path) -> minidom.Element:
    """The element with that tag and name. Raises ModelError: there is none, as for bodies that a model attaches from
    another file.
    """
    for element in document.getElementsByTagName(tag):
        if element.getAttribute("name") == name:
            return element
    raise ModelError(f"{source}: no <{tag} name={name!r}> in the file itself to write the values into")


def check_free(document: minidom.Document, tag: str, name: str) -> None:
    """Checks that no element of that tag has this name. Raises ModelError: there is one."""
    if any(node.getAttribute("name") == name for node in document.getElementsByTagName(tag)):
        raise ModelError(f"the model has a {tag} {name!r} already; a payload needs another name")


def children(element: minidom.Element, tag: str) -> list[minidom.Element]:
    """Direct children of that tag."""
    return [node for node in element.childNodes if isinstance(node, minidom.Element) and node.tagName == tag]


def put_child(parent: minidom.Element, child: minidom.Element) -> None:
    """Replaces the first child of the same tag, or inserts the child first; further children of its tag are removed."""
    present = children(parent, child.tagName)
    if present:
        parent.replaceChild(child, present[0])
        for extra in present[1:]:
            parent.removeChild(extra)
    else:
        parent.insertBefore(child, parent.firstChild)


def element(
    document: minidom.Document, tag: str, attributes: Mapping[str, str], *inside: minidom.Element
) -> minidom.Element:
    """A new element with these attributes and children."""
    made = document.createElement(tag)
    for name, value in attributes.items():
        made.setAttribute(name, value)
    for child in inside:
        made.appendChild(child)
    return made


def numbers(*values: float | Iterable[float] | Array) -> str:
    """Numbers in full precision, for XML attributes of both formats."""
    flat = [v for value in values for v in (value if isinstance(value, Iterable) else (value,))]
    return " ".join(repr(float(value)) for value in flat)


def append_after_comment(
    document: minidom.Document, parent: minidom.Element, text: str, nodes: Iterable[minidom.Element]
) -> None:
    """Appends a comment and elements, each on its own line."""
    pieces: list[minidom.Comment | minidom.Element] = [comment(document, text), *nodes]
    for node in pieces:
        parent.appendChild(document.createTextNode("\n  "))
        parent.appendChild(node)
    parent.appendChild(document.createTextNode("\n"))


def describe(
    document: minidom.Document,
    links: Iterable[str],
    dynamics: Mapping[str, JointDynamics],
    without_place: tuple[str, ...],
) -> None:
    """Adds a comment before the root: the links and joints written, and joint values that the format cannot
    represent.
    """
    lines = [
        "Written by stadera. Inertial values of these links are those of all that moves with the link, and the "
        f"inertials of the bodies fixed to it were taken away: {', '.join(links) or 'none'}.",
        f"Joint friction written for: {', '.join(dynamics) or 'none'}.",
    ]
    left = [(j, kind, getattr(d, kind)) for j, d in dynamics.items() for kind in without_place if getattr(d, kind)]
    if left:
        listed = "; ".join(f"{joint} {kind} {value!r} {_UNITS[kind]}" for joint, kind, value in left)
        lines.append(f"Values that this format has no place for: {listed}.")
    remark(document, *lines)


def comment(document: minidom.Document, text: str) -> minidom.Comment:
    """A comment node; XML forbids two hyphens in it."""
    return document.createComment(text.replace("--", "- -"))


def remark(document: minidom.Document, *lines: str) -> None:
    """Inserts a comment before the root."""
    text = "\n  ".join(lines)
    document.insertBefore(comment(document, f"\n  {text}\n"), document.documentElement)


@dataclass(frozen=True, eq=False)
class PayloadLink:
    """The link to add: its ten parameters in the trunk frame (with a zero tensor about its centre of mass a point
    mass), its name, and one sentence on the accuracy of the values for readers of the file, or empty. Raises
    ModelError: the mass is not positive.
    """

    body: InertialParameters
    name: str = "payload"
    note: str = ""

    def __post_init__(self) -> None:
        if not self.body.mass > 0:
            raise ModelError(f"a payload needs a positive mass to be a link, got {self.body.mass:.6g} kg")

    @property
    def tensor(self) -> Array:
        """Inertia about its centre of mass, trunk axes, (3, 3) [kg·m²]; rounding errors of a point mass are set to
        zero.
        """
        tensor = self.body.inertia_com
        return np.where(np.abs(tensor) < 1e-12 * np.abs(self.body.inertia).max(), 0.0, tensor)

    @property
    def comment(self) -> str:
        """The comment before the link."""
        return f" {self.name}: the load that was weighed. {self.note} "
