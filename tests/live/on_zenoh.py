"""Messages as they arrive, and a Zenoh program that listens."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable
from typing import Any

from bags import Sent
from stadera.live.topics import Arrival

LOADED_AT = 2.2  # s, when the walk gets its load
PATIENCE = 60.0  # s, that nothing takes on the slowest machine

Publish = Callable[..., subprocess.Popen[str]]
"""Starts a robot in another process, by the kind of its messages and options of publisher.py."""


def arrivals(sent: list[Sent], delay: float = 0.0) -> list[Arrival]:
    """Messages as they arrive as soon as they are sent, `delay` [s] later by the clock of arrivals."""
    return [Arrival(m.topic, m.kind, m.received, m.data, 1e-9 * m.received + delay) for m in sent]


class Listener:
    """A Zenoh program beside the estimator: the last state, everything published, requests."""

    def __init__(self, endpoint: str) -> None:
        import zenoh

        config = zenoh.Config()
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("listen/endpoints", "[]")
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        self.session = zenoh.open(config)
        self.states: list[dict[str, Any]] = []
        self.last: dict[str, Any] = {}
        self._subscribers = [
            self.session.declare_subscriber("stadera/*", self._take),
            self.session.declare_subscriber("*/stadera/**", self._take),
        ]

    def _take(self, sample: Any) -> None:
        key = str(sample.key_expr)
        self.last[key] = sample
        if key == "stadera/state":
            self.states.append(json.loads(sample.payload.to_bytes()))

    def until(self, fits: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first state from now on that fits."""
        seen, deadline = len(self.states), time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            for state in self.states[seen:]:
                seen += 1
                if fits(state):
                    return state
            time.sleep(0.02)
        raise AssertionError(f"no such state; the last one: {self.states[-1:]}")

    def ask(self, key: str, **options: Any) -> Any:
        """The answer to a request, once somebody answers."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            for reply in self.session.get(key, timeout=10.0, **options):
                if reply.ok is not None:
                    return reply.ok
            time.sleep(0.05)
        raise AssertionError(f"nobody answers {key}")
