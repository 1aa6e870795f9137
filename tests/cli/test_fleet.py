"""`stadera fleet`: what it writes and prints, and what bad input gets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from stadera.fleet import read_fleet
from stadera.fleet import run as runs
from stadera.fleet.jobs import expanded
from stadera.identify.schema import with_identified_legs
from stadera.lab.plant.sensors import STANDARD
from stadera.logs import write_table
from stadera.report import page
from stadera.robot import load_robot
from walking import Walk, recorded, walked


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    robot = load_robot("hyq")
    motion = walked(robot, Walk(seconds=1.5, rate_hz=100.0))
    return write_table(recorded(robot, motion, STANDARD, 0), tmp_path_factory.mktemp("walk") / "walk.parquet")


def test_a_table_of_all_logs_with_those_that_failed(run: Callable[..., Any], walk: Path, tmp_path: Path) -> None:
    (tmp_path / "empty.parquet").touch()
    logs = [walk, tmp_path / "empty.parquet"]
    files = ["--out", tmp_path / "r.parquet", "--report", tmp_path / "r.html", "--pages", tmp_path / "logs"]
    done = run("fleet", *logs, "--robot", "hyq", "--tare", "0:0.8", *files, "--workers", "0")
    assert done.code == 0, done.err
    assert "failed: " in done.out
    assert "empty.parquet: the file is empty" in done.out
    good, bad = read_fleet(tmp_path / "r.parquet").rows
    assert good["payload_mass_std"] > 0
    assert bad["status"] == "failed"
    (own,) = (tmp_path / "logs").iterdir()
    assert f'href="logs/{own.name}"' in (tmp_path / "r.html").read_text()
    assert "Payload" in own.read_text()


def test_merged_legs_are_written_again_in_place_of_the_ones_before(
    run: Callable[..., Any], log: Path, tmp_path: Path
) -> None:
    arguments = ("fleet", log, "--robot", "hyq", "--identify", "--merge", tmp_path / "legs.json", "--workers", "0")
    for _ in range(2):
        done = run(*arguments, "--out", tmp_path / "r.parquet")
        assert done.code == 0, done.err
        assert "hyq: legs by 1 log, good" in done.out
    assert "in place of the one before" in done.out
    assert with_identified_legs(load_robot("hyq"), tmp_path / "legs.json").dynamics != load_robot("hyq").dynamics


def test_where_all_fail_the_call_is_wrong(run: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "empty.parquet").touch()
    done = run("fleet", f"{tmp_path}/*.parquet", "--robot", "hyq", "--out", tmp_path / "out.parquet", "--workers", "0")
    assert done.code == 1
    assert done.err.startswith(f"stadera: error: the only log failed: {tmp_path}/empty.parquet: the file is")
    assert len(read_fleet(tmp_path / "out.parquet").rows) == 1


def test_a_report_is_printed_as_pdf(run: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "find_browser", str)
    monkeypatch.setattr(page, "write_pdf", lambda text, path: path.write_text(f"printed: {text}"))
    files = ("--out", tmp_path / "r.parquet", "--report", tmp_path / "r.pdf")
    (tmp_path / "empty.parquet").touch()
    run("fleet", tmp_path / "empty.parquet", *files, "--workers", "0")
    assert (tmp_path / "r.pdf").read_text().startswith("printed: ")


def test_ctrl_c_keeps_what_is_done(
    run: Callable[..., Any], walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(runs, "process", pressed)
    done = run("fleet", walk, "--robot", "hyq", "--out", tmp_path / "r.parquet", "--workers", "0")
    assert done.code == 1
    assert "broken off before any log was done" in done.err
    asked = ("fleet", walk, "--robot", "hyq", "--out", tmp_path / "r.parquet", "--workers", "0")
    monkeypatch.undo()
    run(*asked, walk.parent / "none.csv")
    monkeypatch.setattr(runs, "process", pressed)
    assert "broken off; what is done is in" in run(*asked, "--fix").err


def test_a_glob_matches_no_folders_but_bags(run: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "unit7" / "bag").mkdir(parents=True)
    (tmp_path / "unit7" / "bag" / "0.mcap").touch()
    assert expanded(f"{tmp_path}/**/*") == [f"{tmp_path}/unit7/bag", f"{tmp_path}/unit7/bag/0.mcap"]
    done = run(
        "fleet", f"{tmp_path}/**/*", "--robot", "hyq", "--names", r"robot(\d+)/", "--out", tmp_path / "r.parquet"
    )
    assert r"'robot(\d+)/' finds no robot's name" in done.err


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        ((), 2, "name logs or a --manifest"),
        (("a.csv", "--manifest", "m.csv"), 2, "name logs or a --manifest"),
        (("--manifest", "m.csv", "--tare", "0:1"), 2, "is of the manifest's lines"),
        (("a.csv", "--scheduler", "tcp://x:1", "--workers", "2"), 2, "has its own workers"),
        (("a.csv", "--workers", "-1"), 2, "workers"),
        (("a.csv", "--merge", "legs.json"), 2, "needs --identify"),
        (("a.csv", "--tare", "3:1", "--robot", "hyq"), 1, "'3:1' is not a range of time"),
        (("a.csv", "--method", "wlking", "--robot", "hyq"), 1, "unknown method 'wlking'"),
        (("a.csv", "--robot", "hqy"), 1, "unknown robot 'hqy'"),
        (("none*.csv", "--robot", "hyq"), 1, "matches no log"),
        (("a.csv", "--robot", "hyq", "--names", "unit"), 1, "has no group in parentheses"),
    ],
)
def test_bad_input(run: Callable[..., Any], tmp_path: Path, arguments: tuple[str, ...], code: int, said: str) -> None:
    done = run("fleet", *arguments, "--out", tmp_path / "r.parquet")
    assert done.code == code
    assert said in " ".join(done.err.replace("│", " ").split())
    assert not list(tmp_path.iterdir())
