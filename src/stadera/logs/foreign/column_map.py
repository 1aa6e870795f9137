"""Maps a log's columns to those of the flat table, given a user's TOML file or a preset of this package.

The pattern of a column is its name with placeholders:

    {joint}                the name of a joint
    {i}, {n}               its number in the map's list of joints, from 0, from 1
    {axis}                 x, y, z or w
    {xyz}, {wxyz}, {xyzw}  the number of an axis in that order, from 0; with or without brackets
    {topic}                a common prefix of all joints or of the IMU; may be absent
    {_}, {-}               one or more of the signs . _ / - or a blank; any number of them

Matching ignores case.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from math import isfinite
from pathlib import Path
from typing import Any, Self

from stadera.boundary import foreign, require_input
from stadera.errors import RecordingError, StaderaError
from stadera.logs.units import FACTORS, Units, quantity_of

_KEYS = ("about", "base", "joints", "units", "columns", "columns_if_chosen")
TEMPLATE_HINT = "`stadera inspect LOG --columns` writes a template"


@dataclass(frozen=True)
class Source:
    """Source of a column of the flat table: a pattern for the log's column, the unit
    of its values, empty for the map's, and an additional factor, such as a sign or a gear ratio.
    """

    pattern: str
    unit: str = ""
    factor: float = 1.0


@dataclass(frozen=True, eq=False)
class ColumnMap:
    """Assignment of a kind of log's columns, and the units of the log."""

    name: str  # of the preset, or of the map's file
    # by column of the flat table, with {joint} and {axis} for all joints and axes, its possible sources, the likeliest
    # first
    columns: Mapping[str, tuple[Source, ...]]
    # more of these that apply only if the map is requested by name, since the names could be another robot's
    chosen: Mapping[str, tuple[Source, ...]] = field(default_factory=dict)
    joints: tuple[str, ...] = ()  # names to which {i} and {n} refer
    units: Units = field(default_factory=Units)
    about: str = ""  # the kind of log

    def asked(self) -> Self:
        """The map including the names that apply only on request."""
        merged = {key: (*self.columns.get(key, ()), *more) for key, more in self.chosen.items()}
        return replace(self, columns={**self.columns, **merged}, chosen={})


def column_map(given: str | Path) -> ColumnMap:
    """Loads a preset by its name, or a map by the path of its TOML file. Raises RecordingError: neither, or not a valid
    map.
    """
    path = Path(given)
    if str(given) in preset_names():
        return preset(str(given)).asked()
    try:
        require_input(path)
    except RecordingError as error:
        raise RecordingError(
            f"neither a preset for columns ({', '.join(preset_names())}) nor a map: {error}; {TEMPLATE_HINT}"
        ) from None
    with foreign(path, "not a map of columns"):
        text = path.read_text(encoding="utf-8")
    return parsed(text, str(path))


def parsed(text: str, name: str) -> ColumnMap:
    """Parses a map from the text of a TOML file. Raises as `column_map`."""
    with foreign(name, "not a map of columns"):
        content = tomllib.loads(text)
    if unknown := next((key for key in content if key not in _KEYS), None):
        raise RecordingError(f"{name}: unknown key {unknown!r}; valid: {', '.join(_KEYS)}")
    joints = content.get("joints", [])
    if not isinstance(joints, list) or not all(isinstance(joint, str) for joint in joints):
        raise RecordingError(f"{name}: joints needs a list of names")
    base = ColumnMap(name, {})
    if "base" in content:
        if content["base"] not in preset_names():
            raise RecordingError(f"{name}: no preset {content['base']!r}; presets: {', '.join(preset_names())}")
        base = preset(content["base"]).asked()
    return ColumnMap(
        name,
        {**base.columns, **_sources(_table(content, "columns", name), name)},
        _sources(_table(content, "columns_if_chosen", name), name),
        tuple(joints) or base.joints,
        _units(_table(content, "units", name), name).over(base.units),
        str(content.get("about", "")),
    )


def _units(table: dict[str, Any], name: str) -> Units:
    rate = table.pop("rate_hz", None)
    try:
        return Units(table, None if rate is None else float(rate))
    except (StaderaError, TypeError, ValueError, OverflowError) as error:
        raise RecordingError(f"{name}: [units]: {error}") from None


def _table(content: Mapping[str, Any], key: str, name: str) -> dict[str, Any]:
    found = content.get(key, {})
    if not isinstance(found, dict):
        raise RecordingError(f"{name}: [{key}] needs to be a table")
    return dict(found)


def _sources(table: Mapping[str, Any], name: str) -> dict[str, tuple[Source, ...]]:
    return {
        column: tuple(_source(column, one, name) for one in (given if isinstance(given, list) else [given]))
        for column, given in table.items()
    }


def _source(column: str, given: Any, name: str) -> Source:
    """One source of a column, checked: its places are those left open in the flat table's name."""
    fields = {"column": given} if isinstance(given, str) else given
    if not isinstance(fields, dict) or not isinstance(pattern := fields.get("column"), str):
        raise RecordingError(f'{name}: {column!r} needs the name of a column, or {{ column = "...", unit = "..." }}')
    if unknown := next((key for key in fields if key not in ("column", "unit", "factor")), None):
        raise RecordingError(f"{name}: {column!r}: unknown key {unknown!r}; valid: column, unit, factor")
    unit, factor = str(fields.get("unit", "")), fields.get("factor", 1.0)
    valid = FACTORS.get(quantity_of(column), {})
    if unit and unit not in valid:
        raise RecordingError(f"{name}: {column!r} has no unit {unit!r}; valid: {', '.join(valid) or 'none'}")
    if not isinstance(factor, int | float) or not isfinite(factor) or not factor:
        raise RecordingError(f"{name}: {column!r} needs a factor that is a number and not 0, got {factor!r}")
    for place, said in (("{joint}", ("{joint}", "{i}", "{n}")), ("{axis}", ("{axis}", "{xyz}", "{wxyz}", "{xyzw}"))):
        if (place in column) != any(word in pattern for word in said):
            raise RecordingError(f"{name}: {column!r} = {pattern!r}: {place} and one of {', '.join(said)} go together")
    return Source(pattern, unit, float(factor))


@cache
def preset_names() -> tuple[str, ...]:
    """Names of the presets, in the order in which they are tried."""
    files = (resources.files(__package__) / "presets").iterdir()
    found = sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml"))
    return tuple(sorted(found, key=lambda name: name == "names"))  # the most general one last


@cache
def preset(name: str) -> ColumnMap:
    """A preset of this package by its name."""
    text = (resources.files(__package__) / "presets" / f"{name}.toml").read_text(encoding="utf-8")
    return parsed(text, name)


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


Hit = tuple[str, str | int, str, str]
"""A column that matches a pattern, with the values of the placeholders: the joint's name, or its number if the pattern
counts joints; the axis x, y, z or w; the topic. Empty where there is none.
"""


def hits(pattern: str, names: Mapping[str, str]) -> Iterator[Hit]:
    """Yields the columns that match a pattern. `names`: by column, its name without its unit."""
    if "{" not in pattern:
        exact = [column for column, name in names.items() if pattern in (column, name)]
        alike = [column for column, name in names.items() if pattern.lower() == name.lower()]
        yield from ((column, "", "", "") for column in exact or alike)
        return
    compiled = _compiled(pattern)
    for column, name in names.items():
        if match := compiled.fullmatch(name):
            said = {place: text for place, text in match.groupdict().items() if text}
            numbered = (order[int(said[order])] for order in ("xyz", "wxyz", "xyzw") if order in said)
            joint = int(said["i"]) if "i" in said else int(said["n"]) - 1 if "n" in said else said.get("joint", "")
            yield column, joint, next(numbered, said.get("axis", "").lower()), said.get("topic", "")


@cache
def _compiled(pattern: str) -> re.Pattern[str]:
    """Raises RecordingError for an unknown placeholder."""
    parts = re.split(r"\{([^{}]*)\}", pattern)
    if unknown := next((place for place in parts[1::2] if place not in _PLACES), None):
        raise RecordingError(f"{pattern!r}: unknown place {{{unknown}}}; known: {{{'}, {'.join(_PLACES)}}}")
    text = "".join(_PLACES[part] if k % 2 else re.escape(part) for k, part in enumerate(parts))
    return re.compile(text, re.IGNORECASE)
