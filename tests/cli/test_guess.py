"""Which robot a log is of."""

from __future__ import annotations

import pytest

from stadera.errors import RecordingError
from stadera.logs import Recording, write_table
from stadera.robot import load_robot
from stadera.robot.load import guessed


def test_joints_of_one_robot_alone_say_whose_they_are() -> None:
    assert guessed(load_robot("hyq").tree.joints, "log") == "hyq"


def test_several_robots_of_these_joints_are_listed() -> None:
    pytest.importorskip("cmeel", reason="example-robot-data is not installed")
    with pytest.raises(RecordingError, match=r"log: the joints are those of go2, go1, .*b1.*: add --robot go2"):
        guessed(load_robot("go2").tree.joints, "log")


def test_joints_of_no_robot() -> None:
    with pytest.raises(RecordingError, match=r"\(a, b, \.\.\.\): add --robot with the path"):
        guessed(["a", "b"], "log")


def test_identify_takes_the_robot_that_the_log_is_of(run, swing: Recording, tmp_path) -> None:
    path = write_table(swing, tmp_path / "log.csv")
    finished = run("identify", path, "--legs", "RH")
    assert finished.code == 0
    assert f"robot hyq, by the joints of {path}" in " ".join(finished.out.split())
