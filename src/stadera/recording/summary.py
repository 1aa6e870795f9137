"""What is in a log: columns, duration, rate, gaps and ranges, found in one pass with memory flat in its length."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from stadera.errors import RecordingError
from stadera.recording.recording import Array, Recording
from stadera.recording.sampling import GAP_FACTOR, HEAD

_UNITS = {
    "position": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s²",
    "effort": "N·m",
    "imu.angular_velocity": "rad/s",
    "imu.linear_acceleration": "m/s²",
    "imu.orientation": "",
    "force": "N",
}


@dataclass(frozen=True)
class Range:
    """One signal's least and largest value, with its unit."""

    name: str
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class LogSummary:
    """What is in a log.

    Attributes:
        source: the log.
        samples: how many.
        start, end: first and last time stamp [s].
        period: median step between the first stamps [s].
        uneven: share of all steps that differ from the period by more than a tenth of it.
        gaps: steps of more than five periods: when each begins and how long it is [s]; the first thousand.
        gap_count: all of them.
        joints, feet: names.
        channels: what is recorded of the joints.
        has_imu: whether there is one.
        imu_frame: that its values are in, None where the log does not say.
        ranges: of every signal.
        notes: the reader's.
    """

    source: str
    samples: int
    start: float
    end: float
    period: float
    uneven: float
    gaps: tuple[tuple[float, float], ...]
    gap_count: int
    joints: tuple[str, ...]
    feet: tuple[str, ...]
    channels: tuple[str, ...]
    has_imu: bool
    imu_frame: str | None
    ranges: tuple[Range, ...]
    notes: tuple[str, ...]

    @property
    def duration(self) -> float:
        """From the first to the last stamp [s]."""
        return self.end - self.start


def summarize(chunks: Iterable[Recording]) -> LogSummary:
    """Sum up consecutive chunks of one log, such as `stream` gives.

    Raises:
        RecordingError: fewer than two samples.
    """
    first: Recording | None = None
    low: dict[str, Array] = {}
    high: dict[str, Array] = {}
    notes: dict[str, None] = {}
    samples, steps, uneven, gap_count = 0, 0, 0, 0
    period = start = last = float("nan")
    gaps: list[tuple[float, float]] = []
    for chunk in chunks:
        if first is None:
            first, start = chunk, float(chunk.time[0])
            period = float(np.median(np.diff(chunk.time[:HEAD]))) if len(chunk) > 1 else float("nan")
            last = start - period
        notes |= dict.fromkeys(chunk.notes)
        stamps = np.concatenate([[last], chunk.time])
        step = np.diff(stamps)
        wide = np.flatnonzero(step > GAP_FACTOR * period)
        gaps += [(float(stamps[i]), float(step[i])) for i in wide[: 1000 - len(gaps)]]
        gap_count += len(wide)
        uneven += int(np.count_nonzero(np.abs(step - period) > 0.1 * period))
        samples, steps, last = samples + len(chunk), steps + len(step), float(chunk.time[-1])
        for name, values in _signals(chunk):
            low[name] = np.minimum(low.get(name, np.inf), values.min(axis=0))
            high[name] = np.maximum(high.get(name, -np.inf), values.max(axis=0))
    if first is None or samples < 2:
        raise RecordingError(f"{first.source if first else 'recording'}: too few samples: {samples}")
    return LogSummary(
        source=first.source,
        samples=samples,
        start=start,
        end=last,
        period=period,
        uneven=uneven / steps,
        gaps=tuple(gaps),
        gap_count=gap_count,
        joints=first.joints,
        feet=tuple(dict.fromkeys((*first.foot_force, *first.foot_contact))),
        channels=tuple(c for c in ("position", "velocity", "acceleration", "effort") if getattr(first, c) is not None),
        has_imu=first.imu is not None,
        imu_frame=None if first.imu is None else first.imu.frame,
        ranges=tuple(_ranges(first, low, high)),
        notes=tuple(notes),
    )


def _signals(chunk: Recording) -> Iterator[tuple[str, Array]]:
    for channel in ("position", "velocity", "acceleration", "effort"):
        if (values := getattr(chunk, channel)) is not None:
            yield channel, values
    if chunk.imu is not None:
        for quantity in ("angular_velocity", "linear_acceleration", "orientation"):
            if (values := getattr(chunk.imu, quantity)) is not None:
                yield f"imu.{quantity}", values
    for foot, force in chunk.foot_force.items():
        yield f"{foot}.force", force


def _ranges(first: Recording, low: dict[str, Array], high: dict[str, Array]) -> Iterator[Range]:
    for name, least in low.items():
        is_joints = name in ("position", "velocity", "acceleration", "effort")
        unit = _UNITS["force" if name.endswith(".force") else name]
        owners = [f"{j}.{name}" for j in first.joints] if is_joints else [f"{name}.{axis}" for axis in "xyzw"]
        for k, (a, b) in enumerate(zip(least, high[name], strict=True)):
            yield Range(owners[k], float(a), float(b), unit)
