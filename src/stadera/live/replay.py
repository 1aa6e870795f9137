"""Replays a log as if the robot were running now."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np

from stadera.live.worker import Worker
from stadera.logs import stream, take
from stadera.logs.reader import Log
from stadera.logs.recording import Recording
from stadera.logs.velocity import with_velocity
from stadera.robot.model import Robot

_PIECE = 0.01  # s of the log that are passed on at once
_QUEUE = 100  # pieces that may be queued if the log is faster than the estimator


def replay(log: Log, robot: Robot, worker: Worker, stop: threading.Event, rate: float = 1.0) -> None:
    """Passes a log's samples to a worker in real time; returns at its end, or when `stop` is set.

    Args:
        log: with velocities or positions, torques and an IMU.
        rate: factor on the speed; infinite for as fast as the estimator.

    Raises:
        RecordingError: the log cannot be read, or lacks a joint's torque or the IMU.
    """
    begun: tuple[float, float] | None = None
    for piece in _pieces(log, robot):
        begun = begun or (time.monotonic(), float(piece.time[0]))
        due = begun[0] + (float(piece.time[-1]) - begun[1]) / rate
        while (wait := due - time.monotonic()) > 0 or worker.pending > _QUEUE:
            if stop.wait(max(wait, 0.001)):
                return
        if stop.is_set():
            return
        worker.put(piece)


def _pieces(log: Log, robot: Robot) -> Iterator[Recording]:
    for chunk in stream(log, joints=robot.tree.joints, require=("effort", "imu")):
        whole = with_velocity(chunk)
        edges = np.flatnonzero(np.diff(np.floor(whole.time / _PIECE)) > 0) + 1
        for rows in np.split(np.arange(len(whole)), edges):
            if len(rows):
                yield take(whole, slice(int(rows[0]), int(rows[-1]) + 1))
