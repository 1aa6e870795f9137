"""Computes joint velocities for a log that records positions only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stadera.logs.recording import Recording


def with_velocity(recording: Recording, window: float = 0.02) -> Recording:
    """Adds joint velocities if the recording has none: slopes of the positions (Savitzky and Golay, 1964).

    Each slope is that of the parabola fitted to the positions within `window` [s] around a sample, at least five of
    them, so it is not delayed; a trot's joints move at up to about 15 Hz. A recording with fewer samples stays without
    velocities.
    """
    if recording.velocity is not None or len(recording) < 5:
        return recording
    from scipy import signal

    period = float(np.median(np.diff(recording.time)))
    length = 2 * max(round(0.5 * window / period), 2) + 1
    length = min(length, len(recording) - 1 + len(recording) % 2)
    velocity = signal.savgol_filter(recording.position, length, polyorder=2, deriv=1, delta=period, axis=0)
    note = f"no joint velocities: differentiated from positions over {length} samples"
    return replace(recording, velocity=np.asarray(velocity), notes=(*recording.notes, note))
