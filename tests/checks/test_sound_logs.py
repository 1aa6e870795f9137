"""Sound logs that a check once accused: a robot at rest, a joint that idles, a stop."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stadera.checks import CheckLimits, diagnose
from stadera.checks.instants import Instants
from stadera.checks.signals import velocity_findings
from stadera.checks.windows import window_faults
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Recording
from stadera.robot import load_robot
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.samples import Samples


@cache
def swaying(name: str, seed: int) -> Recording:
    """Of standard sensors, for 4 s."""
    return simulate(load_robot(name), "shake", SimulateSettings("standard", duration=4.0, seed=seed, hold=2)).recording


@pytest.mark.parametrize("seed", range(2))
def test_the_gyro_of_a_robot_at_rest_is_not_turned(seed: int) -> None:
    robot = load_robot("a1")
    log = simulate(robot, "stand", SimulateSettings("real", duration=4.0, seed=seed, hold=2)).recording
    assert diagnose(log, robot) == ()


@pytest.mark.parametrize("rate", [25.0, 35.0])
def test_velocities_of_joints_that_shake_are_those_of_their_positions(rate: float) -> None:
    """Over an instant of 40 ms the mean velocity of such a joint is not the slope of its position."""
    log = swaying("hyq", 3)
    assert log.velocity is not None
    angle, speed = 2.0 * np.pi * rate * log.time[:, None], 6.0  # [rad/s]
    position = log.position + speed / (2.0 * np.pi * rate) * np.sin(angle)
    blocks = Instants.of(
        replace(log, position=position, velocity=log.velocity + speed * np.cos(angle)), log.joints, None, CheckLimits()
    )
    assert tuple(velocity_findings(blocks, CheckLimits())) == ()


@pytest.mark.parametrize(("seconds", "accused"), [(1.0, False), (3.0, True)])
def test_a_torque_is_only_noise_when_it_lasts(seconds: float, accused: bool) -> None:
    robot = load_robot("hyq")
    log = swaying("hyq", 3)
    assert log.effort is not None
    effort, part = log.effort.copy(), log.time < seconds - 1e-9
    effort[part, 1] = np.random.default_rng(0).normal(0.0, 0.5, np.count_nonzero(part))
    found = [f for f in window_faults(replace(log, effort=effort), robot) if f.message.endswith("is only noise")]
    assert bool(found) == accused


def test_a_torque_that_swings_fast_is_not_noise() -> None:
    """12.5 Hz: successive means over 20 ms are uncorrelated, those over 5 ms are not."""
    robot, log = load_robot("hyq"), swaying("hyq", 3)
    assert log.effort is not None
    effort = log.effort.copy()
    effort[:, 1] = np.sin(2.0 * np.pi * 12.5 * log.time)
    assert not [f for f in window_faults(replace(log, effort=effort), robot) if f.message.endswith("is only noise")]


@pytest.mark.parametrize(("joint", "accused"), [("left_ankle_roll_joint", False), ("left_knee_joint", True)])
def test_a_joint_that_holds_nothing_may_be_only_noise(joint: str, accused: bool) -> None:
    """On a flat foot the ankle's roll may idle for a whole log; a knee holds the robot."""
    robot = load_robot("g1")
    log = swaying("g1", 1)
    assert log.effort is not None
    effort = log.effort.copy()
    effort[:, log.index(joint)] = np.random.default_rng(0).normal(0.0, 0.3, len(log))
    found = [f for f in window_faults(replace(log, effort=effort), robot) if f.message.endswith("is only noise")]
    assert [f.message for f in found] == (["the torque of 'left_knee_joint' is only noise"] if accused else [])


def test_legs_that_move_alike_are_not_swapped_because_their_errors_would_balance_better() -> None:
    """Feet slide as much either way, and friction and gains of the drives explain the difference in balance."""
    robot = load_robot("hyqreal2")
    log = simulate(robot, "squat", SimulateSettings("real", duration=2.1, seed=6049)).recording
    assert diagnose(log, robot) == ()


@pytest.mark.parametrize(("degrees", "contradicts"), [(12.0, False), (20.0, True)])
def test_forces_that_lean_as_friction_makes_them_in_a_walk_are_the_fits_to_explain(
    degrees: float, contradicts: bool
) -> None:
    log, turn = swaying("hyq", 3), Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    assert log.imu is not None
    leaning = replace(
        log.imu,
        linear_acceleration=log.imu.linear_acceleration @ turn,
        angular_velocity=log.imu.angular_velocity @ turn,
        orientation=None,
    )
    causes = [finding.cause for finding in diagnose(replace(log, imu=leaning), load_robot("hyq"))]
    assert ("contradiction" in causes) == contradicts, causes


@pytest.mark.parametrize(("name", "seed"), [("go2", 3), ("a1", 4)])
def test_a_slow_sway_that_any_order_of_legs_explains_as_well_has_none_swapped(name: str, seed: int) -> None:
    """Its friction is larger than what the order of the legs changes."""
    robot, settings = load_robot(name), SimulateSettings("real", duration=4.0, rate=250.0, seed=seed, hold=2)
    assert diagnose(simulate(robot, "shake", settings).recording, robot) == ()


def test_torques_by_which_a_squatting_robot_weighs_nothing_are_no_order_of_legs() -> None:
    """Front and hind knees of an ANYmal bend towards each other: swapped, two legs pull as the others push."""
    robot, settings = load_robot("anymal_c"), SimulateSettings("real", duration=4.5, rate=250.0, seed=61, hold=2)
    log = simulate(robot, "squat", settings).recording
    assert diagnose(log, robot) == ()


def test_blocks_at_a_mechanical_stop_are_left_out() -> None:
    robot = load_robot("go2")
    log = simulate(robot, "shake", SimulateSettings("standard", duration=3.0, seed=2, hold=2)).recording
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
    held, spoilt = weighed(float(np.quantile(position, 0.35)))
    blind = TrunkEstimator(robot)
    blind.add(Samples.of_recording(spoilt, robot))
    right = free.trunk.inertial.mass
    assert abs(held.trunk.inertial.mass - right) < 0.02 * robot.mass
    assert abs(held.trunk.inertial.mass - right) < 0.5 * abs(blind.trunk.inertial.mass - right)


@pytest.mark.parametrize(("noise", "accused"), [(0.3, False), (1.0, True)])
def test_a_joint_that_a_load_leaves_nothing_to_carry_is_idle(noise: float, accused: bool) -> None:
    """It is as noisy as before; a sensor that has died seldom is."""
    robot, log = load_robot("hyq"), swaying("hyq", 3)
    assert log.effort is not None
    effort, rng, later = log.effort.copy(), np.random.default_rng(0), log.time >= 2.0
    carried = 10.0 + np.sin(5.0 * log.time)
    effort[:, 1] = np.where(later, 0.0, carried) + np.where(later, noise, 0.3) * rng.standard_normal(len(log))
    found = [f for f in window_faults(replace(log, effort=effort), robot) if f.message.endswith("is only noise")]
    assert bool(found) == accused
