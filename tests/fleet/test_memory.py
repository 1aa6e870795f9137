"""A worker's memory does not grow with the number of logs."""

from __future__ import annotations

import gc
import subprocess
import sys
from pathlib import Path

import pytest

from stadera.fleet.pool import attempted
from stadera.process import collect_rarely

GROWN = """
import sys
from stadera.fleet.jobs import LogJob
from stadera.fleet.pool import attempted
from stadera.fleet.run import Task, process

def resident():  # MB
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

def weighed():
    done = attempted(process, Task(LogJob(sys.argv[1], "hyq")))
    assert done.row["status"] == "ok", done.row["error"]
    return resident()

first = [weighed() for _ in range(2)][-1]
print(max(weighed() for _ in range(5)) - first)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc")
def test_a_process_is_no_larger_after_seven_logs_than_after_two(logs: Path) -> None:
    log = str(logs / "unit1/a.parquet")
    grown = float(subprocess.run([sys.executable, "-c", GROWN, log], check=True, capture_output=True, text=True).stdout)
    assert grown < 3.0  # MB; 15 MB a log if what the estimator refers to in a circle is kept


class Circle:
    """Refers to itself."""

    left = 0

    def __init__(self) -> None:
        self.own, Circle.left = self, Circle.left + 1

    def __del__(self) -> None:
        Circle.left -= 1


def in_a_circle(_: int) -> int:
    Circle()
    return Circle.left


def test_what_a_task_leaves_in_a_circle_is_freed_when_it_ends() -> None:
    gc.disable()
    try:
        assert attempted(in_a_circle, 0) == 1
    finally:
        gc.enable()
    assert Circle.left == 0


def test_a_worker_looks_through_what_is_loaded_once_and_still_frees_circles() -> None:
    usual = gc.get_threshold()
    gc.disable()
    try:
        assert attempted(in_a_circle, 0) == 1
        assert gc.get_freeze_count() == 0  # somebody else's process is left as it is
        collect_rarely()
        for _ in range(2):
            assert attempted(in_a_circle, 0) == 1
            assert Circle.left == 0
            assert gc.get_freeze_count() > 0
        assert len(gc.get_objects()) < gc.get_freeze_count()
    finally:
        gc.unfreeze()
        gc.set_threshold(*usual)
        gc.enable()
