"""Tasks over workers: the same outcomes wherever they run, and nothing lost with a worker."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

import stadera
from stadera.errors import MissingExtraError, StaderaError
from stadera.fleet.pool import Failure, Pool, journal, run_tasks


def square(x: float) -> float:
    if x < 0:
        raise StaderaError("negative")
    return x * x


def killed_once(trace: str) -> int:
    """Ends its worker the first time."""
    if not Path(trace).exists():
        Path(trace).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def noted(line: tuple[str, str]) -> None:
    """Writes a line into a file, at once and after a while."""
    path, text = line
    for part in ("begins", "ends"):
        with Path(path).open("a") as file:
            file.write(f"{text} {part}\n")
        time.sleep(0.05)


def always_killed(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


TASKS = {f"{x:g}": x for x in (3.0, 1.0, -1.0, 2.0)}
OUTCOMES = {"3": 9.0, "1": 1.0, "-1": Failure("negative"), "2": 4.0}


def test_in_this_process_one_after_the_other() -> None:
    assert list(run_tasks(square, TASKS, Pool(0))) == list(OUTCOMES.items())


def test_on_a_scheduler(cluster: Pool) -> None:
    assert dict(run_tasks(square, TASKS, cluster)) == OUTCOMES


def test_a_task_is_run_again_when_its_worker_dies(cluster: Pool, tmp_path: Path) -> None:
    ((_, pid),) = run_tasks(killed_once, {"x": str(tmp_path / "trace")}, cluster)
    assert isinstance(pid, int)
    assert pid != os.getpid()


def test_a_task_whose_workers_keep_dying_is_lost_and_the_others_are_not(cluster: Pool) -> None:
    ((_, outcome),) = run_tasks(always_killed, {"x": 0}, cluster)
    assert isinstance(outcome, Failure)
    assert "its worker ended" in outcome.reason
    assert dict(run_tasks(square, TASKS, cluster)) == OUTCOMES


def test_workers_of_another_version_are_refused(cluster: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stadera, "__version__", "9.9")
    with pytest.raises(StaderaError, match=r"worker tcp://.* has stadera 0.*, and this is 9.9"):
        list(run_tasks(square, TASKS, cluster))


def test_tasks_of_one_owner_are_run_in_turn_and_yielded_as_they_end(cluster: Pool, tmp_path: Path) -> None:
    tasks = {f"{owner}{k}": (str(tmp_path / owner), str(k)) for k in range(4) for owner in "ab"}
    seen = [name for name, _ in run_tasks(noted, tasks, cluster, {name: name[0] for name in tasks})]
    for owner in "ab":
        assert [name for name in seen if name[0] == owner] == [f"{owner}{k}" for k in range(4)]
        lines = (tmp_path / owner).read_text().splitlines()
        assert lines == [f"{k} {part}" for k in range(4) for part in ("begins", "ends")]


def test_one_run_at_a_time_writes_a_journal(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    path = tmp_path / "runs.jsonl"
    with journal(path), pytest.raises(StaderaError, match="another run is writing there"), journal(path):
        pass
    with journal(path):
        pass


def test_no_scheduler_there() -> None:
    with pytest.raises(StaderaError, match=r"tcp://127\.0\.0\.1:1: no Dask scheduler answers"):
        list(run_tasks(square, TASKS, Pool(scheduler="tcp://127.0.0.1:1", connect=0.3)))


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"workers": -1}, "not negative"),
        ({"workers": 2, "scheduler": "tcp://x:1"}, "has its own workers"),
        ({"memory": 0}, "needs memory"),
    ],
)
def test_pools_that_cannot_be(fields: dict[str, object], said: str) -> None:
    with pytest.raises(StaderaError, match=said):
        Pool(**fields)  # type: ignore[arg-type]


def test_no_more_workers_than_tasks() -> None:
    assert [Pool(4).for_tasks(n).workers for n in (0, 1, 3, 9)] == [0, 0, 3, 4]
    assert Pool(scheduler="tcp://x:1").for_tasks(1) == Pool(scheduler="tcp://x:1")


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"stadera\[fleet\]"):
        list(run_tasks(square, TASKS, Pool(2)))
