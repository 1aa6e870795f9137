"""Reads XML of robot models, a xacro after expansion by the package xacro (the extra of that name), within limits of
elements and nesting depth, and without entities, which can expand without bound.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from xml.dom.minidom import Element

from stadera.errors import MissingExtraError, ModelError
from stadera.limits import DEFAULTS, Limits

_PIECE = 1 << 16  # bytes
_SIZED = {"size", "numeric", "hfield"}
"""Elements of MJCF whose numbers are sizes of arrays."""
_LARGEST_ARRAY = 1_000_000
_FILES = {"include", "model"}
"""Elements of MJCF that include another model's elements."""


class _Counted(ET.TreeBuilder):
    """Builds a tree, and counts elements."""

    def __init__(self, path: Path, limits: Limits) -> None:
        super().__init__()
        self._path, self._limits = path, limits
        self._elements = self._depth = 0

    def start(self, tag: str, attrs: dict[str, str]) -> ET.Element:  # type: ignore[override]
        self._elements, self._depth = self._elements + 1, self._depth + 1
        self._limits.require("elements", self._elements, self._path, "elements")
        self._limits.require("depth", self._depth, self._path, "elements in each other")
        return super().start(tag, attrs)

    def end(self, tag: str) -> ET.Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, *_: object) -> None:
        raise ModelError(f"{self._path}: a DOCTYPE, whose entities are not read; no robot's model needs one")


def tree_of(path: Path, text: str | None = None, limits: Limits = DEFAULTS) -> ET.Element:
    """The root element of a file, or of a text in its place. LimitError if there are more elements, or deeper nesting,
    than the limits allow, ModelError for a DOCTYPE; ElementTree.ParseError, LookupError if it is not XML or has an
    unknown encoding.
    """
    parser = ET.XMLParser(target=_Counted(path, limits))
    for piece in _pieces(path) if text is None else [text]:
        parser.feed(piece)
    root: ET.Element = parser.close()
    return root


def _pieces(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while piece := file.read(_PIECE):
            yield piece


def require_depth(joints: Iterable[ET.Element], path: Path, limits: Limits) -> None:
    """Checks the length of the chains of joints in a URDF. Raises LimitError: a chain is too long."""
    links = ((joint.find("parent"), joint.find("child")) for joint in joints)
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


def require_size(root: ET.Element, path: Path, limits: Limits) -> None:
    """Checks the sizes that an MJCF requests from a compiler: included files, copies, arrays. Raises LimitError: too
    many elements, or an array that is too large.
    """
    total = _elements(root, path, limits, {path.resolve()})
    limits.require("elements", total, path, "elements, with all copies and included files")


def _elements(element: ET.Element, path: Path, limits: Limits, seen: set[Path]) -> float:
    """Number of elements in this one, itself included, with all copies."""
    own = 1.0 + sum(_elements(child, path, limits, seen) for child in element)
    if element.tag in _SIZED:
        largest = max((_number(value) for name, value in element.items() if name != "memory"), default=0.0)
        limits.require("elements", largest / _LARGEST_ARRAY, path, f"million numbers of <{element.tag}>")
    if element.tag in _FILES and (name := element.get("file")):
        own += _of_file(path.parent / name, limits, seen)
    for word in (element.get("count") or "").split():
        own *= max(_number(word), 1.0)
    return own


def _of_file(path: Path, limits: Limits, seen: set[Path]) -> float:
    """Number of elements in another file; zero if it does not exist or is not XML, which the compiler reports
    better.
    """
    if path.resolve() in seen or not path.is_file():
        return 0.0
    seen.add(path.resolve())
    try:
        root = tree_of(path, limits=limits)
    except (ET.ParseError, LookupError, ValueError):
        return 0.0
    return _elements(root, path, limits, seen)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


_NAMESPACES = ("xmlns:xacro=", "ros.org/wiki/xacro", "ros.org/xacro")
_HEAD = 4096  # bytes that contain the start of the root element


def is_xacro(path: Path) -> bool:
    """True if a file must be expanded: by its name, or by the namespace of its root element."""
    if path.name.lower().endswith(".xacro"):
        return True
    with path.open("rb") as file:
        head = file.read(_HEAD).decode(errors="replace")
    return any(name in head for name in _NAMESPACES)


def expanded(path: Path) -> str:
    """The text of a URDF or MJCF, a xacro expanded with its arguments' defaults. MissingExtraError if the package is
    not installed, ModelError if it cannot be expanded, such as for an argument without a default or a missing package.
    """
    if not is_xacro(path):
        return path.read_text(encoding="utf-8-sig")
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


def parsed(path: Path, limits: Limits = DEFAULTS) -> ET.Element:
    """The root element; errors as `expanded` and `stadera.robot.xmltree.tree_of`."""
    return tree_of(path, expanded(path) if is_xacro(path) else None, limits)
