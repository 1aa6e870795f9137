"""Computes joint velocities for a log that records positions only."""

from dataclasses import replace

import numpy as np

from stadera.logs.recording import Recording
from stadera.types import Array


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
