"""Robots of any legs: a sound log is not accused, and a fault is named as on a quadruped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stadera.checks import diagnose
from stadera.inertia import InertialParameters
from stadera.logs import Imu, Recording
from trunk.test_any_robot import of_file, swaying, with_legs


@pytest.mark.parametrize("name", ["g1", 6])
def test_legs_of_any_number_and_joints_are_checked(
    name: str | int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trunk.test_any_robot.SECONDS", 4.0)
    monkeypatch.setattr("trunk.test_any_robot.RATE", 200.0)
    robot = with_legs(name, tmp_path) if isinstance(name, int) else of_file(name)
    samples = swaying(robot, InertialParameters.zero(), 0.0)
    imu = Imu(samples.angular_velocity, samples.specific_force, frame=robot.trunk)
    effort = samples.effort + 1e-3 * np.random.default_rng(0).standard_normal(samples.effort.shape)
    log = Recording(samples.time, robot.tree.joints, samples.position, samples.velocity, effort=effort, imu=imu)
    assert diagnose(log, robot) == ()
    order = list(range(len(log.joints)))
    for one, other in zip(robot.legs[0].joints, robot.legs[1].joints, strict=True):
        order[log.index(one)], order[log.index(other)] = log.index(other), log.index(one)
    position, velocity = samples.position[:, order], samples.velocity[:, order]
    (found,) = diagnose(replace(log, position=position, velocity=velocity, effort=effort[:, order]), robot)
    assert found.cause == "joint_order"
    assert {"g1": "left and right legs", 6: "legs leg0 and leg1"}[name] in found.message
    (found,) = diagnose(replace(log, effort=-effort), robot)
    assert "the signs of all torques are reversed" in found.message or found.cause == "joint_signs"
    (found,) = diagnose(replace(log, imu=replace(imu, angular_velocity=-samples.angular_velocity)), robot)
    assert found.cause == "gyro_unit"
