"""What the two writers of model files share: an XML document that keeps its comments, and a note at its top."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.dom import minidom
from xml.parsers.expat import ExpatError

from stadera.errors import ModelError
from stadera.robot.model import Array, JointDynamics


def parse_document(path: Path) -> minidom.Document:
    """The whole file, comments included.

    Raises:
        ModelError: not XML.
    """
    try:
        return minidom.parse(str(path))
    except ExpatError as error:
        raise ModelError(f"{path}: not XML ({error})") from error


def named(document: minidom.Document, tag: str, name: str, source: Path) -> minidom.Element:
    """The element of that tag and name, among those that stand for a body or joint of the model.

    Raises:
        ModelError: it is not there, as with bodies that a model attaches from another file.
    """
    for element in document.getElementsByTagName(tag):
        if element.getAttribute("name") == name:
            return element
    raise ModelError(f"{source}: no <{tag} name={name!r}> in the file itself to write the values into")


def children(element: minidom.Element, tag: str) -> list[minidom.Element]:
    """Direct children of that tag."""
    return [node for node in element.childNodes if isinstance(node, minidom.Element) and node.tagName == tag]


def put_child(parent: minidom.Element, child: minidom.Element) -> None:
    """Put a child in the place of the first of its tag, or first of all; further ones of its tag go."""
    present = children(parent, child.tagName)
    if present:
        parent.replaceChild(child, present[0])
        for extra in present[1:]:
            parent.removeChild(extra)
    else:
        parent.insertBefore(child, parent.firstChild)


def element(document: minidom.Document, tag: str, attributes: Mapping[str, str]) -> minidom.Element:
    """A new element with these attributes."""
    made = document.createElement(tag)
    for name, value in attributes.items():
        made.setAttribute(name, value)
    return made


def numbers(values: Iterable[float] | Array) -> str:
    """Numbers in full precision, as XML attributes of both formats want them."""
    return " ".join(repr(float(value)) for value in values)


def describe(
    document: minidom.Document,
    links: Iterable[str],
    dynamics: Mapping[str, JointDynamics],
    without_place: tuple[str, ...],
) -> None:
    """A comment in front of the root that says what was written, and tells the joint values the format cannot hold."""
    lines = [
        "Written by stadera. Inertial values of these links are those of all that moves with the link, and the "
        f"inertials of the bodies fixed to it were taken away: {', '.join(links) or 'none'}.",
        f"Joint friction written for: {', '.join(dynamics) or 'none'}.",
    ]
    left = [(j, kind, getattr(d, kind)) for j, d in dynamics.items() for kind in without_place if getattr(d, kind)]
    units = {"armature": "kg m^2", "offset": "N m"}
    if left:
        told = "; ".join(f"{joint} {kind} {value!r} {units[kind]}" for joint, kind, value in left)
        lines.append(f"Values that this format has no place for: {told}.")
    remark(document, *lines)


def remark(document: minidom.Document, *lines: str) -> None:
    """A comment in front of the root."""
    text = "\n  ".join(lines).replace("--", "- -")
    document.insertBefore(document.createComment(f"\n  {text}\n"), document.documentElement)
