"""The queue: in order, bounded, and honest about what it dropped."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import pytest
from on_zenoh import PATIENCE

from stadera.live import Answer, LiveSession, LiveSettings, LiveState, Worker
from stadera.live.topics import Arrival
from stadera.robot import Robot


class Listed(LiveSession):
    """A session that notes what it gets."""

    def __init__(self, robot: Robot, settings: LiveSettings) -> None:
        super().__init__(robot, settings=settings)
        self.got: list[str] = []

    def feed(self, arrivals: Iterable[Arrival]) -> None:
        self.got += [arrival.topic for arrival in arrivals]

    def tare(self) -> Answer:
        self.got.append("tare")
        return Answer(True, "")


def message(k: int) -> Arrival:
    return Arrival(str(k), "", 0, b"", 0.0)


def test_requests_are_done_between_the_messages_around_them(robot: Robot) -> None:
    session, answers = Listed(robot, LiveSettings()), []
    worker = Worker(session)
    for k in range(5):
        worker.put(message(k))
    worker.ask(session.tare, answers.append)
    worker.put(message(5))
    worker.start()
    worker.stop()
    assert session.got == ["0", "1", "2", "3", "4", "tare", "5"]
    assert answers == [Answer(True, "")]


def test_a_full_queue_drops_the_oldest_messages_and_no_request(robot: Robot) -> None:
    session, states = Listed(robot, replace(LiveSettings(), queue=10)), list[LiveState]()
    worker = Worker(session)
    worker.sinks = (states.append,)
    worker.ask(session.tare, lambda answer: None)
    for k in range(25):
        worker.put(message(k))
    worker.start()
    worker.stop()
    assert session.got == ["tare", *map(str, range(16, 25))]
    assert worker.dropped == 16
    assert states[-1].lost["queue"] == 16


def test_many_publishers_at_once_lose_nothing(robot: Robot) -> None:
    session = Listed(robot, LiveSettings())
    worker = Worker(session)
    worker.start()
    threads = [threading.Thread(target=lambda: [worker.put(message(k)) for k in range(500)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    worker.stop()
    assert len(session.got) == 2000
    assert worker.dropped == 0


def test_a_fault_of_the_program_is_handed_on(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    session = Listed(robot, LiveSettings())

    def broken(*_: Any) -> None:
        raise KeyError("a fault")

    monkeypatch.setattr(session, "event", broken)
    worker = Worker(session)
    worker.start()
    worker.stop()
    assert isinstance(worker.failure, KeyError)
