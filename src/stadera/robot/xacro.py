"""Expands a xacro file to its URDF, with the package xacro (the extra of that name)."""

import xml.etree.ElementTree as ET
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from xml.dom.minidom import Element

from stadera.errors import MissingExtraError, ModelError
from stadera.limits import DEFAULTS, Limits
from stadera.robot.xmltree import tree_of

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
