"""A G1 that walks slowly while a load comes into its hand: it does not fall, its feet leave the ground, and the log is
weighed as any other.
"""

from __future__ import annotations

import numpy as np
import pytest

from stadera.errors import MissingExtraError, StaderaError
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import Run, simulate
from stadera.robot import Robot, load_robot
from stadera.weigh.weigh import weigh

HAND, SPEED, LANDS = "left_wrist_yaw_link", 0.05, 4.2


def of_name(name: str) -> Robot:
    try:
        return load_robot(name)
    except MissingExtraError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def walk() -> Run:
    robot = of_name("g1")
    load = Load(0.1 * robot.mass, at=(0.05, 0.0, 0.02), on=HAND)
    settings = SimulateSettings("ideal", load, duration=7.5, load_time=LANDS, speed=SPEED, arms=0.3, hold=2)
    return simulate(robot, "step", settings)


def test_both_feet_step_and_it_gets_ahead_without_a_fall(walk: Run) -> None:
    assert walk.truth.fell is None
    forces = walk.true_motion.foot_force
    for foot in forces:
        air = forces[foot][:, 2] <= 0.0
        assert np.count_nonzero(np.diff(air.astype(int)) == 1) >= 2
        assert 0.1 < air.mean() < 0.4


def test_what_it_carries_is_weighed_from_its_steps(walk: Run) -> None:
    found, now, robot = weigh(walk.model, walk.recording, (0.0, LANDS - 0.2)), walk.truth.moments[-1], walk.model
    assert found.trust.verdict == "good", found.trust.reasons
    payload = found.payload
    assert payload is not None
    assert payload.at == HAND
    assert payload.mass == pytest.approx(now.payload_mass, abs=0.003 * robot.mass)
    np.testing.assert_allclose(payload.com[:2], now.payload_com[:2], atol=3e-3)
    assert found.mass == pytest.approx(now.mass, abs=0.003 * robot.mass)
    np.testing.assert_allclose(found.com[:2], now.com[:2], atol=3e-3)


def test_light_fingers_without_rotors_do_not_shake_the_robot() -> None:
    assert simulate(of_name("talos"), "step", SimulateSettings("ideal", duration=0.3, rate=250.0)).truth.fell is None


@pytest.mark.parametrize(("name", "reason"), [("go2", "is a quadruped: it can stand"), ("bolt", "not two flat feet")])
def test_robots_without_two_flat_feet_do_not_step(name: str, reason: str) -> None:
    with pytest.raises(StaderaError, match=reason):
        simulate(of_name(name), "step")
    with pytest.raises(StaderaError, match="it can stand") as told:
        simulate(of_name(name), "trot" if name == "bolt" else "step")
    assert "step" not in str(told.value).partition("it can")[2]
