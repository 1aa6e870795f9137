"""Bags through the commands: the same figures as from a table, topics chosen, what is wrong named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bags import imu, of_recording, write_folder, write_mcap
from stadera.logs import Imu, Recording, write_table
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from standing import GRAVITY, StandingRobot


@pytest.fixture(scope="module")
def standing() -> Recording:
    robot = load_robot("hyq")
    joints = standing_configuration(robot)
    effort = StandingRobot(robot).efforts(joints, np.eye(3))
    rng, n = np.random.default_rng(0), 300

    def noisy(values: np.ndarray, size: float) -> np.ndarray:
        return values + size * rng.normal(size=(n, len(values)))

    unit = Imu(noisy(np.zeros(3), 1e-3), noisy(np.array([0, 0, GRAVITY]), 0.02), None, robot.trunk)
    q, qd, tau = noisy(joints, 1e-5), noisy(0 * joints, 1e-3), noisy(effort, 0.05)
    return Recording(np.arange(n) / 100.0, robot.tree.joints, q, qd, None, tau, unit)


def test_a_bag_weighs_as_its_table_does(run, standing: Recording, tmp_path: Path) -> None:
    masses = []
    for log in (
        write_table(standing, tmp_path / "log.parquet"),
        write_mcap(of_recording(standing), tmp_path / "log.mcap"),
        write_folder(of_recording(standing), tmp_path / "bag"),
    ):
        out = tmp_path / "out.json"
        assert run("weigh", log, "--robot", "hyq", "--json", out).code == 0
        masses.append(json.loads(out.read_text())["trunk"]["mass"]["value"])
    assert masses == pytest.approx([masses[0]] * 3, rel=1e-9)


def test_topics_are_chosen(run, standing: Recording, tmp_path: Path) -> None:
    sent = [*of_recording(standing), *(imu(float(t), topic="/imu/raw", frame="trunk") for t in standing.time)]
    log = write_mcap(sorted(sent, key=lambda s: s.received), tmp_path / "log.mcap")
    finished = run("inspect", log)
    assert finished.code == 1
    assert "/imu/data (sensor_msgs/msg/Imu, 100 Hz), /imu/raw (" in finished.err
    assert finished.err.endswith("; choose one with --imu-topic\n")
    finished = run("inspect", log, "--robot", "hyq", "--imu-topic", "/imu/data")
    assert finished.code == 0
    assert "nothing wrong was found" in finished.out


def test_reversed_torques_are_named(run, standing: Recording, tmp_path: Path) -> None:
    assert standing.effort is not None
    log = write_table(replace(standing, effort=-standing.effort), tmp_path / "log.parquet")
    finished = run("inspect", log, "--robot", "hyq")
    assert finished.code == 0
    assert "the signs of all torques are reversed" in " ".join(finished.out.split())
    finished = run("weigh", log, "--robot", "hyq")
    assert finished.code == 1
    assert "the signs of all torques are reversed" in finished.err
