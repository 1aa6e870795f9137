"""Operations on recordings: selects samples, concatenates, adds velocities."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.logs.recording import Recording
from stadera.types import Array, Bools

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
