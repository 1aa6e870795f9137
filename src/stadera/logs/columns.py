"""Assigns a log's columns to the flat table's, by name. No file access."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches

from stadera.errors import RecordingError, UnknownNameError, listed
from stadera.joint_words import LEG_NAMES, PARTS, matched, places
from stadera.logs.foreign.translate import Translation, hint, translated
from stadera.logs.topics import AS_RECORDED, DESIRED, PdGains, ReadOptions, Topics

TIME = "time"
CHANNELS: tuple[str, ...] = ("position", "velocity", "acceleration", "effort")
OTHER_CHANNELS: tuple[str, ...] = ("position", "velocity", "effort")
"""Channels of joints that belong to no leg."""
IMU_COLUMNS: dict[str, tuple[str, ...]] = {
    "angular_velocity": tuple(f"imu.angular_velocity.{axis}" for axis in "xyz"),
    "linear_acceleration": tuple(f"imu.linear_acceleration.{axis}" for axis in "xyz"),
    "orientation": tuple(f"imu.orientation.{axis}" for axis in "xyzw"),
}
HALF_IMU = "left out the IMU: no column"
"""Beginning of the note on a log that has some of an IMU's columns."""
IMU_FRAME = "imu.frame"
"""Key of the IMU frame's name in a Parquet table's metadata."""


@dataclass(frozen=True)
class Layout:
    """Assignment of a table's columns."""

    joints: tuple[str, ...]  # in the order requested, or else in that of the table's columns
    # by array of a recording (`Recording.arrays`), its columns, and those of desired values; what was not recorded, or
    # not for all joints or of the whole IMU, is absent
    groups: Mapping[str, tuple[str, ...]]
    notes: tuple[str, ...] = ()  # columns that were excluded and why, and columns that were recognised and converted
    imu_frame: str | None = None  # frame of the IMU's values, None if the log does not name it
    # sources, factors: the log's own column names, and factors to SI units, by column, where they differ and are not 1
    sources: Mapping[str, str] = field(default_factory=dict)
    factors: Mapping[str, float] = field(default_factory=dict)
    stamped: bool = False  # True if the unit of time is given
    rate_hz: float | None = None  # rows per second of a log without a column of time
    pd: PdGains | None = None  # gains for computing efforts from the desired positions among the groups
    others: tuple[str, ...] = ()  # joints besides the requested ones

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns of the flat table, time first."""
        return (TIME, *(name for group in self.groups.values() for name in group))

    @property
    def recorded(self) -> tuple[str, ...]:
        """The log's own names of the columns to read, in their order; without time if it is computed from a rate."""
        columns = self.columns if self.rate_hz is None else self.columns[1:]
        return tuple(self.sources.get(name, name) for name in columns)


def layout(
    names: Sequence[str],
    source: str,
    joints: Sequence[str] | None = None,
    require: Collection[str] = (),
    reading: ReadOptions = AS_RECORDED,
    topics: Topics | None = None,
    kind: str = "table",
) -> Layout:
    """Assigns a table's columns, given its header.

    Args:
        source, kind: of the log, for messages.
        joints: the joints to read, in this order; None for all that have a position.
        require: what each of these joints needs: any of position, velocity, acceleration, effort; and "imu".
        reading: assignment and units of columns, if their names do not state them.
        topics: the topics to choose, if columns have topics in their names; None if they were chosen before.

    Raises:
        RecordingError: a column is duplicate, missing or misspelled; names it and the closest ones.
    """
    if other := next((item for item in require if item not in (*CHANNELS, "imu")), None):
        raise UnknownNameError("channel", other, (*CHANNELS, "imu"))
    _check_header(names, source)
    requested = tuple(joints or ())
    table = translated(names, source, reading, topics or Topics(), (*requested, *reading.others))
    if topics is not None and not table.topics:
        topics.refuse(source, kind)
    table = _with_names_of(requested, table)
    header = _Header(table.sources, source, "" if table.recognised else hint(names, reading))
    timed = TIME in table.sources
    if not timed and table.rate_hz is None:
        raise header.missing(TIME, "not a flat table: ")
    if timed and reading.units.rate_hz is not None:
        rate = f"--units {reading.units.rate_hz:g}Hz"
        raise RecordingError(f"{source}: there is a column of time, {table.sources[TIME]!r}: leave out {rate}")
    wanted = header.joints() if joints is None else requested
    channels, imu = header.channels(wanted, require, reading.pd), header.imu("imu" in require)
    more = () if joints is None else (joint for joint in reading.others if joint not in requested)
    others = tuple(joint for joint in more if f"{joint}.position" in table.sources)
    found = Layout(
        joints=wanted,
        groups={**channels, **imu, **header.of_feet(), **header.of_others(others)},
        sources={name: own for name, own in table.sources.items() if own != name},
        factors=table.factors,
        stamped=table.stamped,
        rate_hz=None if timed else table.rate_hz,
        pd=reading.pd,
        others=others,
    )
    kept_out = _kept_out(names, found, table.sources)
    return replace(found, notes=(*table.notes, *header.notes, *kept_out))


def _check_header(names: Sequence[str], source: str) -> None:
    if names.count("") > 1:
        blank = ", ".join(str(k) for k, name in enumerate(names, start=1) if not name)
        raise RecordingError(f"{source}: columns {blank} of the header have no name")
    if odd := next((name for name in names if not name.isprintable()), None):
        raise RecordingError(f"{source}: the name of column {odd[:60]!r} has characters that cannot be printed")
    if names and all(map(_is_number, names)):
        raise RecordingError(f"{source}: the first row is numbers; a table needs a header, the names of its columns")
    name, times = Counter(names).most_common(1)[0] if names else ("", 0)
    if times > 1:
        raise RecordingError(f"{source}: column {name!r} is there {times} times")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _with_names_of(joints: Sequence[str], table: Translation) -> Translation:
    """The columns named as these joints, all those of one leg or more, if the log has other names for them."""
    there = _owners(table.sources, ".position")
    if len(joints) < len(PARTS) or set(joints) & set(there):
        return table
    names = {own: joint for joint, own in (matched(joints, there) or {}).items()}
    note = [f"joints found by leg and part, {old!r} as {new!r}" for old, new in list(names.items())[:1]]

    def named(column: str) -> str:
        joint, _, channel = column.rpartition(".")
        return f"{names[joint]}.{channel}" if joint in names else column

    sources = {named(column): own for column, own in table.sources.items()}
    factors = {named(column): factor for column, factor in table.factors.items()}
    return replace(table, sources=sources, factors=factors, notes=(*table.notes, *note))


def _kept_out(names: Sequence[str], found: Layout, sources: Mapping[str, str]) -> tuple[str, ...]:
    """A note on the log's columns that belong to no channel, except those of joints that were not requested."""
    used = {sources[name] for name in found.columns if name in sources}
    used.update(own for name, own in sources.items() if _is_joint_column(name))
    unknown = [name for name in names if name not in used]
    return (f"kept out unknown columns: {_listed(unknown)}",) if unknown else ()


class _Header:
    """A log's columns by their names in the flat table, and notes on those left out; errors name the log and end in
    advice, `hint`.
    """

    def __init__(self, names: Iterable[str], source: str, hint: str) -> None:
        self.names, self.source, self.hint, self.notes = dict.fromkeys(names), source, hint, list[str]()

    def owners(self, suffix: str) -> tuple[str, ...]:
        """Joints or feet that have a column of this kind."""
        return _owners(self.names, suffix)

    def missing(self, column: str, what: str = "", hint: str = "") -> RecordingError:
        """An error that names the closest columns."""
        others = [name for name in self.names if not _is_joint_column(name)]
        close = get_close_matches(column, others, n=3, cutoff=0.75)
        joints = self.owners(".position")
        meant = f"; did you mean {' or '.join(map(repr, close))}?" if close else ""
        there = f"joints with a position: {_listed(joints)}" if joints else f"columns: {_listed(tuple(self.names))}"
        return RecordingError(f"{self.source}: {what}no column {column!r}{meant} ({there}){self.hint or hint}")

    def joints(self) -> tuple[str, ...]:
        """The joints with a position, without idle ones: those of no leg without an effort, such as an arm's, in a log
        that has those of four legs.
        """
        found = self.owners(".position")
        unknown = [name for name in self.names if not _is_joint_column(name)]
        for channel in CHANNELS[1:]:
            for joint in self.owners(f".{channel}"):
                expected = f"{joint}.position"
                if joint not in found and get_close_matches(expected, unknown, n=1, cutoff=0.85):
                    raise self.missing(expected)
        if not found:
            raise self.missing("<joint>.position", "not a flat table: ")
        idle = tuple(joint for joint in found if f"{joint}.effort" not in self.names)
        if not idle or len(found) - len(idle) < len(LEG_NAMES) * len(PARTS) or places(idle):
            return found
        self.notes.append(f"left out joints of no leg that have no torque: {_listed(idle)}")
        return tuple(joint for joint in found if joint not in idle)

    def channels(
        self, joints: tuple[str, ...], require: Collection[str], pd: PdGains | None
    ) -> dict[str, tuple[str, ...]]:
        """Columns of each channel. If only some joints have one, effort raises, and others are skipped with a note."""
        needed, possible = {"position", *require}, CHANNELS
        if pd is not None:
            if any(f"{joint}.effort" in self.names for joint in joints):
                raise RecordingError(
                    f"{self.source}: joint efforts are recorded: leave out --pd, which is for logs without"
                )
            needed, possible = (needed | {DESIRED[0]}) - {"effort"}, (*CHANNELS, *DESIRED)
        found: dict[str, tuple[str, ...]] = {}
        for channel in possible:
            columns = tuple(f"{joint}.{channel}" for joint in joints)
            absent = [column for column in columns if column not in self.names]
            partial = 0 < len(absent) < len(columns)
            if absent and (channel in needed or (channel == "effort" and partial)):
                raise self.missing(absent[0], hint=self._without_effort() if channel == "effort" else "")
            if not absent:
                found[channel] = columns
            elif partial:
                self.notes.append(f"left out the joints' {channel}: no column {_listed(absent)}")
        return found

    def of_others(self, joints: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
        """Columns of the channels that all of these joints have, which are none of the requested ones."""
        columns = {channel: tuple(f"{joint}.{channel}" for joint in joints) for channel in OTHER_CHANNELS}
        return self._complete({f"others.{channel}": own for channel, own in columns.items() if own})

    def _complete(self, groups: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
        """The groups of which all columns are there."""
        return {name: columns for name, columns in groups.items() if self.names.keys() >= set(columns)}

    def _without_effort(self) -> str:
        """Advice for a log without torques."""
        if self.owners(".effort"):
            return ""
        if self.owners(f".{DESIRED[0]}"):
            return "; --pd KP,KD makes efforts of the desired positions that are recorded"
        return f"; no torque is recorded: record it, or <joint>.{DESIRED[0]} for --pd KP,KD"

    def imu(self, required: bool) -> dict[str, tuple[str, ...]]:
        """Columns of each quantity of an IMU with both rates and specific force."""
        kept = self._complete({f"imu.{quantity}": columns for quantity, columns in IMU_COLUMNS.items()})
        wanted = (*IMU_COLUMNS["angular_velocity"], *IMU_COLUMNS["linear_acceleration"])
        needed = [column for column in wanted if column not in self.names]
        if not needed:
            return kept
        if required:
            others = f"; nor {_listed(needed[1:])}" if needed[1:] else ""
            raise RecordingError(f"{self.missing(needed[0])}{others}")
        if any(column in self.names for columns in IMU_COLUMNS.values() for column in columns):
            self.notes.append(f"{HALF_IMU} {_listed(needed)}")
        return {}

    def of_feet(self) -> dict[str, tuple[str, ...]]:
        """Columns of the force and contact of each foot."""
        forces = {f"{foot}.force": tuple(f"{foot}.force.{axis}" for axis in "xyz") for foot in self.owners(".force.x")}
        return self._complete(forces) | {f"{foot}.contact": (f"{foot}.contact",) for foot in self.owners(".contact")}


def _owners(names: Iterable[str], suffix: str) -> tuple[str, ...]:
    return tuple(n.removesuffix(suffix) for n in names if n.endswith(suffix) and n != suffix)


def _is_joint_column(name: str) -> bool:
    return any(name.endswith(f".{channel}") for channel in CHANNELS)


def _listed(names: Sequence[str]) -> str:
    return listed([(name or "(no name)") if len(name) <= 60 else name[:57] + "..." for name in names], 16)
