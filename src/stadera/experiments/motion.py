"""A robot in motion, the walking estimator beside it, and a controller that goes by what that can be trusted with."""

from __future__ import annotations

import time
from typing import Literal

import numpy as np

from stadera.control import Shake, TestBed, Trot, TrunkController
from stadera.control.crawl import Crawl
from stadera.control.crawl_settings import CrawlCommand
from stadera.control.stand import Controller
from stadera.estimate import Measurement, TrunkModel, WalkingEstimator, WalkingNoise
from stadera.estimate.protocol import TrunkEstimate
from stadera.estimate.stillness import GRAVITY
from stadera.estimate.trusted import TrustedEstimator
from stadera.robot import Robot
from stadera.robot.stance import standing_configuration
from stadera.sim import Plant, SensorErrors, Sensors, estimator_model, plant_model, sensor_errors
from stadera.sim.payload import Tray

Gait = Literal["crawl", "trot", "shake"]
"""How a robot moves; a shake is on the spot."""

_TROT_SPEED = 0.26  # of √(g h)
_LIGHT, _OFF = 0.9, 0.15  # what the start believes of the trunk
_HARSH = 2.0, 3e-3  # under `harsh` errors, how much larger noise is than the default, and the torques' lag [s]


class RobotInMotion:
    """A robot that stands and is ready to go.

    Args:
        robot: as it is, but for what the errors make of it.
        gait: what it will move by.
        errors: of the sensors, a named set; the estimator is told their sizes.
        draw: the seed of everything drawn.
        hold: see `TestBed`.

    Attributes:
        believed: the robot as controller and estimator believe it to be.
        start: what the estimator believes of the trunk at first.
        inner: the walking estimator.
        trusted: what of it the controller goes by.
        controller, bed: as made.
    """

    def __init__(self, robot: Robot, gait: Gait, errors: str, draw: int, hold: int = 1) -> None:
        sizes = sensor_errors(errors)
        real = plant_model(robot, sizes)
        self.believed, self.start = estimator_model(real, sizes, draw), wrong_start(robot)
        self.inner = WalkingEstimator(self.believed, noise_of(self.believed, errors, sizes), self.start)
        self._timed = _Timed(self.inner)
        self.trusted = TrustedEstimator(self._timed, robot)
        self.controller = controller_of(gait, self.believed, TrunkModel.prior(robot))
        plant, sensors = Plant(real), Sensors(sizes, draw, robot)
        plant.reset(standing_configuration(robot))
        self.bed = TestBed(plant, sensors, self.controller, self.trusted, feed_back=True, hold=hold)

    @property
    def cost(self) -> float:
        """Seconds of processor time that the estimator took."""
        return self._timed.seconds


class _Timed:
    """An estimator with a clock."""

    def __init__(self, inner: WalkingEstimator) -> None:
        self.inner, self.seconds = inner, 0.0

    def update(self, measurement: Measurement) -> None:
        begin = time.process_time()
        self.inner.update(measurement)
        self.seconds += time.process_time() - begin

    def estimate(self) -> TrunkEstimate:
        return self.inner.estimate()


def noise_of(believed: Robot, errors: str, sizes: SensorErrors) -> WalkingNoise:
    """What the estimator is told of the errors' sizes."""
    noise = WalkingNoise.of(believed, *_HARSH) if errors == "harsh" else WalkingNoise.of(believed)
    return noise.with_model(sizes.leg_mass, sizes.leg_com, sizes.friction_known)


def wrong_start(robot: Robot) -> TrunkModel:
    """What estimators believe of the trunk at first: 10 % too light, off by 15 % of the hips' half spacing."""
    prior, tray = TrunkModel.prior(robot), Tray.of(robot)
    shift = _OFF * np.array([*tray.half_size[:2], 0.0])
    return TrunkModel(_LIGHT * prior.mass, prior.com_trunk + shift)


def controller_of(gait: Gait, believed: Robot, belief: TrunkModel) -> Controller:
    """That of a gait, standing."""
    if gait == "trot":
        return Trot.of(believed, belief)
    controller = TrunkController(believed, belief=belief)
    return Crawl(controller) if gait == "crawl" else controller


def walk_on(controller: Trot | Crawl, speed: float, turn: float) -> None:
    """Walks from now on: ahead [m/s], and to the left [rad/s]."""
    if isinstance(controller, Trot):
        controller.walk((speed, 0.0), turn)
    else:
        controller.command = CrawlCommand(speed, turn)
        controller.resume()


def fastest_trot(controller: Trot) -> float:
    """The highest speed asked of a trot [m/s], the same share of √(g h) for all robots: 0.6 m/s for HyQ."""
    return _TROT_SPEED * GRAVITY * controller.settings.pendulum


def sway(controller: TrunkController, amplitude: float = 1.0) -> None:
    """Shakes its body where it stands; see `Shake`."""
    controller.follow(Shake.of(controller.robot, controller.reference, controller.time, amplitude))
