"""A walk with a load, as a log and as messages, and whoever publishes them."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from on_zenoh import LOADED_AT, Listener, Publish

from logs_to_play import LOAD
from stadera.lab.plant.sensors import STANDARD
from stadera.logs import Recording, write_table
from stadera.robot import Robot, load_robot
from walking import Walk, recorded, walked


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_robot("hyq")


@pytest.fixture(scope="session")
def walk(robot: Robot) -> Recording:
    """3.4 s at 250 Hz with sensor errors; `LOAD` comes at `LOADED_AT`."""
    motion = walked(robot, Walk(seconds=3.4, rate_hz=250.0, load=LOAD, loaded_at=LOADED_AT))
    return recorded(robot, motion, STANDARD, 0)


@pytest.fixture(scope="session")
def walk_file(walk: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_table(walk, tmp_path_factory.mktemp("live") / "walk.csv")


@pytest.fixture
def endpoint() -> str:
    """A Zenoh endpoint that is free."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def publish(walk_file: Path, endpoint: str) -> Iterator[Publish]:
    """Starts a robot in another process; ends it at the end of the test."""
    running: list[subprocess.Popen[str]] = []

    def _publish(kind: str, *options: object) -> subprocess.Popen[str]:
        command = [sys.executable, str(Path(__file__).with_name("publisher.py")), str(walk_file), endpoint, kind]
        pipe = subprocess.PIPE
        process = subprocess.Popen([*command, *map(str, options)], stdin=pipe, stdout=pipe, text=True)
        running.append(process)
        return process

    yield _publish
    for process in running:
        process.kill()
        process.communicate()


@pytest.fixture
def listener(endpoint: str) -> Iterator[Listener]:
    found = Listener(endpoint)
    yield found
    found.session.close()
