"""XML of robot models: read within limits, changed, and written with its comments and the prefixes of its names.

A xacro is read after expansion by the package xacro (the extra of that name). Entities, which can expand without bound,
are not read.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from contextlib import redirect_stderr, suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import IO
from xml.dom.minidom import Element
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from stadera.errors import MissingExtraError, ModelError
from stadera.inertia import InertialParameters
from stadera.limits import DEFAULTS, Limits
from stadera.robot.model import JointDynamics
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class Document:
    """A root element with all comments in it, and the comments before it; each element with its attributes in the file
    and the place where its tag begins there [bytes]; the file, None for an expanded xacro.
    """

    root: ET.Element
    remarks: list[str]
    tags: list[tuple[ET.Element, dict[str, str], int]]
    path: Path | None

    def remark(self, text: str) -> None:
        """Adds a comment before the root."""
        self.remarks.append(plain(f"\n  {text}\n"))

    def write(self, stream: IO[str]) -> None:
        """Writes it to a stream in UTF-8; tags whose attributes are the file's stay as they are there."""
        comments = "".join(f"<!--{text}-->\n" for text in self.remarks)
        kept = {} if self.path is None else self._kept(self.path.read_bytes())
        stream.write(f'<?xml version="1.0" encoding="utf-8"?>\n{comments}')
        stream.writelines(_written(self.root, kept))
        stream.write("\n")

    def _kept(self, text: bytes) -> dict[ET.Element, str]:
        """The start tag of each element whose attributes are as in the file, as it is there."""
        kept = {}
        for element, attributes, begin in self.tags:
            if element.attrib == attributes and (tag := _TAG.match(text, begin)):
                with suppress(UnicodeDecodeError):  # of a file in another encoding
                    kept[element] = tag.group().decode()
        return kept


_TAG = re.compile(rb"""<(?:[^<>"']|"[^"]*"|'[^']*')*>""")


def _written(element: ET.Element, kept: Mapping[ET.Element, str]) -> Iterator[str]:
    """An element's text, without what follows it."""
    if callable(element.tag):  # a comment
        yield f"<!--{element.text}-->"
        return
    start = kept.get(element, "")
    if not start:
        attributes = "".join(f" {name}={quoteattr(value)}" for name, value in element.attrib.items())
        start = f"<{element.tag}{attributes}/>"
    if start.endswith("/>"):
        if not len(element) and not element.text:
            yield start
            return
        start = f"{start[:-2].rstrip()}>"
    yield start
    yield escape(element.text or "")
    for child in element:
        yield from _written(child, kept)
        yield escape(child.tail or "")
    yield f"</{element.tag}>"


class _TreeBuilder(ET.TreeBuilder):
    """Builds a tree from a file, and counts elements."""

    def __init__(self, path: Path, limits: Limits) -> None:
        super().__init__(insert_comments=True)
        self._path, self._limits, self._depth, self.remarks = path, limits, 0, list[str]()
        self.tags = list[tuple[ET.Element, dict[str, str], int]]()
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler, self.parser.EndElementHandler = self.start, self.end
        self.parser.CharacterDataHandler, self.parser.CommentHandler = self.data, self.remark
        self.parser.StartDoctypeDeclHandler = self.doctype

    def start(self, tag: str, attrs: dict[str, str]) -> ET.Element:  # type: ignore[override]
        self._depth += 1
        self._limits.require("elements", len(self.tags) + 1, self._path, "elements")
        self._limits.require("depth", self._depth, self._path, "elements in each other")
        element = super().start(tag, attrs)
        self.tags.append((element, dict(attrs), self.parser.CurrentByteIndex))
        return element

    def end(self, tag: str) -> ET.Element:
        self._depth -= 1
        return super().end(tag)

    def remark(self, text: str) -> None:
        """Keeps a comment, also one before the root."""
        if self._depth:
            self.comment(text)
        elif not self.tags:
            self.remarks.append(text)

    def doctype(self, *_: object) -> None:
        raise ModelError(f"{self._path}: a DOCTYPE, whose entities are not read; no robot's model needs one")


def read_xml(path: Path, limits: Limits = DEFAULTS) -> Document:
    """A file, a xacro expanded with its arguments' defaults.

    Raises:
        LimitError: more elements, or deeper nesting, than the limits allow. ModelError: a DOCTYPE, or as `expanded`.
        MissingExtraError: as `expanded`. expat.ExpatError, LookupError: not XML, or of an unknown encoding.
    """
    builder, xacro = _TreeBuilder(path, limits), is_xacro(path)
    for piece in [expanded(path)] if xacro else _pieces(path):
        builder.parser.Parse(piece)
    builder.parser.Parse(b"", True)
    return Document(builder.close(), builder.remarks, builder.tags, None if xacro else path)


def _pieces(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while piece := file.read(1 << 16):
            yield piece


def is_xacro(path: Path) -> bool:
    """True if a file must be expanded: by its name, or by the namespace of its root element."""
    if path.name.lower().endswith(".xacro"):
        return True
    with path.open("rb") as file:
        head = file.read(4096).decode(errors="replace")
    return any(name in head for name in ("xmlns:xacro=", "ros.org/wiki/xacro", "ros.org/xacro"))


def expanded(path: Path) -> str:
    """The text of a xacro, expanded. MissingExtraError if the package is not installed, ModelError if it cannot be
    expanded, such as for an argument without a default or a missing package.
    """
    by_hand = f"expand it where its packages are: xacro {path.name} > {path.name.split('.')[0]}.urdf"
    write = Element.writexml  # xacro replaces this for the whole process by a version that drops white space
    try:
        import xacro
    except ModuleNotFoundError as error:
        raise MissingExtraError("xacro", "xacro", f"{path}: a xacro; {by_hand}; reading it as it is") from error
    finally:
        Element.writexml = write  # type: ignore[method-assign]
    said = StringIO()
    try:
        with redirect_stderr(said):  # xacro prints warnings there
            return str(xacro.process_file(str(path)).toxml())
    except (Exception, SystemExit) as error:  # of many kinds, and for some errors it exits
        why = " ".join(f"{said.getvalue()} {error}".split())[:300]
        raise ModelError(f"{path}: xacro cannot expand it ({why}); {by_hand}") from error


# -- changes ---------------------------------------------------------------------------------------------------------


def named(root: ET.Element, tag: str, name: str, source: Path) -> ET.Element:
    """The element with that tag and name. Raises ModelError: there is none, as for bodies that a model attaches from
    another file.
    """
    for found in root.iter(tag):
        if found.get("name") == name:
            return found
    raise ModelError(f"{source}: no <{tag} name={name!r}> in the file itself to write the values into")


def check_free(root: ET.Element, tag: str, name: str) -> None:
    """Checks that no element of that tag has this name. Raises ModelError: there is one."""
    if any(found.get("name") == name for found in root.iter(tag)):
        raise ModelError(f"the model has a {tag} {name!r} already; a payload needs another name")


def put_child(parent: ET.Element, child: ET.Element) -> None:
    """Replaces the first child of the same tag, or inserts the child first; further children of its tag are removed."""
    present = parent.findall(child.tag)
    child.tail = present[0].tail if present else None
    if present and len(child) and len(present[0]):  # on lines as those that are replaced
        child.text = present[0].text
        for one in child:
            one.tail = child.text
        child[-1].tail = present[0][-1].tail
    at = list(parent).index(present[0]) if present else 0
    for one in present:
        parent.remove(one)
    parent.insert(at, child)


def remove(parent: ET.Element, child: ET.Element) -> None:
    """Takes a child out with its line."""
    at = list(parent).index(child)
    if at == len(parent) - 1 and at:
        parent[at - 1].tail = child.tail
    elif at == len(parent) - 1:
        parent.text = child.tail
    parent.remove(child)


def append(parent: ET.Element, child: ET.Element) -> None:
    """Adds a last child, on its own line where the others are."""
    if len(parent):
        child.tail, parent[-1].tail = parent[-1].tail, parent.text
    parent.append(child)


def element(tag: str, attributes: Mapping[str, str], *inside: ET.Element) -> ET.Element:
    """A new element with these attributes and children."""
    made = ET.Element(tag, dict(attributes))
    made.extend(inside)
    return made


def numbers(*values: float | Iterable[float] | Array) -> str:
    """Numbers in full precision, for XML attributes of both formats."""
    flat = [v for value in values for v in (value if isinstance(value, Iterable) else (value,))]
    return " ".join(repr(float(value)) for value in flat)


def plain(text: str) -> str:
    """A comment's text; XML forbids two hyphens in it."""
    return text.replace("--", "- -")


def description(links: Iterable[str], dynamics: Mapping[str, JointDynamics], without_place: Iterable[str]) -> str:
    """Comment on the links and joints written, and on joint values that the format cannot represent."""
    lines = [
        "Written by stadera. Inertial values of these links are those of all that moves with the link, and the "
        f"inertials of the bodies fixed to it were taken away: {', '.join(links) or 'none'}.",
        f"Joint friction written for: {', '.join(dynamics) or 'none'}.",
    ]
    units = {"armature": "kg m^2", "offset": "N m"}
    left = [(j, kind, getattr(d, kind)) for j, d in dynamics.items() for kind in without_place if getattr(d, kind)]
    if left:
        listed = "; ".join(f"{joint} {kind} {value!r} {units[kind]}" for joint, kind, value in left)
        lines.append(f"Values that this format has no place for: {listed}.")
    return "\n  ".join(lines)


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

    def append_to(self, parent: ET.Element, *nodes: ET.Element) -> None:
        """Appends the elements that make the link, after a comment, each on its own line."""
        parent.append(ET.Comment(plain(f" {self.name}: the load that was weighed. {self.note} ")))
        parent.extend(nodes)
        for node in parent[-1 - len(nodes) :]:
            node.tail = "\n  "
