"""`stadera live` of a replayed log, what it shows, and what bad input gets."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from on_zenoh import arrivals
from rich.console import Console

import bags
from stadera.cli.live import _shown
from stadera.live import Answer, LiveSession, LiveState
from stadera.logs import Recording, write_table
from stadera.report.live import live_lines, live_screen, live_summary
from stadera.robot import Robot
from stadera.trust import Trust


@pytest.fixture(scope="module")
def states(robot: Robot, walk: Recording) -> list[LiveState]:
    """Before anything, after two seconds and a tare, and at the end with the load on."""
    messages = arrivals(list(bags.of_recording(walk)))
    session = LiveSession(robot)
    found = [session.state(0.0)]
    session.feed(m for m in messages if m.arrived < 2.0)
    session.tare()
    found.append(session.state(2.0))
    session.feed(m for m in messages if m.arrived >= 2.0)
    return [*found, session.state(3.4)]


def drawn(state: LiveState) -> str:
    console = Console(file=io.StringIO(), width=100)
    console.print(live_screen(state))
    file: Any = console.file
    return str(file.getvalue())


def test_the_screen(states: list[LiveState]) -> None:
    nothing, tared, loaded = (drawn(state) for state in states)
    assert "waiting for joint states" in nothing
    assert nothing.count("not observed") == 4
    assert "misfit" not in nothing
    assert "no tare yet" in nothing
    assert "no tare yet" not in tared
    assert loaded.count("±") > 5
    assert " on " in loaded
    assert "/joint_states" in loaded


def test_the_key_t_tares(states: list[LiveState], monkeypatch: pytest.MonkeyPatch) -> None:
    typist, keyboard = os.openpty()
    shown = _Terminal()
    asked: list[str] = []

    def tare() -> Answer:
        asked.append("tare")
        return Answer(True, "tared at 2.00 s")

    with os.fdopen(keyboard, encoding="utf-8") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        monkeypatch.setattr("sys.stdout", shown)
        with _shown(tare) as sink:
            sink(states[0])
            os.write(typist, b"xt")
            sink(states[1])
            sink(states[1])
    os.close(typist)
    assert asked == ["tare"]
    assert "t: tare" in shown.getvalue()
    assert "t: tare, Ctrl-C: end; tared at 2.00 s" in shown.getvalue()


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_nothing_bad_is_shown_unmarked(states: list[LiveState]) -> None:
    bad = replace(states[-1], trust=Trust("bad", 20.0, {}, ("torques of LF have the wrong sign",)))
    assert "wrong sign" in drawn(bad)
    assert "not to be trusted" in drawn(bad)
    assert bad.to_dict()["trunk"]["mass"]["trusted"] is False
    assert all("not to be trusted" in line for line in live_lines(bad, None) if " kg" in line)


def test_a_line_for_everything_that_happens(states: list[LiveState]) -> None:
    nothing, tared, loaded = states
    first, then, last = (list(live_lines(*pair)) for pair in ((nothing, None), (tared, nothing), (loaded, tared)))
    assert any("waiting for joint states" in line for line in first)
    assert f"{tared.since(tared.tared_at):.2f} s: tared" in then
    assert {"samples arrive", "tared"} <= {line.partition(": ")[2] for line in then}
    assert [line for line in last if "load on at" in line]
    assert not list(live_lines(loaded, loaded))


def test_the_last_line_says_what_was_lost(states: list[LiveState]) -> None:
    assert "lost" not in live_summary(states[-1])
    lossy = replace(states[-1], lost={"network": 7, "damaged": 0, "queue": 2})
    assert live_summary(lossy).endswith("; lost messages: 7 network, 2 queue")


def test_a_replay(run: Callable[..., Any], walk_file: Path, endpoint: str, tmp_path: Path) -> None:
    record = tmp_path / "out.mcap"
    done = run(
        "live", f"replay:{walk_file}", "--robot", "hyq", "--rate", "inf", "--listen", endpoint, "--record", record
    )
    assert done.code == 0, done.err
    assert "load on at" in done.out
    assert "\ntrunk " in done.out
    assert record.stat().st_size > 1000


def test_a_replay_tares_itself(run: Callable[..., Any], walk_file: Path, endpoint: str) -> None:
    asked = ("--rate", "inf", "--listen", endpoint, "--tare", "1.2")
    done = run("live", f"replay:{walk_file}", "--robot", "hyq", *asked)
    assert done.code == 0, done.err
    assert "\n1.20 s: tared" in done.out
    assert "; payload " in " ".join(done.out.split())


@pytest.mark.parametrize(
    ("options", "said"),
    [(("--tare", "50"), "never tared: --tare 50 was not possible"), ((), "unknown IMU frame 'camera'")],
)
def test_a_replay_that_does_not_do_what_was_asked_fails(
    run: Callable[..., Any], walk: Recording, tmp_path: Path, endpoint: str, options: tuple[str, ...], said: str
) -> None:
    assert walk.imu is not None
    log = walk if options else replace(walk, imu=replace(walk.imu, frame="camera"))
    path = write_table(log, tmp_path / "walk.parquet")
    done = run("live", f"replay:{path}", "--robot", "hyq", "--rate", "inf", "--listen", endpoint, *options)
    assert done.code == 1
    assert said in done.err


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["nowhere"], 2, "neither zenoh nor replay:LOG"),
        (["replay:missing.csv"], 1, "missing.csv: no such file"),
        (["--listen", "nonsense"], 1, "Zenoh cannot be started with nonsense"),
        (["--config", "missing.json5"], 1, "missing.json5"),
        (["--imu-frame", "camera"], 1, "unknown IMU frame 'camera'"),
        (["--record", "no/such/folder.mcap"], 1, "no such folder"),
    ],
)
def test_bad_input(run: Callable[..., Any], arguments: list[str], code: int, said: str) -> None:
    done = run("live", "--robot", "hyq", *arguments)
    assert done.code == code
    assert said in " ".join(done.err.split())
