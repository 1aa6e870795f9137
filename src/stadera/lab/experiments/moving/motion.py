"""A robot in motion with the walking estimator, and a controller that uses the estimate once it can be trusted."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stadera.constants import GRAVITY
from stadera.lab.control import Shake, TestBed, Trot, TrunkController
from stadera.lab.control.crawl.crawl import Crawl
from stadera.lab.control.crawl.settings import CrawlCommand
from stadera.lab.control.stand import Controller
from stadera.lab.plant import Plant, Sensors, estimator_model, plant_model, sensor_errors
from stadera.lab.plant.payload import Tray
from stadera.robot import Robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import Measurement, TrunkEstimator, TrunkModel
from stadera.trunk.protocol import TrunkEstimate
from stadera.trunk.trusted import TrustedEstimator

Gait = Literal["crawl", "trot", "shake"]
"""Motion of a robot; a shake is on the spot."""


@dataclass(frozen=True)
class MotionSettings:
    """Settings of the estimators in the studies."""

    light: float = 0.9  # the prior's mass, as a share of the true one
    off: float = 0.15  # the prior's error of the centre of mass, as a share of the hips' half spacing
    trot: float = 0.26  # highest speed of a trot, as a share of √(g h)


_GIVEN = MotionSettings()


class RobotInMotion:
    """A robot that stands, ready to move; the sizes of the sensors' errors, a named set, are known to the estimator.

    Attributes:
        model: the robot model of controller and estimator.
        start: the estimator's prior of the trunk.
        inner: the walking estimator.
        trusted: the estimates used by the controller.
    """

    def __init__(self, robot: Robot, gait: Gait, errors: str, draw: int, hold: int = 1) -> None:
        sizes = sensor_errors(errors)
        real = plant_model(robot, sizes)
        self.model, self.start = estimator_model(real, sizes, draw), wrong_start(robot)
        self.inner = TrunkEstimator(self.model, start=self.start)
        self._timed = _Timed(self.inner)
        self.trusted = TrustedEstimator(self._timed, robot)
        self.controller = controller_of(gait, self.model, TrunkModel.prior(robot))
        plant, sensors = Plant(real), Sensors(sizes, draw, robot)
        plant.reset(standing_configuration(robot))
        self.bed = TestBed(plant, sensors, self.controller, self.trusted, feed_back=True, hold=hold)

    @property
    def cost(self) -> float:
        """Processor time of the estimator [s]."""
        return self._timed.seconds


class _Timed:
    """Measures an estimator's processor time."""

    def __init__(self, inner: TrunkEstimator) -> None:
        self.inner, self.seconds = inner, 0.0

    def update(self, measurement: Measurement) -> None:
        begin = time.process_time()
        self.inner.update(measurement)
        self.seconds += time.process_time() - begin

    def estimate(self) -> TrunkEstimate:
        return self.inner.estimate()


def wrong_start(robot: Robot) -> TrunkModel:
    """Prior of the trunk: 10 % too light, with an error of 15 % of the hips' half spacing."""
    prior, tray = TrunkModel.prior(robot), Tray.of(robot)
    shift = _GIVEN.off * np.array([*tray.half_size[:2], 0.0])
    return TrunkModel(_GIVEN.light * prior.mass, prior.com_trunk + shift)


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


def fastest_trot(controller: Trot) -> float:
    """The highest speed asked of a trot [m/s], the same share of √(g h) for all robots: 0.6 m/s for HyQ."""
    return _GIVEN.trot * GRAVITY * controller.settings.pendulum


def sway(controller: TrunkController, amplitude: float = 1.0) -> None:
    """Moves the body on the spot; see `Shake`."""
    controller.follow(Shake.of(controller.robot, controller.reference, controller.time, amplitude))
