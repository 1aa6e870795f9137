"""Leaves out samples that repeat the joints' values: of a log that is written faster than its joints are read.

Between two readings the joints seem to rest and then to jump, and their torques are those of an earlier instant. An IMU
that is held for a few samples does no such harm.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from stadera.logs.recording import Recording, take
from stadera.types import Array, Bools

LONGEST = 0.05
"""Longest time for which joints are held [s], between readings at 20 Hz; joints that repeat for longer are at rest."""
SHARE = 0.2
"""Share of the samples that repeat the one before, from which on they are left out [1]: 200 Hz read at 250 Hz."""

ENOUGH = 10
"""Least number of different samples by which joints are taken to be held: fewer may be a robot at rest."""

_CHANNELS = ("position", "velocity", "effort")


def without_repeats(chunks: Iterable[Recording]) -> Iterator[Recording]:
    """Yields the consecutive parts of a log without samples that have the same positions, velocities and efforts as the
    one before; all samples where these are not known, or repeat for long. The first part with any has a note.
    """
    last: Array | None = None
    noted = False
    for chunk in chunks:
        if chunk.velocity is None or chunk.effort is None or not chunk.joints:
            yield chunk
            continue
        values = np.hstack([channel for name in _CHANNELS if (channel := getattr(chunk, name)) is not None])
        first = np.full_like(values[:1], np.nan) if last is None else last
        last, fresh = values[-1:], (np.diff(values, axis=0, prepend=first) != 0.0).any(axis=1)
        kept = _kept(fresh, chunk.time)
        if kept.all():
            yield chunk
        elif kept.any():
            note = f"{100 * (1 - kept.mean()):.0f} % of the samples repeat the joints' values, and are left out"
            yield replace(take(chunk, kept), notes=(*chunk.notes, *([] if noted else [note])))
            noted = True


def _kept(fresh: Bools, time: Array) -> Bools:
    """Which samples (n,) are kept, given those that differ from the one before."""
    begin = np.flatnonzero(np.concatenate([[True], fresh[1:]]))  # of runs of equal samples
    end = np.append(begin[1:], len(fresh))
    short = time[end - 1] - time[begin] <= LONGEST
    repeats = ~fresh & np.repeat(short, end - begin)
    held = np.count_nonzero(fresh) >= ENOUGH and repeats.mean() > SHARE
    return ~repeats if held else np.ones(len(fresh), dtype=bool)
