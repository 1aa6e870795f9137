"""Weighs a running robot: its topics over Zenoh in, its trunk and payload out.

    Zenoh ──messages──▶ Worker ──▶ Intake ──samples──▶ TrunkEstimator ──▶ LiveState ──▶ Zenoh, terminal, Rerun, MCAP
    (or a log, replayed)  queue      decoded, merged

The worker's thread does all the work; sources of messages only queue them.
"""

from stadera.live.run import Worker
from stadera.live.session import Answer, LiveSession
from stadera.live.state import LiveSettings, LiveState

__all__ = ["Answer", "LiveSession", "LiveSettings", "LiveState", "Worker"]
