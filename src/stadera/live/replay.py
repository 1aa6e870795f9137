"""Replays a log as if the robot were running now, and records messages as a log."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stadera.checks import Guard
from stadera.live import messages
from stadera.live.state import LiveState
from stadera.live.topics import KINDS, Arrival
from stadera.logs import stream, take
from stadera.logs.reader import Log, as_log
from stadera.logs.recording import Recording, with_velocity
from stadera.robot.model import Robot
from stadera.weigh.reading import with_extra_joints

if TYPE_CHECKING:
    from stadera.live.run import Worker


def replay(
    log: Log,
    robot: Robot,
    worker: Worker,
    stop: threading.Event,
    rate: float = 1.0,
    piece: float = 0.01,
    queue: int = 100,
    imu_frame: str | None = None,
    fix: bool = False,
) -> None:
    """Passes a log's samples to a worker in real time, or `rate` times as fast, infinite for as fast as the estimator;
    returns at its end, or when `stop` is set.

    Args:
        piece: duration of the parts of the log passed on at once [s].
        queue: largest number of waiting pieces, if the log is faster than the estimator.
        imu_frame, fix: as in `stadera.weigh`.

    Raises:
        RecordingError: the log cannot be read, or lacks a joint's torque or the IMU. UntrustedError: its units or signs
            are wrong.
    """
    begun: tuple[float, float] | None = None
    source = Guard(robot, robot.tree.joints, imu_frame=imu_frame).admitted(as_log(log), fix=fix, force=False)
    for samples in _pieces(source, robot, piece):
        begun = begun or (time.monotonic(), float(samples.time[0]))
        due = begun[0] + (float(samples.time[-1]) - begun[1]) / rate
        while (wait := due - time.monotonic()) > 0 or worker.pending > queue:
            if stop.wait(max(wait, 0.001)):
                return
        if stop.is_set():
            return
        worker.put(samples)


def _pieces(log: Log, robot: Robot, piece: float) -> Iterator[Recording]:
    _, (source,), _ = with_extra_joints(robot, as_log(log))
    for chunk in stream(source, joints=robot.tree.joints, require=("effort", "imu")):
        whole = with_velocity(chunk)
        edges = np.flatnonzero(np.diff(np.floor(whole.time / piece)) > 0) + 1
        for rows in np.split(np.arange(len(whole)), edges):
            if len(rows):
                yield take(whole, slice(int(rows[0]), int(rows[-1]) + 1))


_JSON = "json"


class MessageRecorder:
    """Writes one file, which is complete after `close`; thread-safe."""

    def __init__(self, path: Path) -> None:
        from mcap.writer import Writer

        self._file, self._lock = path.open("wb"), threading.Lock()
        self._writer, self._channels = Writer(self._file, chunk_size=1 << 18), dict[str, int]()
        self._writer.start(profile="ros2", library="stadera")

    def keep(self, arrival: Arrival) -> None:
        """Writes a received message, with its time of sending as time of recording."""
        if arrival.kind in KINDS:
            self._write(arrival.topic, arrival.kind, arrival.received, arrival.data)

    def sent(self, state: LiveState) -> None:
        """Writes the messages sent for a state."""
        now = time.time_ns()
        for topic, data in messages.of_state(state).items():
            self._write(f"/{topic}", _JSON if topic == messages.STATE else messages.KINDS[topic], now, data)

    def close(self) -> None:
        """Completes the file with its index."""
        with self._lock:
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.close()

    def _write(self, topic: str, kind: str, stamp: int, data: bytes) -> None:
        with self._lock:
            if topic not in self._channels:
                self._channels[topic] = self._channel(topic, kind)
            self._writer.add_message(self._channels[topic], stamp, data, stamp)

    def _channel(self, topic: str, kind: str) -> int:
        if kind == _JSON:
            return self._writer.register_channel(topic, "json", 0)
        definition = messages.types().generate_msgdef(kind, ros_version=2)[0].encode()
        return self._writer.register_channel(topic, "cdr", self._writer.register_schema(kind, "ros2msg", definition))
