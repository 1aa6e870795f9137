"""The test-bed's loop: plant, sensors, controller and whoever wants to watch, one control period after the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from stadera.lab.plant.plant import Plant, SimulationError
from stadera.lab.sensors import Sensors
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import Estimator, Status
from stadera.types import Array, Bools


class Controller(Protocol):
    """What the loop asks of a controller: the trunk controller itself, or a gait that walks by it."""

    @property
    def robot(self) -> Robot:
        """The model of the robot."""
        ...

    @property
    def stance(self) -> Bools:
        """(4,) bool, the legs that are to carry."""
        ...

    def update_trunk(self, trunk: TrunkModel) -> bool:
        """Takes a new model of the trunk; False where it is not plausible."""
        ...

    def update(self, measurement: Measurement) -> Array:
        """Joint torques (n,) [N·m]."""
        ...


Watcher = Callable[["TestBed"], None]


class TestBed:
    """A plant under its controller, with an estimator.

    Controller and estimator see measurements alone. With `feed_back` the controller uses the estimator's trunk, unless
    that refused the measurement.

    Args:
        plant, sensors, controller: made for each other; the plant has been reset.
        estimator: fed with measurements before the controller; None for none.
        feed_back: hand its estimates to the controller.
        every: feed the estimator in one period out of so many.
        hold: ask the controller in one period out of so many, and hold its torques meanwhile; two nearly halve the
            time that a walk takes.

    Attributes:
        measurement: the last one.

    Raises:
        SimulationError: `every` or `hold` is less than one.
    """

    __test__ = False  # not a test case, whatever a test runner makes of its name

    def __init__(
        self,
        plant: Plant,
        sensors: Sensors,
        controller: Controller,
        estimator: Estimator | None = None,
        *,
        feed_back: bool = False,
        every: int = 1,
        hold: int = 1,
    ) -> None:
        if every < 1:
            raise SimulationError(f"an estimator is fed every so many periods, at least one; got {every}")
        if hold < 1:
            raise SimulationError(f"torques are held for so many periods, at least one; got {hold}")
        self.plant, self.sensors, self.controller = plant, sensors, controller
        self.estimator, self.feed_back = estimator, feed_back
        self._every, self._hold, self._periods = every, hold, 0
        self._torque: Array = plant.effort
        self._mount = ImuMount.of(controller.robot)
        self.measurement: Measurement | None = None

    def step(self) -> None:
        """One period: measure, estimate, control, simulate."""
        sample = self.sensors.read(self.plant)
        estimator = self.estimator if self._periods % self._every == 0 else None
        asked = self._periods % self._hold == 0
        self._periods += 1
        if asked or estimator is not None:
            measurement = Measurement.from_sample(sample, self._mount, self.controller.stance)
            self.measurement = measurement
            if estimator is not None:
                self._feed(estimator, measurement)
            if asked:
                self._torque = self.controller.update(measurement)
        self.plant.step(self._torque)

    def _feed(self, estimator: Estimator, measurement: Measurement) -> None:
        estimator.update(measurement)
        if self.feed_back:
            estimate = estimator.estimate()
            if estimate.status in (Status.MOVING, Status.CONVERGED):
                self.controller.update_trunk(estimate.trunk)

    def run(self, seconds: float, watch: Watcher | None = None) -> None:
        """Steps until that much time [s] has passed; `watch` is called after every step."""
        for _ in range(round(seconds / self.plant.timestep)):
            self.step()
            if watch is not None:
                watch(self)
