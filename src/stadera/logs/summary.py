"""Summarises a log: columns, duration, rate, gaps and ranges, in one pass with memory independent of its length."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain

import numpy as np

from stadera.logs.recording import Recording
from stadera.logs.sampling import GAP_FACTOR, HEAD, usual_step
from stadera.logs.units import RECORDED
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class LogSummary:
    """Summary of a log."""

    head: Recording  # its first samples, with its joints, channels and source
    samples: int
    end: float  # last time stamp [s]
    period: float  # usual step between the first stamps [s]
    uneven: float  # share of all steps that differ from the period by more than a tenth of it
    # steps of more than five periods: begin and duration of each [s]; the first 1000
    gaps: tuple[tuple[float, float], ...]
    gap_count: int  # of all
    ranges: tuple[tuple[str, float, float, str], ...]  # of every signal: its name, least and largest value, unit
    notes: tuple[str, ...]


def summarize(chunks: Iterable[Recording], most_gaps: int = 1000) -> LogSummary:
    """Summarises consecutive chunks of one log, as `stream` gives them; `most_gaps` are listed, all are counted."""
    chunks = iter(chunks)
    head = next(chunks)
    period = usual_step(head.time[:HEAD]) if len(head) > 1 else 0.0  # a stream of one sample ends with an error
    last = float(head.time[0]) - period
    extremes: dict[str, tuple[Array, Array]] = {}
    notes: dict[str, None] = {}
    gaps: list[tuple[float, float]] = []
    samples = uneven = gap_count = 0
    for chunk in chain([head], chunks):
        notes |= dict.fromkeys(chunk.notes)
        stamps = np.concatenate([[last], chunk.time])
        step = np.diff(stamps)
        wide = np.flatnonzero(step > GAP_FACTOR * period)
        gaps += [(float(stamps[i]), float(step[i])) for i in wide[: most_gaps - len(gaps)]]
        gap_count += len(wide)
        uneven += int(np.count_nonzero(np.abs(step - period) > 0.1 * period))
        samples, last = samples + len(chunk), float(chunk.time[-1])
        for name, values in chunk.arrays().items():
            if name.rpartition(".")[-1] in RECORDED:
                low, high = extremes.get(name, (values[0], values[0]))
                extremes[name] = np.minimum(low, values.min(axis=0)), np.maximum(high, values.max(axis=0))
    ranges = [
        (column, float(least), float(most), RECORDED[name.rpartition(".")[-1]][0])
        for name, (low, high) in extremes.items()
        for column, least, most in zip(head.columns(name), low, high, strict=True)
    ]
    return LogSummary(
        head, samples, last, period, uneven / samples, tuple(gaps), gap_count, tuple(ranges), tuple(notes)
    )
