"""Cuts and concatenates recordings in time."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.logs.recording import Recording
from stadera.types import Bools

Rows = slice | Bools | NDArray[np.int64]


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
    if any(other.joints != first.joints for other in recordings) or any(
        part.keys() != parts[0].keys() for part in parts
    ):
        raise RecordingError(f"{first.source}: parts that hold different joints or channels cannot be concatenated")
    joined = first.mapped(lambda name, _: np.concatenate([part[name] for part in parts]))
    notes, doubts = (
        tuple(dict.fromkeys(said for part in recordings for said in getattr(part, name)))
        for name in ("notes", "doubts")
    )
    return replace(joined, notes=notes, doubts=doubts)
