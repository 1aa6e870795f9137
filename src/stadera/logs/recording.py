"""A recording: a robot's sensor values as time-major arrays in SI units."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stadera.errors import RecordingError, UnknownNameError
from stadera.logs.columns import CHANNELS, IMU_COLUMNS, OTHER_CHANNELS, TIME
from stadera.logs.units import largest_of
from stadera.types import Array, Bools

if TYPE_CHECKING:
    from stadera.logs.foreign.column_map import ColumnMap
    from stadera.logs.topics import PdGains
    from stadera.logs.units import Units


_OTHERS = "others"  # name of `Recording.others` among its arrays


@dataclass(frozen=True, eq=False)
class Imu:
    """Values of an inertial measurement unit, in its own frame.

    Attributes:
        angular_velocity: (samples, 3) [rad/s].
        linear_acceleration: (samples, 3) [m/s²], the specific force: at rest +9.81 upwards.
        orientation: (samples, 4) quaternion xyzw of the IMU frame in the world, None if there is none.
        frame: name of the IMU frame, None if the log does not state it.
    """

    angular_velocity: Array
    linear_acceleration: Array
    orientation: Array | None = None
    frame: str | None = None

    def __repr__(self) -> str:
        with_orientation = "" if self.orientation is None else ", orientation"
        return f"Imu({len(self.angular_velocity)} samples{with_orientation}, frame {self.frame or 'not stated'})"


@dataclass(frozen=True, eq=False)
class OtherJoints:
    """Motion of k joints that belong to no leg: position (samples, k) [rad or m], velocity [rad/s or m/s] and effort
    [N·m or N], None if not recorded.
    """

    names: tuple[str, ...]
    position: Array
    velocity: Array | None = None
    effort: Array | None = None


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples of joints, IMU and feet on one strictly increasing clock.

    Attributes:
        time: (samples,) [s].
        joints: names, n of them.
        position: (samples, n) [rad].
        velocity: (samples, n) [rad/s], None if not recorded.
        acceleration: (samples, n) [rad/s²], None if not recorded.
        effort: (samples, n) [N·m], torque of the actuator on the joint, None if not recorded.
        imu: None if there is none.
        foot_force: by foot, (samples, 3) [N], force of the ground on the foot, world axes.
        foot_contact: by foot, (samples,) bool.
        source: origin of the recording, for messages.
        notes: changes made by the reader and later steps, one sentence each.
        doubts: reasons why a result from this recording is doubtful at best, one sentence each.
        others: joints besides `joints` whose motion is known, such as an arm's; None if there are none.

    Raises:
        RecordingError: inconsistent shapes, a value that is not finite, or time that does not increase; the message
            names the source, the column and the sample.
    """

    time: Array
    joints: tuple[str, ...]
    position: Array
    velocity: Array | None = None
    acceleration: Array | None = None
    effort: Array | None = None
    imu: Imu | None = None
    foot_force: Mapping[str, Array] = field(default_factory=dict)
    foot_contact: Mapping[str, Bools] = field(default_factory=dict)
    source: str = "recording"
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    others: OtherJoints | None = None

    def __post_init__(self) -> None:
        if self.time.ndim != 1:
            raise RecordingError(f"{self.source}: time needs shape (samples,), got {self.time.shape}")
        joint, times = Counter(self.joints).most_common(1)[0] if self.joints else ("", 0)
        if times > 1:
            raise RecordingError(f"{self.source}: joint {joint!r} is named {times} times")
        for name, values in self.arrays().items():
            table = () if name == TIME or name.endswith(".contact") else (len(self.columns(name)),)
            if values.shape != (shape := (len(self.time), *table)):
                hint = ": transposed" if values.shape == shape[::-1] else ""
                raise RecordingError(f"{self.source}: {name} needs shape {shape}, got {values.shape}{hint}")
        for name, values in self.arrays().items():
            check_values(values, self.columns(name), self.source)
        if len(back := np.flatnonzero(np.diff(self.time) <= 0)):
            raise no_clock(self.source, int(back[0]) + 1, self.time[back[0]], self.time[back[0] + 1])

    @classmethod
    def from_arrays(
        cls,
        time: ArrayLike,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        effort: ArrayLike | None = None,
        *,
        joints: Sequence[str],
        acceleration: ArrayLike | None = None,
        imu: Imu | None = None,
        foot_force: Mapping[str, ArrayLike] | None = None,
        foot_contact: Mapping[str, ArrayLike] | None = None,
        source: str = "recording",
    ) -> Recording:
        """Makes a recording from arrays or lists of numbers, copied to float64 if necessary.

        Shapes, units and errors are the class's; values that are not numbers raise RecordingError as well. Samples with
        a NaN are dropouts: they are removed and noted.

        Args:
            time, position, velocity, effort, acceleration, imu, foot_force: see `Recording`.
            joints: names of the n columns, as in the robot's model.
            foot_contact: by foot, (samples,), non-zero in contact.
            source: a name for messages.
        """
        if isinstance(joints, str):
            raise RecordingError(f"{source}: joints needs a list of names, got {joints!r}")
        _check_imu(imu, source)
        channels = dict(zip(CHANNELS, (position, velocity, acceleration, effort), strict=True))
        given = {TIME: time} | channels | {f"imu.{name}": getattr(imu, name, None) for name in IMU_COLUMNS}
        given |= {f"{foot}.force": force for foot, force in (foot_force or {}).items()}
        given |= {f"{foot}.contact": contact for foot, contact in (foot_contact or {}).items()}
        read = {name: _as_numbers(v, name, source) for name, v in given.items() if v is not None}
        arrays, notes = _without_dropouts(read, source)
        arrays |= {f"{foot}.contact": arrays[f"{foot}.contact"] != 0 for foot in foot_contact or {}}
        return cls(joints=tuple(joints), source=source, notes=notes, **fields_of(arrays, imu.frame if imu else None))

    @classmethod
    def from_dataframe(
        cls,
        df: Any,
        *,
        joints: Sequence[str] | None = None,
        require: Collection[str] = (),
        imu_frame: str | None = None,
        source: str = "dataframe",
        columns: str | Path | ColumnMap | None = None,
        units: str | Units | None = None,
        pd: str | PdGains | None = None,
    ) -> Recording:
        """Makes a recording from a data frame, with column names of the flat table or of a known other format.

        Rows with a missing value (null, NaN) are dropouts: they are removed and noted. Unknown columns are ignored and
        noted.

        Args:
            df: a pandas or polars DataFrame, a pyarrow Table, or a mapping of column names to arrays. `time` [s] may be
                the index of a pandas DataFrame.
            joints: the joints to use, in this order; None for all.
            require: what each of these joints needs: velocity, acceleration, effort; and "imu".
            imu_frame: frame of the IMU's values; None for the one in a pyarrow table's metadata.
            source: a name for messages.
            columns, units, pd: see `stadera.logs.topics.ReadOptions.of`.

        Raises:
            RecordingError: a column is missing, misspelled or not numeric, or time does not increase.
            UnknownNameError: an unknown unit.
        """
        from stadera.logs.frames import from_dataframe
        from stadera.logs.topics import ReadOptions

        return from_dataframe(df, joints, require, imu_frame, source, ReadOptions.of(columns, units, pd))

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        channels = ", ".join(name for name in self.arrays() if name != TIME)
        span = f", {self.time[0]:.3f} to {self.time[-1]:.3f} s" if len(self) else ""
        return f"Recording of {self.name!r}: {len(self)} samples{span}, {len(self.joints)} joints; {channels}"

    @property
    def name(self) -> str:
        """The last part of its source, for messages."""
        return PurePath(self.source).name

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All recorded arrays by name: "time", "position", "imu.angular_velocity", "<foot>.force" ..."""
        found: dict[str, NDArray[Any] | None] = {TIME: self.time}
        found |= {name: getattr(self, name) for name in CHANNELS}
        if self.imu is not None:
            found |= {f"imu.{name}": getattr(self.imu, name) for name in IMU_COLUMNS}
        found |= {f"{foot}.force": force for foot, force in self.foot_force.items()}
        found |= {f"{foot}.contact": contact for foot, contact in self.foot_contact.items()}
        if self.others is not None:
            found |= {f"{_OTHERS}.{name}": getattr(self.others, name) for name in OTHER_CHANNELS}
        return {name: values for name, values in found.items() if values is not None}

    def columns(self, name: str) -> tuple[str, ...]:
        """The flat table's columns of one of `arrays`."""
        if name in CHANNELS:
            return tuple(f"{joint}.{name}" for joint in self.joints)
        owner, _, quantity = name.rpartition(".")
        if owner == _OTHERS and self.others is not None:
            return tuple(f"{joint}.{quantity}" for joint in self.others.names)
        if owner == "imu" and quantity in IMU_COLUMNS:
            return IMU_COLUMNS[quantity]
        return tuple(f"{name}.{axis}" for axis in "xyz") if quantity == "force" else (name,)

    def mapped(self, change: Callable[[str, NDArray[Any]], NDArray[Any]]) -> Recording:
        """Returns a recording with the same channels, each of `arrays` replaced by `change(name, values)`."""
        new = {name: change(name, values) for name, values in self.arrays().items()}
        return replace(
            self, **fields_of(new, self.imu.frame if self.imu else None, self.others.names if self.others else ())
        )

    def with_others(self, names: Collection[str]) -> Recording:
        """Returns a recording that keeps the motion of those of these joints that it has, when others are selected."""
        found = tuple(joint for joint in self.joints if joint in names)
        if not found:
            return self
        more = (None if getattr(self, c) is None else self.channel(c, found) for c in OTHER_CHANNELS[1:])
        return replace(self, others=OtherJoints(found, self.channel("position", found), *more))

    def of_joints(self, joints: Sequence[str]) -> Recording:
        """The same samples of these joints, in this order; UnknownNameError if one is not recorded."""
        found = tuple(joints)
        if found == self.joints:
            return self
        kept: dict[str, Any] = {c: self.channel(c, found) for c in CHANNELS if getattr(self, c) is not None}
        return replace(self, joints=found, **kept)

    def channel(self, name: str, joints: tuple[str, ...]) -> Array:
        """One of position, velocity, acceleration, effort for the named joints, (samples, len(joints)).

        UnknownNameError if a joint, RecordingError if the channel is not recorded.
        """
        if (values := getattr(self, name)) is None:
            raise RecordingError(f"{self.source}: no column '{joints[0]}.{name}'; the log has no joint {name}")
        return np.asarray(values[:, [self.index(joint) for joint in joints]])

    def index(self, joint: str) -> int:
        """Column index of a joint; UnknownNameError if it is not recorded."""
        if joint not in self.joints:
            raise UnknownNameError("joint", joint, self.joints, self.source)
        return self.joints.index(joint)


def fields_of(
    arrays: Mapping[str, NDArray[Any]], imu_frame: str | None = None, others: tuple[str, ...] = ()
) -> dict[str, Any]:
    """A recording's fields by its `arrays`, the name of the IMU's frame, and of the other joints."""

    def under(owner: str, names: Iterable[str]) -> dict[str, NDArray[Any]]:
        return {name: arrays[f"{owner}{name}"] for name in names if f"{owner}{name}" in arrays}

    def of_feet(kind: str) -> dict[str, NDArray[Any]]:
        return {name.removesuffix(kind): values for name, values in arrays.items() if name.endswith(kind)}

    imu, motion = under("imu.", IMU_COLUMNS), under(f"{_OTHERS}.", OTHER_CHANNELS)
    return {
        **under("", (TIME, *CHANNELS)),
        "imu": Imu(**imu, frame=imu_frame) if imu else None,
        "foot_force": of_feet(".force"),
        "foot_contact": of_feet(".contact"),
        "others": OtherJoints(others, **motion) if motion else None,
    }


def _as_numbers(values: ArrayLike, name: str, source: str) -> Array:
    try:
        if isinstance(values, np.ma.MaskedArray):
            values = np.ma.filled(values.astype(np.float64), np.nan)
        array = np.asarray(values)
    except ValueError:
        raise RecordingError(f"{source}: {name}: its rows differ in length") from None
    if array.dtype.kind not in "fiub":
        raise RecordingError(f"{source}: {name} {no_numbers(array, name)}")
    return array.astype(np.float64, copy=False)


def no_numbers(values: NDArray[Any], name: str) -> str:
    """Says what is wrong with an array that does not hold numbers."""
    text = f"holds {values.dtype}, not numbers"
    if name != TIME:
        return text
    of_dates = ", as (t - t[0]) / numpy.timedelta64(1, 's')" if values.dtype.kind in "mM" else ""
    return f"{text}; time is needed in seconds{of_dates}"


def check_values(
    values: NDArray[Any], columns: Sequence[str], source: str, samples: NDArray[np.int64] | None = None
) -> None:
    """Checks that values (samples, columns) are finite and plausible; `samples` are their indices in the log. Raises
    RecordingError.
    """
    if not values.size:
        return
    table, largest = values.reshape(len(values), -1), np.array([largest_of(column) for column in columns])
    if ((table.max(axis=0) <= largest) & (table.min(axis=0) >= -largest)).all():
        return
    sample, column = np.argwhere(~(np.abs(table) <= largest))[0]
    value, at = table[sample, column], sample if samples is None else samples[sample]
    most = f", more than any sensor says in SI units (at most {largest[column]:g})" if np.isfinite(value) else ""
    raise RecordingError(f"{source}: column {columns[column]!r} is {value:.3g} at sample {at}{most}")


def no_clock(source: str, sample: int, before: float, time: float) -> RecordingError:
    """An error for a sample whose time repeats or runs back."""
    what = "stands still" if time == before else "runs back"
    return RecordingError(f"{source}: column 'time' {what} at sample {sample} ({before:.6f} to {time:.6f} s)")


def _check_imu(imu: Imu | None, source: str) -> None:
    """Raises RecordingError: something else, or without rates or specific forces."""
    missing = not isinstance(imu, Imu) or imu.angular_velocity is None or imu.linear_acceleration is None
    if imu is not None and missing:
        got = "one that is None" if isinstance(imu, Imu) else type(imu).__name__
        raise RecordingError(
            f"{source}: imu needs stadera.Imu(angular_velocity, linear_acceleration), each of shape (samples, 3), "
            f"got {got}"
        )


Rows = slice | Bools | NDArray[np.int64]


def _without_dropouts(arrays: Mapping[str, Array], source: str) -> tuple[dict[str, Array], tuple[str, ...]]:
    """The samples without NaN of arrays (samples, ...), and a note on the others. Raises RecordingError: there are none
    without.
    """
    if len({values.shape[:1] for values in arrays.values()}) > 1 or not arrays[TIME].size:
        return dict(arrays), ()
    blank = np.array([np.isnan(values.reshape(len(values), -1)).any(axis=1) for values in arrays.values()])
    kept, notes = complete(blank, list(arrays))
    if not len(kept):
        raise RecordingError(f"{source}: {list(arrays)[int(blank.sum(axis=1).argmax())]} is NaN: no sample is complete")
    return {name: values[kept] if notes else values for name, values in arrays.items()}, notes


def complete(blank: Bools, columns: Sequence[str], first: int = 0) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """The samples, counted from `first`, of which no cell is blank (columns, samples), and a note on the others."""
    dropped = np.asarray(blank.any(axis=0))
    kept = first + np.flatnonzero(~dropped)
    if len(kept) == len(dropped):
        return kept, ()
    holes, at = int(np.count_nonzero(np.diff(dropped.astype(np.int8), prepend=0) == 1)), int(np.argmax(dropped))
    where = f"the first at sample {first + at}, column {columns[int(np.argmax(blank[:, at]))]!r}"
    count = f"dropped {np.count_nonzero(dropped)} of {len(dropped)} samples with blank cells"
    return kept, (f"{count}, in {holes} dropout{'s' * (holes > 1)}, {where}",)


def take(recording: Recording, rows: Rows) -> Recording:
    """Selects samples of all channels by `rows` (slice, mask or increasing indices)."""
    return recording.mapped(lambda _, values: values[rows])


def concatenate(recordings: Sequence[Recording]) -> Recording:
    """Concatenates recordings with the same channels; their notes are joined. Raises RecordingError: none given,
    different joints or channels, or time that does not increase.
    """
    if not recordings:
        raise RecordingError("nothing to concatenate")
    first = recordings[0]
    if len(recordings) == 1:
        return first
    parts = [recording.arrays() for recording in recordings]
    held = [(recording.joints, part.keys()) for recording, part in zip(recordings, parts, strict=True)]
    if any(other != held[0] for other in held):
        raise RecordingError(f"{first.source}: parts that hold different joints or channels cannot be concatenated")
    joined = first.mapped(lambda name, _: np.concatenate([part[name] for part in parts]))
    notes = chain.from_iterable(part.notes for part in recordings)
    doubts = chain.from_iterable(part.doubts for part in recordings)
    return replace(joined, notes=tuple(dict.fromkeys(notes)), doubts=tuple(dict.fromkeys(doubts)))


def with_velocity(recording: Recording, window: float = 0.02) -> Recording:
    """Adds joint velocities if the recording has none: slopes of the positions (Savitzky and Golay, 1964).

    Each slope is that of the parabola fitted to the positions within `window` [s] around a sample, at least five of
    them, so it is not delayed; a trot's joints move at up to about 15 Hz. A recording with fewer samples stays without
    velocities.
    """
    others = recording.others
    if others is not None and others.velocity is None and len(recording) >= 5:
        slopes = _slopes(recording.time, others.position, window)[0]
        recording = replace(recording, others=replace(others, velocity=slopes))
    if recording.velocity is not None or len(recording) < 5:
        return recording
    velocity, length = _slopes(recording.time, recording.position, window)
    note = f"no joint velocities: differentiated from positions over {length} samples"
    return replace(recording, velocity=velocity, notes=(*recording.notes, note))


def _slopes(time: Array, position: Array, window: float) -> tuple[Array, int]:
    """Slopes of positions (samples, n), and the number of samples in the window."""
    from scipy import signal

    period = float(np.median(np.diff(time)))
    length = 2 * max(round(0.5 * window / period), 2) + 1
    length = min(length, len(time) - 1 + len(time) % 2)
    velocity = signal.savgol_filter(position, length, polyorder=2, deriv=1, delta=period, axis=0)
    return np.asarray(velocity), length
