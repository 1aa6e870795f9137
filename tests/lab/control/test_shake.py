"""Standing with a small motion of the body."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lab.control.testbed import bed, robot_named
from stadera.errors import ModelError
from stadera.lab.control.reference import Shake, TrunkPose
from stadera.lab.control.stand import TestBed
from stadera.lab.control.trunk import TrunkController
from stadera.lab.plant.sensors import STANDARD


@pytest.mark.parametrize("name", ["hyq", "anymal_c"])
def test_the_body_moves_and_the_feet_stay(name: str) -> None:
    robot = robot_named(name)
    test = bed(robot, errors=STANDARD)
    c = test.controller
    assert isinstance(c, TrunkController)
    test.run(0.2)
    centre, feet = c.reference, test.plant.state.foot_position
    shake = Shake.of(robot, centre, c.time)
    c.follow(shake)
    test.run(1.0)
    turns, errors, contacts = [], [], []

    def watch(test: TestBed) -> None:
        state = test.plant.state
        turns.append(pin.log3(centre.rotation.T @ state.rotation))
        errors.append(pin.log3(shake.at(test.plant.time).rotation.T @ state.rotation))
        contacts.append(state.foot_contact.all())

    test.run(1.5, watch)
    assert all(contacts)
    assert np.ptp(turns, axis=0).min() > np.deg2rad(2.0)
    assert np.sqrt(np.mean(np.square(errors))) < np.deg2rad(0.8)
    slid = test.plant.state.foot_position - feet
    assert np.abs(slid[:, :2]).max() < 5e-4 + 0.15 * robot.legs[0].foot_radius  # they roll


def test_rates_are_the_slopes_of_the_motion() -> None:
    centre = TrunkPose(np.zeros(3), pin.exp3(np.array([0.1, 0.2, 0.3])))
    shake, dt = Shake(centre, 1.0, np.full(3, 0.07), np.full(3, 0.03)), 1e-5
    assert shake.at(0.5).at_rest
    assert shake.at(1.0).at_rest
    for time in (1.2, 1.9, 3.3):
        a, b, c = (shake.at(time + k * dt) for k in (-1, 0, 1))
        np.testing.assert_allclose((c.position - a.position) / (2 * dt), b.velocity, atol=1e-6)
        np.testing.assert_allclose((c.velocity - a.velocity) / (2 * dt), b.acceleration, atol=1e-5)
        np.testing.assert_allclose(pin.log3(a.rotation.T @ c.rotation) / (2 * dt), b.angular_velocity, atol=1e-6)
    way = np.array([shake.at(t).position for t in np.linspace(1.0, 30.0, 3000)])
    assert np.abs(way).max() <= 0.03
    assert np.abs(way).max(axis=0).min() > 0.025


def test_amplitudes_are_checked() -> None:
    centre = TrunkPose(np.zeros(3), np.eye(3))
    with pytest.raises(ModelError, match="amplitudes"):
        Shake(centre, 0.0, np.full(3, 0.7), np.zeros(3))
    with pytest.raises(ModelError, match="amplitudes"):
        Shake(centre, 0.0, np.zeros(3), np.full(3, np.nan))
