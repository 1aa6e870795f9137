"""A fleet's memories: one of each robot, from log to log, and on the page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from stadera import StaderaError, weigh
from stadera.fleet import read_fleet, run_fleet
from stadera.fleet import run as runs
from stadera.fleet.jobs import jobs_of
from stadera.fleet.pool import Pool
from stadera.fleet.run import memory_paths
from stadera.robot import load_robot
from stadera.trunk.memory import Memory

HERE = Pool(workers=0)


def test_each_robot_is_remembered_from_log_to_log(logs: Path, tmp_path: Path) -> None:
    jobs, robot = jobs_of([f"{logs}/*/*"], "hyq", names=r"(unit\d)/"), load_robot("hyq")
    out, file = tmp_path / "runs.parquet", tmp_path / "known.json"
    first = run_fleet(jobs, out, HERE, memory=file)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "known-unit1.json", "known-unit2.json", "runs.parquet"]  # fmt: skip
    kept = Memory.read(tmp_path / "known-unit1.json", robot)
    assert kept.logs == 2
    assert [row["memory"] for row in first.rows] == ["of 0 earlier logs", "of 1 earlier log"] * 2
    alone = weigh("hyq", logs / "unit1/a.parquet", memory=Memory.none(robot))
    assert alone.memory is not None
    then = weigh("hyq", logs / "unit1/b.csv", memory=alone.memory)
    assert first.rows[1]["trunk_mass_std"] == then.mass_std
    again = run_fleet(jobs, out, HERE, memory=file)
    assert Memory.read(tmp_path / "known-unit1.json", robot).to_dict() == kept.to_dict()
    assert [row["seconds"] for row in again.rows] == [row["seconds"] for row in first.rows]
    assert [row["memory"] for row in run_fleet(jobs, out, HERE).rows] == [None] * 4


def test_logs_of_a_robot_that_are_done_are_kept_when_a_later_one_is_broken_off(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs, out = jobs_of([f"{logs}/unit1/*"], "hyq"), tmp_path / "runs.parquet"
    whole = runs.process

    def until_second(task: runs.Task) -> runs.Done:
        if task.job.log == jobs[1].log:
            raise KeyboardInterrupt
        return whole(task)

    monkeypatch.setattr(runs, "process", until_second)
    with pytest.raises(KeyboardInterrupt):
        run_fleet(jobs, out, HERE, memory=tmp_path / "known.json")
    assert [row["memory"] for row in read_fleet(out).rows] == ["of 0 earlier logs"]
    monkeypatch.setattr(runs, "process", whole)
    found = run_fleet(jobs, out, HERE, memory=tmp_path / "known.json")
    assert [row["memory"] for row in found.rows] == ["of 0 earlier logs", "of 1 earlier log"]


def test_another_robot_s_memory_fails_its_logs_alone(logs: Path, tmp_path: Path) -> None:
    jobs = jobs_of([f"{logs}/*/a.parquet"], "hyq", names=r"(unit\d)/")
    Memory.none(load_robot("go2")).save_json(tmp_path / "known-unit2.json")
    first, second = run_fleet(jobs, tmp_path / "runs.parquet", HERE, memory=tmp_path / "known.json").rows
    assert first["status"] == "ok"
    assert second["status"] == "failed"
    assert "another model than hyq" in second["error"]


def test_names_of_files(tmp_path: Path) -> None:
    one, two = jobs_of(["a.parquet"], "hyq"), jobs_of(["b.parquet"], "go2")
    assert memory_paths(tmp_path / "k.json", one) == {"hyq": tmp_path / "k.json"}
    several = {name: tmp_path / f"k-{name}.json" for name in ("hyq", "go2")}
    assert memory_paths(tmp_path / "k.json", [*one, *two]) == several
    with pytest.raises(StaderaError, match="which robot's log"):
        memory_paths("k.json", jobs_of(["s3://logs/a.parquet"]))


def test_the_page_shows_what_is_known_and_what_contradicts_it(
    logs: Path, tmp_path: Path, run: Callable[..., Any]
) -> None:
    files = ["--out", tmp_path / "r.parquet", "--report", tmp_path / "r.html", "--memory", tmp_path / "hyq-17.json"]
    for _ in range(2):
        done = run("fleet", logs / "unit1/a.parquet", "--robot", "hyq", *files, "--workers", "0", "--force")
        assert done.code == 0, done.err
        (tmp_path / "r.parquet").unlink()
    page = (tmp_path / "r.html").read_text()
    assert "Remembered of 1 log" in page
    assert "these samples are in the memory already" in page
    assert "LF_HAA" in page or "lf_haa_joint" in page
    wrong = run(
        "fleet", logs / "unit1/a.parquet", "--robot", "hyq", *files[:2], "--worker-memory", "0", "--workers", "0"
    )
    assert wrong.code == 1
    assert "needs memory" in wrong.err
