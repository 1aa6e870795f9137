"""A robot at rest: what its accelerometer reads is gravity, and its error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layout import ERRORS, LAYOUT, PLACES
from stadera.constants import GRAVITY
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import load_robot
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.joint_errors import Errors
from stadera.trunk.noise import AtRest
from stadera.trunk.segment import RowSums
from stadera.trunk.settings import ModelErrors, SwingDetection
from stadera.trunk.swing import SwingJoints
from stadera.weigh import weigh

SIZES = ModelErrors()
MODEL = ErrorModel(load_robot("hyq"), SIZES)
OFFSET = np.array([0.0, 0.0, -0.3])


def rested(seconds: float) -> AtRest:
    """Of a robot whose trunk leans by up to 0.1 rad."""
    at_rest, lean = AtRest(), np.linspace(-0.1, 0.1, round(50 * seconds))
    up = np.stack([np.sin(lean), np.zeros_like(lean), np.cos(lean)], axis=1)
    at_rest.add(GRAVITY * up + OFFSET, np.full(len(lean), 0.02))
    return at_rest


@pytest.mark.parametrize("moved", [False, True], ids=["that only rests", "that also moves"])
def test_the_accelerometer_s_error_along_gravity_is_known_from_a_rest(moved: bool) -> None:
    """As by Bayes' rule of one number: across gravity nothing is known."""
    place, std, across = PLACES["accelerometer"], SIZES.accelerometer_vertical, SIZES.accelerometer
    rows = RowSums(*np.zeros((2, 1 + ERRORS, 1 + ERRORS)), 100.0, 5.0) if moved else None
    found = Errors(MODEL, SwingJoints(MODEL, SwingDetection()), None, rows, gravity=rested(5.0).known(LAYOUT, SIZES))
    noise = np.hypot(SIZES.gravity, np.sqrt(2.0) * SIZES.settles / 5.0)
    share = std**2 / (std**2 + noise**2)
    assert found.mean[place] == pytest.approx(share * OFFSET, abs=2e-3)
    assert found.std[place] == pytest.approx([across, across, np.sqrt(1.0 - share) * std], rel=0.02)
    others = np.delete(np.arange(ERRORS), np.arange(place.start, place.stop))
    assert not found.mean[others].any()


def test_a_moment_of_rest_tells_little_and_no_rest_nothing() -> None:
    known = rested(0.1).known(LAYOUT, SIZES)
    assert known is not None
    assert np.linalg.norm(known[1:] * SIZES.accelerometer_vertical) ** 2 < 0.1  # of what the prior tells
    assert AtRest().known(LAYOUT, SIZES) is None


def test_a_robot_at_rest_is_weighed_by_gravity() -> None:
    """Its accelerometer reads 3 % too little, as a real Go2's: by that it would be 3 % too heavy."""
    robot = load_robot("go2")
    log = simulate(robot, "stand", SimulateSettings("ideal", duration=4.0, rate=200.0, seed=1)).recording
    assert log.imu is not None
    less = replace(log, imu=replace(log.imu, linear_acceleration=0.97 * log.imu.linear_acceleration))
    heavier = weigh(robot, less).mass - weigh(robot, log).mass
    assert abs(heavier) < 0.2 * 0.03 * robot.mass
