"""Translates a log's columns to those of the flat table, by a given map or by the presets' patterns, and suggests
assignments for those that it does not recognise.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

from stadera.errors import RecordingError, listed
from stadera.joint_words import places, words
from stadera.logs.foreign.column_map import TEMPLATE_HINT, ColumnMap, Source, hits, preset, preset_names
from stadera.logs.topics import ReadOptions, Topics
from stadera.logs.units import FACTORS, Units, labelled, quantity_of

_GENERAL = "names"
_NO_JOINTS = frozenset({"des", "desired", "cmd", "command", "ref", "target", "error", "err", "raw", "foot"})
"""Words that exclude a name from being a joint's, as in q_des_FL_hip."""
_GROUPS = {"joint": ("--joint-topic", "joints"), "imu": ("--imu-topic", "IMUs")}


@dataclass(frozen=True)
class Translation:
    """The log's column and the factor to SI units, absent if 1, for each column of the flat table."""

    sources: Mapping[str, str]
    factors: Mapping[str, float] = field(default_factory=dict)
    stamped: bool = False  # True if the unit of time is given
    rate_hz: float | None = None  # rows per second of a log without time
    notes: tuple[str, ...] = ()  # columns that were recognised and converted, one sentence each
    recognised: bool = True  # True if the names identify the columns
    topics: bool = False  # True if the names contain topics to choose from


@dataclass(frozen=True)
class _Found:
    """A column that may be one of the flat table's."""

    flat: str
    column: str
    source: Source
    topic: str
    rank: int

    @property
    def group(self) -> str:
        return "imu" if self.flat.startswith("imu.") else "joint" if "." in self.flat else ""


def translated(
    names: Sequence[str], source: str, reading: ReadOptions, topics: Topics, joints: Collection[str] = ()
) -> Translation:
    """Translates the columns of a log, by a map or by presets. `joints` are joints although their names do not look
    like it. Raises RecordingError: the map does not fit, or there are several topics and none was chosen.
    """
    labels = labelled(names)
    plain = {name: labels[name][0] if name in labels else name for name in names}
    if reading.columns is not None:
        found = _mapped(reading.columns, plain, source, topics, joints)
        _check_given(reading.columns, found, plain, source)
        return _in_units(found, reading.columns, labels, reading.units, given=True)
    if "time" in plain.values() and _has_positions(plain.values()):
        return _as_is(names, plain, labels, reading.units)
    for name in preset_names():
        found = _mapped(preset(name), plain, source, topics, joints)
        if ("time" in found or reading.units.rate_hz is not None) and _has_positions(found):
            return _in_units(found, preset(name), labels, reading.units, given=False)
    if (by_list := _by_list(names, reading, joints)) is not None:
        return by_list
    unknown = replace(_as_is(names, plain, labels, reading.units), recognised=False)
    timed = _mapped(preset(_GENERAL), plain, source, topics, joints).get("time")
    return replace(unknown, sources={**unknown.sources, "time": timed.column}) if timed else unknown


def _has_positions(names: Iterable[str]) -> bool:
    return any(name.endswith(".position") for name in names)


def _as_is(
    names: Sequence[str], plain: Mapping[str, str], labels: Mapping[str, tuple[str, str]], units: Units
) -> Translation:
    """Columns that already have the flat table's names, or that are unknown."""
    count = Counter(plain.values())
    sources = {plain[name] if count[plain[name]] == 1 else name: name for name in names}
    known = {flat: _Found(flat, name, Source(name), "", 0) for flat, name in sources.items()}
    factors, notes = _factors(known, Units(), labels, units)
    stamped = "time" in units.of or sources.get("time") in labels
    return Translation(sources, factors, stamped, units.rate_hz, notes)


def _in_units(
    found: Mapping[str, _Found], chosen: ColumnMap, labels: Mapping[str, tuple[str, str]], units: Units, *, given: bool
) -> Translation:
    factors, notes = _factors(found, chosen.units, labels, units)
    example = next(one for flat, one in found.items() if flat.endswith(".position"))
    how = f"the map {chosen.name}" if given else f"the preset {chosen.name} ({chosen.about})"
    said = f"columns read by {how}: {example.column!r} as {example.flat!r}"
    time = found.get("time")
    stated = "time" in (*units.of, *chosen.units.of)
    stamped = time is not None and (stated or bool(time.source.unit) or time.column in labels)
    rate = units.over(chosen.units).rate_hz if time is None else None
    sources = {flat: one.column for flat, one in found.items()}
    return Translation(sources, factors, stamped, rate, (said, *notes), topics=any(one.topic for one in found.values()))


def _factors(
    found: Mapping[str, _Found], mapped: Units, labels: Mapping[str, tuple[str, str]], asked: Units
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Factors to SI by column: from the column's unit in the map, else the requested unit, its label's, the map's."""
    factors: dict[str, float] = {}
    converted: Counter[str] = Counter()
    for flat, one in found.items():
        quantity = quantity_of(flat)
        known = FACTORS.get(quantity, {})
        label = labels.get(one.column, ("", ""))[1]
        unit = one.source.unit or asked.of.get(quantity) or (label if label in known else mapped.of.get(quantity, ""))
        factor = (known[unit] if unit else 1.0) * one.source.factor
        if factor != 1.0:
            factors[flat] = factor
            times = [f"times {one.source.factor:g}"] if one.source.factor != 1.0 else []
            converted[" ".join(filter(None, (quantity or flat, unit, *times)))] += 1
    listed = ", ".join(f"{what} ({count} columns)" if " times" in what else what for what, count in converted.items())
    return factors, (f"converted to SI units: {listed}",) if converted else ()


def _mapped(
    chosen: ColumnMap, plain: Mapping[str, str], source: str, topics: Topics, joints: Collection[str]
) -> dict[str, _Found]:
    """The best-fitting column of the log for each column of the flat table."""
    by_column: dict[str, tuple[int, _Found]] = {}
    for found in _candidates(chosen, plain, joints):
        literal = len(re.sub(r"\{[^{}]*\}", "", found.source.pattern))
        if found.column not in by_column or literal > by_column[found.column][0]:
            by_column[found.column] = (literal, found)
    everything = [found for _, found in by_column.values()]
    kept = {group: _topic_of(group, everything, topics, source) for group in _GROUPS}
    best: dict[str, _Found] = {}
    for found in everything:
        if found.topic != kept.get(found.group, found.topic):
            continue
        if found.flat not in best or found.rank < best[found.flat].rank:
            best[found.flat] = found
    place = {column: k for k, column in enumerate(plain)}
    return dict(sorted(best.items(), key=lambda item: place[item[1].column]))


def _candidates(chosen: ColumnMap, plain: Mapping[str, str], joints: Collection[str]) -> Iterator[_Found]:
    columns = dict(chosen.columns)
    columns["time"] = (*columns.get("time", ()), *preset(_GENERAL).columns["time"])
    for key, sources in columns.items():
        for rank, one in enumerate(sources):
            for column, said, axis, topic in hits(one.pattern, plain):
                if (joint := _joint(said, chosen, joints)) is not None:
                    flat = key.replace("{joint}", joint).replace("{axis}", axis)
                    yield _Found(flat, column, one, topic, rank)


def _joint(said: str | int, chosen: ColumnMap, joints: Collection[str]) -> str | None:
    """Name of a hit's joint, empty if it has none; None if it is not a joint."""
    if isinstance(said, int):
        return chosen.joints[said] if 0 <= said < len(chosen.joints) else None
    if not said or said in joints or chosen.name != _GENERAL or (places([said]) and not words(said) & _NO_JOINTS):
        return said
    return None


def _topic_of(group: str, found: Sequence[_Found], topics: Topics, source: str) -> str:
    """The topic from which a group's columns are taken."""
    option, what = _GROUPS[group]
    asked = topics.joint if group == "joint" else topics.imu
    counts = Counter(one.topic for one in found if one.group == group)
    if asked is not None and any(counts):
        if asked.strip("/") not in {topic.strip("/") for topic in counts}:
            raise RecordingError(f"{source}: {option} {asked}: no such topic; valid: {', '.join(counts)}")
        return next(topic for topic in counts if topic.strip("/") == asked.strip("/"))
    (first, most), *others = counts.most_common() or [("", 0)]
    if others and others[0][1] == most:
        raise RecordingError(
            f"{source}: columns of {what} of several topics: {', '.join(counts)}; choose one with {option}"
        )
    return first


def _check_given(chosen: ColumnMap, found: Mapping[str, _Found], plain: Mapping[str, str], source: str) -> None:
    """Checks that a requested map fits and that the columns it names exist."""
    known = listed(list(plain), 8)
    absent = (flat for flat in chosen.columns if "{" not in flat and flat not in found and flat != "time")
    if flat := next(absent, None):
        column = chosen.columns[flat][0].pattern
        raise RecordingError(f"{source}: no column {column!r}, which {chosen.name} has as {flat!r} (columns: {known})")
    if not _has_positions(found):
        patterns = " ".join(one.pattern for named in chosen.columns.values() for one in named)
        numbered = ("{i}" in patterns or "{n}" in patterns) and not chosen.joints
        order = '; numbered joints need their order: joints = ["..."]' if numbered else ""
        raise RecordingError(
            f"{source}: no column is a joint's position by {chosen.name}{order}; columns: {known}; {TEMPLATE_HINT}"
        )


_NUMBERED = tuple(f"joint_{k}" for k in range(32))
"""Names for joints in a preset that does not define their order."""


def guessed(names: Sequence[str], reading: ReadOptions) -> Translation:
    """Translates columns with the first preset that fits, including those that apply on request only.

    Joints of unknown order are called joint_0, joint_1 and so on.
    """
    found = translated(names, "", reading, Topics(), reading.others)
    if found.recognised:
        return found
    if (first := next(_all_fitting(names, reading), None)) is not None:
        _, fitting = first
        return replace(fitting, notes=(*fitting.notes, "the joints are numbered: check that this is their order"))
    return Translation({"time": own} if (own := found.sources.get("time")) else {})


def hint(names: Sequence[str], reading: ReadOptions) -> str:
    """Advice for unrecognised columns, as the end of an error message."""
    fitting = dict(_all_fitting(names, reading))
    chosen = [preset(name) for name in fitting if preset(name).chosen]
    ways = []
    if asked := [one.name for one in chosen if one.joints]:
        order = " (joints by number: these differ in their order)" if len(asked) > 1 else ""
        ways.append(f"--columns {' or '.join(asked)}{order}")
    if (fitting or _has_positions(names)) and not any(
        "time" in f.sources or f.rate_hz is not None for f in fitting.values()
    ):
        ways.append("--units 200Hz for a steady rate without a column of time")
    unordered = next((one.name for one in chosen if not one.joints), None)
    order = f', in which base = "{unordered}" and joints = ["..."] say their order' if unordered else ""
    return f"; {', '.join([*ways, f'--columns MAP.toml{order} ({TEMPLATE_HINT})'])}"


def _by_list(names: Sequence[str], reading: ReadOptions, joints: Collection[str]) -> Translation | None:
    """Translates numbered columns by the log's list that names as many joints as are numbered, the one with most of
    `joints`; None if there is none.
    """
    found = [
        replace(one, notes=(*one.notes, "joints in the order of the log's list of their names"))
        for order in reading.orders
        if len(order) < len(names)
        for _, one in _all_fitting(names, reading, (*order, ""))  # the last for columns beyond the list
        if sorted(_positions(one)) == sorted(order)
    ]
    return max(found, key=lambda one: (len(set(joints) & set(_positions(one))), len(one.sources)), default=None)


def _positions(found: Translation) -> list[str]:
    return [flat.removesuffix(".position") for flat in found.sources if flat.endswith(".position")]


def _all_fitting(
    names: Sequence[str], reading: ReadOptions, order: tuple[str, ...] = ()
) -> Iterator[tuple[str, Translation]]:
    """Yields the presets that fit if requested, and what they translate columns to, by this order of the joints."""
    for name in preset_names():
        asked = replace(preset(name).asked(), joints=order or preset(name).joints or _NUMBERED)
        with suppress(RecordingError):
            yield name, translated(names, "", ReadOptions(asked, reading.units), Topics())
