"""Runs a session from start to end: messages or a replayed log in, a thread that processes them, sinks of states."""

import gc
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stadera.checks import Guard
from stadera.live import messages
from stadera.live.link import Endpoints, ZenohLink
from stadera.live.messages import RESET, TARE
from stadera.live.session import Answer, LiveSession
from stadera.live.state import LiveState
from stadera.live.topics import KINDS, Arrival
from stadera.logs import stream, take
from stadera.logs.reader import Log, as_log
from stadera.logs.recording import Recording, with_velocity
from stadera.logs.topics import LogFile, Topics
from stadera.process import one_thread
from stadera.robot.model import Robot
from stadera.weigh.reading import with_extra_joints


class _Request(NamedTuple):
    """A request to be processed between two messages, and the function that receives the answer."""

    do: Callable[[], Answer]
    reply: Callable[[Answer], None]


_Item = Arrival | Recording | _Request


class Worker:
    """Feeds a session, not to be used by others between `start` and `stop`, in a separate thread. `put` and `ask` never
    wait, and may be called from any thread. `keep` is called with every message before it is processed.

    Attributes:
        sinks: called in the worker's thread with a state every `period`, and at once after a change.
        dropped: number of messages dropped because the queue was full, the oldest first.
        failure: the exception that ended the thread; None if there is none.
    """

    def __init__(self, session: LiveSession, keep: Callable[[Arrival], None] | None = None) -> None:
        self._session, self._settings, self._keep = session, session.settings, keep
        self.sinks: Sequence[Callable[[LiveState], None]] = ()
        self._waiting: deque[_Item] = deque()
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="stadera live", daemon=True)
        self._due = 0.0
        self._sent: tuple[object, ...] = ()
        self.dropped = 0
        self.failure: BaseException | None = None

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Processes the queue, sends a last state, and ends; returns when that is done."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def put(self, item: Arrival | Recording) -> None:
        """Queues a message, or samples of a log. If the queue is full the oldest message is dropped."""
        with self._lock:
            self._waiting.append(item)
            if len(self._waiting) > self._settings.queue:
                oldest = next((k for k, item in enumerate(self._waiting) if not isinstance(item, _Request)), None)
                if oldest is not None:
                    del self._waiting[oldest]
                    self.dropped += 1

    def ask(self, do: Callable[[], Answer], reply: Callable[[Answer], None]) -> None:
        """Queues a request such as `session.tare`; its answer is passed to `reply` in the worker's thread."""
        with self._lock:
            self._waiting.append(_Request(do, reply))

    @property
    def pending(self) -> int:
        """Number of queued items."""
        return len(self._waiting)

    # -- inside -----------------------------------------------------------------------------------------------
    def _run(self) -> None:
        try:
            stopping = False
            while not stopping:
                stopping = self._stop.wait(self._settings.batch)
                with self._lock:
                    items, self._waiting = self._waiting, deque()
                self.work(items)
                self._send(final=stopping)
        except BaseException as error:  # passed to the thread that waits for this one
            self.failure = error

    def work(self, items: Sequence[_Item]) -> None:
        """Processes items: consecutive messages together, requests and samples one by one."""
        arrivals: list[Arrival] = []
        for item in items:
            if isinstance(item, Arrival):
                if self._keep is not None:
                    self._keep(item)
                arrivals.append(item)
                continue
            self._session.feed(arrivals)
            arrivals = []
            if isinstance(item, _Request):
                item.reply(item.do())
            else:
                self._session.add(item, time.monotonic())
        self._session.feed(arrivals)

    def _send(self, *, final: bool) -> None:
        now = time.monotonic()
        with self._lock:  # the arrival of the oldest queued message
            until = next((item.arrived for item in self._waiting if isinstance(item, Arrival)), now)
        event = self._session.event(until)
        if now < self._due and event == self._sent and not final:
            return
        state = self._session.state(now, until)
        state = replace(state, lost={**state.lost, "queue": self.dropped})
        self._due, self._sent = now + self._settings.period, event
        for sink in self.sinks:
            sink(state)


@one_thread()
def run(
    session: LiveSession,
    endpoints: Endpoints,
    topics: Topics,
    stop: threading.Event,
    sinks: Sequence[Callable[[LiveState], None]] = (),
    record: Path | None = None,
    log: LogFile | None = None,
    rate: float = 1.0,
) -> LiveState:
    """Runs until `stop` is set or the log ends, and returns the last state.

    Messages are of these topics at Zenoh endpoints, where results are published even if a log is replayed instead,
    `rate` times as fast as recorded. The sinks are called with every state, in the worker's thread; the record of
    received and sent messages is complete on return.

    Raises:
        MissingExtraError: zenoh is not installed. StaderaError: Zenoh cannot be started.
        RecordingError: the log cannot be replayed. UntrustedError: its units or signs are wrong.
    """
    recorder = None if record is None else MessageRecorder(record)
    worker = Worker(session, keep=None if recorder is None else recorder.keep)
    link: ZenohLink | None = None
    try:
        requests = {TARE: session.tare, RESET: session.reset}
        put = worker.put if log is None else None
        link = ZenohLink(endpoints, topics, put, requests, worker.ask)
        session.intake.announced = link.announced
        worker.sinks = (link.publish, *([] if recorder is None else [recorder.sent]), *sinks)
        # the collector of cyclic garbage would look through all modules and models now and then, for up to 80 ms
        gc.collect()
        gc.freeze()
        worker.start()
        if log is not None:
            replay(log, session.robot, worker, stop, rate, imu_frame=session.imu_frame, fix=session.fix)
        else:
            while not stop.wait(0.05) and worker.failure is None:  # s, until a failure of the worker is noticed
                pass
    finally:
        worker.stop()
        gc.unfreeze()
        if link is not None:
            link.close()
        if recorder is not None:
            recorder.close()
    if worker.failure is not None:
        raise worker.failure
    return session.state()


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
    _, (read,), _ = with_extra_joints(robot, as_log(log))
    source = Guard(robot, robot.tree.joints, imu_frame=imu_frame).admitted(read, fix=fix, force=False)
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
    for chunk in stream(log, joints=robot.tree.joints, require=("effort", "imu")):
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
