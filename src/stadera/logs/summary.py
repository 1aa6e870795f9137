"""Summarises a log: columns, duration, rate, gaps and ranges, in one pass with memory independent of its length."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.columns import CHANNELS
from stadera.logs.recording import Recording
from stadera.logs.sampling import GAP_FACTOR, HEAD
from stadera.types import Array

_UNITS = {
    "position": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s²",
    "effort": "N·m",
    "angular_velocity": "rad/s",
    "linear_acceleration": "m/s²",
    "orientation": "",
    "force": "N",
}


@dataclass(frozen=True)
class Range:
    """Least and largest value of a signal, with its unit."""

    name: str
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class LogSummary:
    """Summary of a log."""

    source: str
    samples: int
    # start, end: first and last time stamp [s]
    start: float
    end: float
    period: float  # median step between the first stamps [s]
    uneven: float  # share of all steps that differ from the period by more than a tenth of it
    # steps of more than five periods: begin and duration of each [s]; the first 1000
    gaps: tuple[tuple[float, float], ...]
    gap_count: int  # of all
    joints: tuple[str, ...]
    feet: tuple[str, ...]
    channels: tuple[str, ...]  # recorded ones of the joints
    has_imu: bool
    imu_frame: str | None  # frame of the IMU's values, None if the log does not state it
    ranges: tuple[Range, ...]  # of every signal
    notes: tuple[str, ...]

    @property
    def duration(self) -> float:
        """From the first to the last stamp [s]."""
        return self.end - self.start


def summarize(chunks: Iterable[Recording], most_gaps: int = 1000) -> LogSummary:
    """Summarises consecutive chunks of one log, such as from `stream` gives; `most_gaps` are listed, all are counted.
    Raises RecordingError: fewer than two samples.
    """
    chunks = iter(chunks)
    first = next(chunks, None)
    if first is None:
        raise RecordingError("recording: too few samples: 0")
    period = float(np.median(np.diff(first.time[:HEAD]))) if len(first) > 1 else float("nan")
    start = float(first.time[0])
    last = start - period
    extremes: dict[str, tuple[Array, Array]] = {}
    notes: dict[str, None] = {}
    gaps: list[tuple[float, float]] = []
    samples = uneven = gap_count = 0
    for chunk in chain([first], chunks):
        notes |= dict.fromkeys(chunk.notes)
        stamps = np.concatenate([[last], chunk.time])
        step = np.diff(stamps)
        wide = np.flatnonzero(step > GAP_FACTOR * period)
        gaps += [(float(stamps[i]), float(step[i])) for i in wide[: most_gaps - len(gaps)]]
        gap_count += len(wide)
        uneven += int(np.count_nonzero(np.abs(step - period) > 0.1 * period))
        samples, last = samples + len(chunk), float(chunk.time[-1])
        for name, values in chunk.arrays().items():
            if name.rpartition(".")[-1] in _UNITS:
                low, high = extremes.get(name, (values[0], values[0]))
                extremes[name] = np.minimum(low, values.min(axis=0)), np.maximum(high, values.max(axis=0))
    if samples < 2:
        raise RecordingError(f"{first.source}: too few samples: {samples}")
    return LogSummary(
        source=first.source,
        samples=samples,
        start=start,
        end=last,
        period=period,
        uneven=uneven / samples,
        gaps=tuple(gaps),
        gap_count=gap_count,
        joints=first.joints,
        feet=tuple(dict.fromkeys((*first.foot_force, *first.foot_contact))),
        channels=tuple(name for name in CHANNELS if getattr(first, name) is not None),
        has_imu=first.imu is not None,
        imu_frame=None if first.imu is None else first.imu.frame,
        ranges=tuple(
            Range(column, float(a), float(b), _UNITS[name.rpartition(".")[-1]])
            for name, (low, high) in extremes.items()
            for column, a, b in zip(first.columns(name), low, high, strict=True)
        ),
        notes=tuple(notes),
    )
