"""Patterns of column names.

A pattern is a column's name with placeholders:

    {joint}                the name of a joint
    {i}, {n}               its number in the map's list of joints, from 0, from 1
    {axis}                 x, y, z or w
    {xyz}, {wxyz}, {xyzw}  the number of an axis in that order, from 0; with or without brackets
    {topic}                a common prefix of all joints or of the IMU; may be absent
    {_}, {-}               one or more of the signs . _ / - or a blank; any number of them

Matching ignores case.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

from stadera.errors import RecordingError

_SIGNS = r"[\s._/-]"
_PLACES = {
    "joint": r"(?P<joint>[^/]+?)",
    "i": r"\[?(?P<i>\d+)\]?",
    "n": r"\[?(?P<n>\d+)\]?",
    "axis": r"(?P<axis>[xyzw])",
    "xyz": r"\[?(?P<xyz>[0-2])\]?",
    "wxyz": r"\[?(?P<wxyz>[0-3])\]?",
    "xyzw": r"\[?(?P<xyzw>[0-3])\]?",
    "topic": rf"(?:(?P<topic>.+?)(?:{_SIGNS})+)??",
    "_": f"{_SIGNS}+",
    "-": f"{_SIGNS}*",
}
_ORDERS = {"xyz": "xyz", "wxyz": "wxyz", "xyzw": "xyzw"}


@dataclass(frozen=True)
class Hit:
    """A column that matches a pattern: its joint's name, or its number if the pattern counts joints; its axis x, y, z
    or w; and its topic. Empty where there is none.
    """

    joint: str | int
    axis: str
    topic: str


def hits(pattern: str, names: Mapping[str, str]) -> Iterator[tuple[str, Hit]]:
    """Yields the columns that match a pattern, with the values of the placeholders. `names`: by column, its name
    without its unit.
    """
    if "{" not in pattern:
        exact = [column for column, name in names.items() if pattern in (column, name)]
        alike = [column for column, name in names.items() if pattern.lower() == name.lower()]
        yield from ((column, Hit("", "", "")) for column in exact or alike)
        return
    compiled = _compiled(pattern)
    for column, name in names.items():
        if match := compiled.fullmatch(name):
            yield column, _hit(match.groupdict())


def _hit(said: Mapping[str, str | None]) -> Hit:
    axis = (said.get("axis") or "").lower()
    for place, order in _ORDERS.items():
        if number := said.get(place):
            axis = order[int(number)]
    joint: str | int = said.get("joint") or ""
    if said.get("i") is not None:
        joint = int(said["i"] or 0)
    elif said.get("n") is not None:
        joint = int(said["n"] or 0) - 1
    return Hit(joint, axis, said.get("topic") or "")


@cache
def _compiled(pattern: str) -> re.Pattern[str]:
    """Raises RecordingError for an unknown placeholder."""
    parts = re.split(r"\{([^{}]*)\}", pattern)
    if unknown := next((place for place in parts[1::2] if place not in _PLACES), None):
        raise RecordingError(f"{pattern!r}: unknown place {{{unknown}}}; known: {{{'}, {'.join(_PLACES)}}}")
    text = "".join(_PLACES[part] if k % 2 else re.escape(part) for k, part in enumerate(parts))
    return re.compile(text, re.IGNORECASE)
