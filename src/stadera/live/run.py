"""Runs a session from start to end: source of messages, receivers of states, clean shutdown."""

import gc
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from stadera.live.link import Endpoints, ZenohLink
from stadera.live.messages import RESET, TARE
from stadera.live.replay import MessageRecorder, replay
from stadera.live.session import LiveSession
from stadera.live.state import LiveState
from stadera.live.worker import Worker
from stadera.logs.topics import LogFile, Topics
from stadera.threads import one_thread

_POLL = 0.05  # s, after which a failure of the worker ends the session


@dataclass(frozen=True)
class LiveSource:
    """Source of the messages: topics at Zenoh endpoints, where results are published even if a log is replayed instead,
    `rate` times as fast as recorded.
    """

    endpoints: Endpoints
    topics: Topics
    log: LogFile | None = None
    rate: float = 1.0


@one_thread()
def run(
    session: LiveSession,
    source: LiveSource,
    stop: threading.Event,
    sinks: Sequence[Callable[[LiveState], None]] = (),
    record: Path | None = None,
) -> LiveState:
    """Runs until `stop` is set or the log ends, and returns the last state. The sinks are called with every state, in
    the worker's thread; the record of received and sent messages is complete on return.

    Raises:
        MissingExtraError: zenoh is not installed. StaderaError: Zenoh cannot be started.
        RecordingError: the log cannot be replayed. UntrustedError: its units or signs are wrong.
    """
    recorder = None if record is None else MessageRecorder(record)
    worker = Worker(session, keep=None if recorder is None else recorder.keep)
    link: ZenohLink | None = None
    try:
        requests = {TARE: session.tare, RESET: session.reset}
        put = worker.put if source.log is None else None
        link = ZenohLink(source.endpoints, source.topics, put, requests, worker.ask)
        session.intake.announced = link.announced
        worker.sinks = (link.publish, *([] if recorder is None else [recorder.sent]), *sinks)
        # the collector of cyclic garbage would look through all modules and models now and then, for up to 80 ms
        gc.collect()
        gc.freeze()
        worker.start()
        if source.log is not None:
            frame, fix = session.imu_frame, session.fix
            replay(source.log, session.robot, worker, stop, source.rate, imu_frame=frame, fix=fix)
        else:
            while not stop.wait(_POLL) and worker.failure is None:
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
