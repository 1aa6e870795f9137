"""A trot by measurements alone: it goes where it is told, carries what nobody told it of, starts and stops."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lab.control.testbed import robot_named
from stadera.lab.control.stand import TestBed
from stadera.lab.control.trot import Trot, TrotSettings
from stadera.lab.plant.payload import RigidMass
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import HARSH, IDEAL, SensorErrors, Sensors, estimator_model, plant_model
from stadera.robot import Robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import TrunkBounds, TrunkModel
from stadera.trunk.standing.detection import GRAVITY


def trotting(name: str, errors: SensorErrors, seed: int = 5, hold: int = 1) -> tuple[TestBed, Trot]:
    robot = robot_named(name)
    real = plant_model(robot, errors)
    plant = Plant(real)
    plant.reset(standing_configuration(robot))
    trot = Trot.of(estimator_model(real, errors, seed))
    bed = TestBed(plant, Sensors(errors, seed, robot), trot, hold=hold)
    bed.run(0.2)
    return bed, trot


def corner_load(robot: Robot, share: float, forwards: float, left: float) -> RigidMass:
    """Of that share of the robot's mass, half-way to a corner of the feet's rectangle, above the hips."""
    bounds = TrunkBounds.of(robot)
    middle, half = 0.5 * (bounds.low + bounds.high), 0.5 * (bounds.high - bounds.low)
    place = middle + half * np.array([forwards, left, 0.2])
    return RigidMass.box(share * robot.mass, (0.1, 0.1, 0.1), (place[0], place[1], place[2]))


@pytest.mark.parametrize(("name", "forwards", "left"), [("go2", 0.5, 0.5), ("anymal_c", -0.5, -0.5)])
def test_it_goes_where_it_is_told_and_carries_on_with_a_load(name: str, forwards: float, left: float) -> None:
    bed, trot = trotting(name, HARSH, hold=2)
    trot.walk((0.4, 0.0), 0.3)
    bed.run(0.8)
    speeds, yaws, tilts = [], [], []

    def watch(bed: TestBed) -> None:
        state = bed.plant.state
        yaw, pitch, roll = Rotation.from_quat(state.orientation).as_euler("ZYX")
        speeds.append((state.rotation.T @ state.linear_velocity)[0])
        yaws.append(yaw)
        tilts.append(max(abs(pitch), abs(roll)))

    bed.run(1.0, watch)
    assert np.mean(speeds) == pytest.approx(0.4, abs=0.05)
    assert yaws[-1] - yaws[0] == pytest.approx(0.3, abs=0.06)
    assert max(tilts) < np.deg2rad(3.0)
    bed.plant.apply_payload(corner_load(trot.robot, 0.25, forwards, left))
    bed.run(1.5, watch)
    assert max(tilts) < np.deg2rad(15.0)
    assert not bed.plant.on_ground
    low = bed.plant.state.position[2]
    assert trot.update_trunk(TrunkModel.of(bed.plant.truth()))
    bed.run(0.7)
    assert bed.plant.state.position[2] - low > 0.7 * 0.25 / 1.25 * GRAVITY / 12.0**2  # the springs' sag is gone


def test_it_stops_and_stands_and_knows_how_far_it_came() -> None:
    bed, trot = trotting("go2", IDEAL)
    start, began = bed.plant.state.position, trot.controller.position
    trot.walk((0.6, 0.0))
    bed.run(1.5)
    assert trot.stepping
    trot.stop()
    bed.run(1.5)
    assert not trot.stepping
    assert trot.stance.all()
    state = bed.plant.state
    assert np.abs(state.joint_velocity).max() < 0.05
    gone = state.position - start
    assert gone[0] > 0.6
    np.testing.assert_allclose(trot.controller.position - began, gone, atol=0.02 * gone[0])
    trot.walk((0.0, 0.0))
    bed.run(0.5)
    assert trot.stepping


def test_steps_make_of_the_pendulum_what_they_should() -> None:
    """The rule of where to step against the pendulum's own equation, integrated: ẍ = x / T²."""
    s = TrotSettings.of(robot_named("hyq"))
    speed, wanted = 0.9, 0.4
    for _ in range(8):
        ahead = s.pendulum * np.tanh(0.5 * s.step / s.pendulum) * wanted + s.capture * (speed - wanted)
        run = solve_ivp(lambda _, y: (y[1], y[0] / s.pendulum**2), (0.0, s.step), (-ahead, speed), rtol=1e-9)
        off, speed = speed - wanted, run.y[1, -1]
        assert abs(speed - wanted) < 0.3 * abs(off) + 1e-6
