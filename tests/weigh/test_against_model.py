"""Differences from the model that a wrong torque of one leg explains, while the robot stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.errors import StaderaError, UntrustedError
from stadera.inertia import InertialParameters
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import Robot, load_robot
from stadera.robot.kinematics import foot_positions
from stadera.robot.stance import standing_configuration
from stadera.trunk.load import Payload
from stadera.weigh import weigh
from stadera.weigh.against_model import AgreementLimits, Footprint, doubts

LIMITS = AgreementLimits()


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("go2")


def footprint(robot: Robot, tilt: float = 0.0, sway: float = 0.0) -> Footprint:
    """Of a robot whose posture swings by `sway` [rad], whose trunk is pitched by `tilt` [rad]."""
    time = np.arange(100) / 50.0
    q = standing_configuration(robot) + sway * np.sin(2.0 * time)[:, None] * np.arange(len(robot.tree.joints))
    force = np.tile([9.81 * np.sin(tilt), 0.0, 9.81 * np.cos(tilt)], (100, 1))
    found = Footprint(robot, LIMITS)
    found.add(time, q, force)
    return found


def with_load(robot: Robot, mass: float, at: np.ndarray) -> InertialParameters:
    return robot.inertias[robot.trunk] + InertialParameters.from_moments(mass, mass * at, np.zeros((3, 3)))


def feet(robot: Robot) -> np.ndarray:
    return np.asarray(foot_positions(robot, standing_configuration(robot)[None])[0])


@pytest.mark.parametrize("tilt", [0.0, 0.2])
@pytest.mark.parametrize("leg", range(4))
def test_a_load_along_the_vertical_through_a_foot_is_that_legs(robot: Robot, leg: int, tilt: float) -> None:
    up = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    print_of = footprint(robot, tilt)
    for mass in (2.0, -2.0):
        at = feet(robot)[leg] + 0.37 * up
        assert print_of.above(mass, mass * at) == (leg, pytest.approx(mass), pytest.approx(0.0, abs=1e-9))
    _, _, left = print_of.above(2.0, 2.0 * feet(robot).mean(axis=0))
    assert left == pytest.approx(np.sqrt(0.5), abs=0.02)


def test_what_is_doubted(robot: Robot) -> None:
    stands, foot = footprint(robot), feet(robot)[1]
    found = {
        share: list(doubts(robot, with_load(robot, share * robot.mass, foot), 0.0, None, stands, LIMITS))
        for share in (0.2, -0.2, 0.05, -0.05)
    }
    assert [verdict for verdict, _ in found[0.2]] == ["doubtful"]
    assert [verdict for verdict, _ in found[-0.2]] == ["bad"]
    assert all("RF" in found[share][0][1] for share in (0.2, -0.2))
    assert found[0.05] == found[-0.05] == []
    edge = [with_load(robot, -share * LIMITS.least * robot.mass, foot) for share in (0.95, 1.05)]
    assert [len(list(doubts(robot, load, 0.0, None, stands, LIMITS))) for load in edge] == [0, 1]
    half_way = 0.5 * (foot + feet(robot).mean(axis=0))
    assert not list(doubts(robot, with_load(robot, 0.3 * robot.mass, half_way), 0.0, None, stands, LIMITS))
    centre = robot.inertias[robot.trunk].com
    for share, said in ((-0.15, "15 % less"), (0.9, "1.9 times")):
        ((verdict, reason),) = doubts(robot, with_load(robot, share * robot.mass, centre), 0.0, None, stands, LIMITS)
        assert verdict == "doubtful"
        assert said in reason


def test_what_the_bars_allow_for_is_not_doubted(robot: Robot) -> None:
    stands, centre = footprint(robot), robot.inertias[robot.trunk].com
    for share in (-0.15, 0.9):
        load, std = with_load(robot, share * robot.mass, centre), 0.36 * abs(share) * robot.mass
        assert not list(doubts(robot, load, std, None, stands, LIMITS))
        assert list(doubts(robot, load, 0.8 * std, None, stands, LIMITS))
    foot, two = feet(robot)[1], load_robot("bolt")
    assert list(doubts(robot, with_load(robot, 0.2 * robot.mass, foot), robot.mass, None, stands, LIMITS))
    load, stands = with_load(two, 0.2 * two.mass, feet(two)[1]), footprint(two)
    assert list(doubts(two, load, 0.01 * two.mass, None, stands, LIMITS))
    assert not list(doubts(two, load, 0.1 * two.mass, None, stands, LIMITS))


@pytest.mark.parametrize(("at", "doubted"), [("hand", True), ("", False)])
def test_what_is_taken_off_an_arm_makes_the_robot_lighter(robot: Robot, at: str, doubted: bool) -> None:
    """The trunk's values contain a load on the trunk, and none elsewhere."""
    trunk, moving = robot.inertias[robot.trunk], footprint(robot, sway=0.1)
    off = Payload(-0.2 * robot.mass, 0.01 * robot.mass, np.full(3, np.nan), np.full((3, 3), np.nan), at=at)
    assert bool(list(doubts(robot, trunk, 0.0, off, moving, LIMITS))) == doubted


def test_feet_that_step_say_nothing_of_one_leg(robot: Robot) -> None:
    steps = footprint(robot, sway=0.05)
    assert not steps.stood
    assert footprint(robot).stood
    assert not list(doubts(robot, with_load(robot, 0.2 * robot.mass, feet(robot)[0]), 0.0, None, steps, LIMITS))
    with pytest.raises(StaderaError):
        AgreementLimits(least=0.0)


def test_a_dead_leg_is_refused_and_a_load_above_a_foot_said_to_look_alike(robot: Robot) -> None:
    x, y, _ = (float(v) for v in feet(robot)[2])
    settings = SimulateSettings("standard", Load(2.5, at=(x, y, 0.1)), duration=2.5, seed=1, load_time=1.2, hold=2)
    log = simulate(robot, "stand", settings).recording
    result = weigh(robot, log, (0.0, 1.1))
    assert result.trust.verdict == "doubtful"
    assert "right above foot LH" in result.trust.reasons[-1]
    assert log.effort is not None
    effort = log.effort.copy()
    effort[:, [log.index(joint) for joint in robot.leg("RF").joints]] *= 0.05
    with pytest.raises(UntrustedError, match="it is a unit, the torques' scale"):
        weigh(robot, replace(log, effort=effort))


def test_torques_that_are_all_too_large_are_said_of_the_robot_at_the_tare() -> None:
    """By 35 %, which the fit cannot see: all that it weighs more is over the model's mass, or on the robot."""
    robot, load = load_robot("hyq"), Load(5.0, "kg", (0.0, 0.0, 0.1))
    log = simulate(
        robot, "shake", SimulateSettings("standard", load, duration=5.0, rate=250.0, seed=4, load_time=2.5)
    ).recording
    assert log.effort is not None

    def notes(factor: float, weight: float | None = None) -> list[str]:
        found = weigh(robot, replace(log, effort=factor * log.effort), (0.0, 2.4), weight=weight)
        return [note for note in found.notes if "something is on it that the model lacks" in note]

    assert not notes(1.0)
    (note,) = notes(1.35)
    assert "all torques are up to 1.3" in note
    assert not notes(1.35, 1.35 * robot.mass)
