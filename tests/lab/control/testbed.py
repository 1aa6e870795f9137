"""Robots on the test-bed under the trunk controller."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stadera.errors import MissingExtraError
from stadera.lab.control.com_plan import PlanError
from stadera.lab.control.monitor import Fall, WalkMonitor
from stadera.lab.control.reference import ControlError
from stadera.lab.control.stand import TestBed
from stadera.lab.control.trunk import TrunkController
from stadera.lab.plant.payload import Payload, RigidMass
from stadera.lab.plant.plant import Plant, SimulationError
from stadera.lab.plant.sensors import IDEAL, SensorErrors, Sensors, plant_model
from stadera.lab.plant.terrain import Terrain
from stadera.lab.plant.world import TrueState
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import Estimator, TrunkBounds, TrunkModel

ROBOTS = ("hyq", "go2", "anymal_c", "b1")


def robot_named(name: str) -> Robot:
    try:
        return load_robot(name)
    except MissingExtraError as error:
        pytest.skip(str(error))


def load_of(robot: Robot, share: float) -> RigidMass:
    """A box of that share of the robot's weight, behind and to the left of the trunk's middle, on its back."""
    x, y, z = 0.5 * TrunkBounds.of(robot).high
    return RigidMass.box(share * robot.mass, (0.1, 0.1, 0.1), (-x, y, z))


def bed(
    robot: Robot,
    *,
    terrain: Terrain | None = None,
    payload: Payload | None = None,
    errors: SensorErrors = IDEAL,
    trunk: Callable[[TrunkModel], TrunkModel] = lambda truth: truth,
    estimator: Callable[[TrunkController], Estimator] | None = None,
    feed_back: bool = False,
    every: int = 1,
) -> TestBed:
    """A plant with a controller that starts from `trunk` of the true trunk."""
    plant = Plant(plant_model(robot, errors), terrain)
    plant.reset(standing_configuration(robot))
    if payload is not None:
        plant.apply_payload(payload)
    controller = TrunkController(robot, trunk=trunk(TrunkModel.of(plant.truth())))
    beside = None if estimator is None else estimator(controller)
    return TestBed(plant, Sensors(errors, 7, robot), controller, beside, feed_back=feed_back, every=every)


def walk_on(bed: TestBed, seconds: float, monitor: WalkMonitor) -> Fall | None:
    """Steps the test-bed for a duration [s] or until the robot falls, which includes an exception; returns the fall."""
    for _ in range(round(seconds / bed.plant.timestep)):
        try:
            bed.step()
        except (ControlError, PlanError, SimulationError) as error:
            monitor.fall = monitor.fall or Fall(bed.plant.time, str(error))
        monitor.look()
        if monitor.fall is not None:
            break
    return monitor.fall


def moved(before: TrueState, after: TrueState) -> tuple[float, float]:
    """Distance [m] and angle [rad] that the trunk moved by."""
    turn = Rotation.from_matrix(before.rotation.T @ after.rotation).magnitude()
    return float(np.linalg.norm(after.position - before.position)), float(turn)
