"""A robot in motion with the walking estimator, and a controller that uses the estimate once it can be trusted."""

from __future__ import annotations

import time
from typing import Literal

import numpy as np

from stadera.constants import GRAVITY
from stadera.lab.control import Crawl, Shake, TestBed, Trot, TrunkController
from stadera.lab.control.stand import Controller
from stadera.lab.control.steps import CrawlCommand
from stadera.lab.plant import Plant, Sensors, estimator_model, plant_model, sensor_errors
from stadera.lab.plant.payload import Tray
from stadera.lab.supervise.trusted import TrustedEstimator
from stadera.robot import Robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import Measurement, TrunkEstimator, TrunkModel
from stadera.trunk.protocol import TrunkEstimate

Gait = Literal["crawl", "trot", "shake"]
"""Motion of a robot; a shake is on the spot."""


class RobotInMotion:
    """A robot that stands, ready to move; the sizes of the sensors' errors, a named set, are known to the estimator.

    Torques are held for `hold` periods; every `keep`-th measurement is kept in `kept`, none for 0.

    Attributes:
        model: the robot model of controller and estimator.
        start: the estimator's prior of the trunk.
        estimator: the walking estimator; the controller gets its estimates once they can be trusted.
    """

    def __init__(self, robot: Robot, gait: Gait, errors: str, draw: int, hold: int = 1, keep: int = 0) -> None:
        sizes = sensor_errors(errors)
        real = plant_model(robot, sizes)
        self.model, self.start = estimator_model(real, sizes, draw), wrong_start(robot)
        self.estimator = TrunkEstimator(self.model, start=self.start)
        self.controller = controller_of(gait, self.model, TrunkModel.prior(robot))
        self._watched = _Watched(self.estimator, keep)
        plant, sensors = Plant(real), Sensors(sizes, draw, robot)
        plant.reset(standing_configuration(robot))
        trusted = TrustedEstimator(self._watched, robot)
        self.bed = TestBed(plant, sensors, self.controller, trusted, feed_back=True, hold=hold)

    @property
    def kept(self) -> list[Measurement]:
        return self._watched.kept

    @property
    def share_of_time(self) -> float:
        """The estimator's processor time divided by the simulated time."""
        return self._watched.seconds / max(self.bed.plant.time, 1e-3)


class _Watched:
    """Measures an estimator's processor time, and keeps every n-th measurement."""

    def __init__(self, inner: TrunkEstimator, keep: int) -> None:
        self.inner, self.seconds, self._keep, self._count = inner, 0.0, keep, 0
        self.kept: list[Measurement] = []

    def update(self, measurement: Measurement) -> None:
        if self._keep and self._count % self._keep == 0:
            self.kept.append(measurement)
        self._count += 1
        begin = time.process_time()
        self.inner.update(measurement)
        self.seconds += time.process_time() - begin

    def estimate(self) -> TrunkEstimate:
        return self.inner.estimate()


def wrong_start(robot: Robot, light: float = 0.9, off: float = 0.15) -> TrunkModel:
    """Prior of the trunk with a share of its true mass, and an error as a share of the hips' half spacing."""
    prior, tray = TrunkModel.prior(robot), Tray.of(robot)
    return TrunkModel(light * prior.mass, prior.com_trunk + off * np.array([*tray.half_size[:2], 0.0]))


def controller_of(gait: Gait, model: Robot, trunk: TrunkModel) -> Controller:
    """Controller of a gait, standing."""
    if gait == "trot":
        return Trot.of(model, trunk)
    controller = TrunkController(model, trunk=trunk)
    return Crawl(controller) if gait == "crawl" else controller


def walk_on(controller: Trot | Crawl, speed: float, turn: float) -> None:
    """Starts walking: forwards [m/s], and turning to the left [rad/s]."""
    if isinstance(controller, Trot):
        controller.walk((speed, 0.0), turn)
    else:
        controller.command = CrawlCommand(speed, turn)
        controller.resume()


def fastest_trot(controller: Trot, share: float = 0.26) -> float:
    """The highest speed asked of a trot [m/s], the same share of √(g h) for all robots: 0.6 m/s for HyQ."""
    return share * GRAVITY * controller.settings.pendulum


def sway(controller: TrunkController, amplitude: float = 1.0) -> None:
    """Moves the body on the spot; see `Shake`."""
    controller.follow(Shake.of(controller.robot, controller.reference, controller.time, amplitude))
