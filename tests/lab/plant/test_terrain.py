"""Stepping stones: what is drawn, what the plant stands on, and that its contacts are told whole."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.lab.plant.plant import Plant
from stadera.lab.plant.terrain import Stones, Terrain
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration

STONES = Stones(seed=3, height=0.05)


def test_stones_are_drawn_by_their_seed_within_their_height() -> None:
    heights = STONES.heights()
    np.testing.assert_array_equal(heights, Stones(seed=3, height=0.05).heights())
    assert not np.array_equal(heights, Stones(seed=4, height=0.05).heights())
    assert np.abs(heights).max() <= 0.05
    assert np.ptp(heights) > 0.09
    behind, ahead, side = STONES.counts
    assert heights.shape == (behind + ahead + 1, 2 * side + 1)
    assert not heights[behind, side]  # level around the origin


def test_the_ground_ends_with_the_stones() -> None:
    terrain = Terrain(stones=Stones(seed=0))
    assert np.isfinite(terrain.clearance([0.4, -0.3, 0.0]))
    assert np.isinf(terrain.clearance([100.0, 0.0, 0.0]))


@pytest.mark.parametrize("degrees", [0.0, 10.0])
def test_plant_rests_on_stones_and_feels_its_weight(degrees: float) -> None:
    """A robot that sinks in its knees until its feet carry: forces, points and clearance belong together. It rocks for
    two to three seconds, differently with every rounding, before it rests.
    """
    robot = load_robot("hyq")
    terrain = Terrain(slope=np.deg2rad(degrees), heading=0.3, stones=Stones(seed=1, height=0.05, size=0.2, level=0.0))
    plant, stance = Plant(robot, terrain), standing_configuration(robot)
    plant.reset(stance)
    forces = []
    for _ in range(5000):
        plant.step(4000.0 * (stance - plant.joint_position) - 80.0 * plant.joint_velocity)
        forces.append(plant.state.foot_force.sum(axis=0))
    state = plant.state
    assert state.foot_contact.sum() >= 3
    weight = robot.mass * 9.81
    np.testing.assert_allclose(np.mean(forces[4000:], axis=0), [0.0, 0.0, weight], atol=0.002 * weight)
    assert (state.foot_force[state.foot_contact] @ terrain.normal > 0.0).all()
    np.testing.assert_array_equal(np.isnan(state.contact_point[:, 0]), ~state.foot_contact)
    touching = state.contact_point[state.foot_contact]
    assert np.abs(np.linalg.norm(touching - state.foot_position[state.foot_contact], axis=1) - 0.02175).max() < 2e-3
    assert (terrain.clearance(state.foot_position) > 0.02).all()
    assert not plant.on_ground


def test_soft_ground_gives_way() -> None:
    robot = load_robot("hyq")
    stance = standing_configuration(robot)

    def sunk(softness: float) -> float:
        plant = Plant(robot, Terrain(softness=softness))
        plant.reset(stance)
        for _ in range(1000):
            plant.step(4000.0 * (stance - plant.joint_position) - 80.0 * plant.joint_velocity)
        state = plant.state
        assert state.foot_force.sum(axis=0)[2] == pytest.approx(robot.mass * 9.81, rel=0.02)
        return float(robot.legs[0].foot_radius - state.foot_position[:, 2].mean())

    assert 0.0 < sunk(0.0) < 1e-4
    assert 5e-4 < sunk(0.03) < 2e-3
