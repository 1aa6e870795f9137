"""Sound logs that a check once accused: a robot at rest, a trunk that pitches, a joint that idles, a stop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.checks.leg_windows import _Feet, _gyro, _swinging, _upwards, leg_faults
from stadera.checks.limits import WindowLimits
from stadera.checks.windows import Windows, joint_faults
from stadera.lab.scenarios.run import simulate
from stadera.lab.scenarios.settings import SimulateSettings
from stadera.logs import Recording
from stadera.robot import load_robot
from stadera.robot.imu import ImuMount
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.samples import Samples
from stadera.types import Array

LIMITS = WindowLimits()


def test_the_vertical_follows_a_trunk_that_pitches() -> None:
    time = np.arange(0.0, 6.0, 0.01)
    pitch, rate = 0.2 * np.sin(2.0 * np.pi * 2.5 * time), 0.2 * 2.0 * np.pi * 2.5 * np.cos(2.0 * np.pi * 2.5 * time)
    up = np.column_stack([-np.sin(pitch), 0.0 * pitch, np.cos(pitch)])  # of a trunk that pitches about its y axis
    gyro = np.column_stack([0.0 * rate, rate, 0.0 * rate])

    def off(found: Array) -> float:
        return float(np.degrees(np.abs(np.arctan2(found[100:-100, 0], found[100:-100, 2]) + pitch[100:-100])).max())

    assert off(_upwards(9.81 * up, gyro, time, 50)) < 1.5
    assert off(_upwards(9.81 * up, 0.0 * gyro, time, 50)) > 8.0


def test_a_trunk_that_bobs_does_not_lift_its_feet() -> None:
    robot = load_robot("hyq")
    log = simulate(robot, "trot", SimulateSettings("standard", duration=4.0, seed=1)).recording
    feet = _Feet(log, robot, ImuMount.of(robot, None), LIMITS)
    raised, _ = _swinging(feet, LIMITS)
    assert 0.1 < raised.mean() < 0.5
    feet.height = feet.height + 0.06 * (1.0 + np.sin(2.0 * np.pi * 3.0 * feet.time))[:, None]
    bobbing, _ = _swinging(feet, LIMITS)
    assert (raised == bobbing).mean() > 0.93


@pytest.mark.parametrize("seed", range(4))
def test_the_gyro_of_a_robot_at_rest_is_not_turned(seed: int) -> None:
    robot = load_robot("a1")
    log = simulate(robot, "stand", SimulateSettings("real", duration=4.0, seed=seed)).recording
    assert list(leg_faults(log, robot, ImuMount.of(robot, None), LIMITS)) == []


@pytest.mark.parametrize(("noise", "turned"), [(0.0, True), (2.3, False)])
def test_a_gyro_is_turned_only_if_that_leaves_little(noise: float, turned: bool) -> None:
    """One that reads -0.3 times the rotation leaves (1 + 0.3)² of the feet's motion, reversed (1 - 0.3)²; with noise
    on the feet neither explains them.
    """
    rng, n = np.random.default_rng(1), 4000
    robot = load_robot("hyq")
    feet = _Feet.__new__(_Feet)
    feet.time = 0.01 * np.arange(n)
    feet.windows = Windows.of(feet.time, 1.0)
    feet.place = np.broadcast_to([(x, y, -0.5) for x in (0.3, -0.3) for y in (0.2, -0.2)], (n, 4, 3))
    turns = 0.1 * rng.standard_normal((n, 3))
    feet.motion = -np.cross(turns[:, None], feet.place)
    feet.motion = feet.motion + noise * 0.03 * rng.standard_normal(feet.motion.shape)
    feet.gyro = -0.3 * turns
    found = list(_gyro(feet, np.ones((n, len(robot.legs)), dtype=bool), LIMITS))
    assert [f.evidence.startswith("reads the opposite") for f in found] == [True] * turned


@pytest.mark.parametrize(("seconds", "accused"), [(1.0, False), (3.0, True)])
def test_a_torque_is_only_noise_when_it_lasts(seconds: float, accused: bool) -> None:
    robot = load_robot("hyq")
    log = simulate(robot, "shake", SimulateSettings("standard", duration=4.0, seed=3)).recording
    assert log.effort is not None
    effort, part = log.effort.copy(), log.time < seconds - 1e-9
    effort[part, 1] = np.random.default_rng(0).normal(0.0, 0.5, np.count_nonzero(part))
    found = [f for f in joint_faults(replace(log, effort=effort), robot, LIMITS) if f.evidence == "is only noise"]
    assert bool(found) == accused


def test_blocks_at_a_mechanical_stop_are_left_out() -> None:
    robot = load_robot("go2")
    log = simulate(robot, "shake", SimulateSettings("standard", duration=3.0, seed=2)).recording
    joint = robot.tree.joints[2]

    def weighed(lower: float) -> tuple[TrunkEstimator, Recording]:
        limits = {**robot.limits, joint: replace(robot.limits[joint], lower=lower)}
        estimator = TrunkEstimator(replace(robot, limits=limits))
        effort = np.array(log.effort)
        touches = log.position[:, log.index(joint)] < lower + 0.005
        effort[touches, log.index(joint)] += 8.0  # what the stop carries
        spoilt = replace(log, effort=effort)
        estimator.add(Samples.of_recording(spoilt, robot))
        return estimator, spoilt

    position = log.position[:, log.index(joint)]
    free, _ = weighed(float(position.min()) - 1.0)
    held, spoilt = weighed(float(np.quantile(position, 0.1)))
    blind = TrunkEstimator(robot)
    blind.add(Samples.of_recording(spoilt, robot))
    right = free.trunk.inertial.mass
    assert abs(held.trunk.inertial.mass - right) < 0.02 * robot.mass
    assert abs(held.trunk.inertial.mass - right) < 0.3 * abs(blind.trunk.inertial.mass - right)
