"""XML of robot models: read within limits, and written with its comments and the prefixes of its names.

A xacro is read after expansion by the package xacro (the extra of that name). Entities, which can expand without bound,
are not read.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr, suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import IO
from xml.dom.minidom import Element
from xml.parsers import expat

from stadera.errors import MissingExtraError, ModelError
from stadera.limits import DEFAULTS, Limits


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


_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_TO_EXPAND = re.compile(rb"<xacro:|\$[({]")
_TAG = re.compile(rb"""<(?:[^<>"']|"[^"]*"|'[^']*')*>""")


def _written(element: ET.Element, kept: Mapping[ET.Element, str]) -> Iterator[str]:
    """An element's text, without what follows it."""
    from xml.sax.saxutils import escape, quoteattr  # loads HTTP, and only models that are written need it

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
    if xacro:
        builder.parser.Parse(expanded(path), True)
    else:
        with path.open("rb") as file:
            builder.parser.ParseFile(file)
    return Document(builder.close(), builder.remarks, builder.tags, None if xacro else path)


def is_xacro(path: Path) -> bool:
    """True if a file must be expanded: by its name, or by the namespace of its root element and something to expand,
    since an expanded file keeps the namespace.
    """
    if path.name.lower().endswith(".xacro"):
        return True
    with path.open("rb") as file:
        head = file.read(4096)
        named = any(name in head for name in (b"xmlns:xacro=", b"ros.org/wiki/xacro", b"ros.org/xacro"))
        return named and _TO_EXPAND.search(_COMMENT.sub(b"", head + file.read())) is not None


def expanded(path: Path) -> str:
    """The text of a xacro, expanded. MissingExtraError if the package is not installed, ModelError if it cannot be
    expanded, such as for an argument without a default or a missing package.
    """
    stem = path.name.split(".")[0]
    out = f"{stem}.urdf" if path.suffix != ".urdf" else f"{stem}_expanded.urdf"  # not onto itself
    by_hand = f"expand it where its packages are: xacro {path.name} > {out}"
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


def plain(text: str) -> str:
    """A comment's text; XML forbids two hyphens in it."""
    return text.replace("--", "- -")
