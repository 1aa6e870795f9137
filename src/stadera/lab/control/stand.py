"""Control loop of the test-bed: plant, sensors, controller and watchers, one control period after the other."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stadera.lab.control.arms import ArmTorques
from stadera.lab.control.trunk import TrunkController
from stadera.lab.control.whole_body import WholeBody
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import Sensors, measurement_of
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import Estimator, Status
from stadera.types import Array, Bools


class Gait:
    """A gait moves the reference and the legs of a trunk controller, to which it delegates the rest."""

    def __init__(self, controller: TrunkController) -> None:
        self.controller = controller

    @property
    def robot(self) -> Robot:
        return self.controller.robot

    @property
    def stance(self) -> Bools:
        return self.controller.stance

    def update_trunk(self, trunk: TrunkModel) -> bool:
        return self.controller.update_trunk(trunk)

    def update(self, measurement: Measurement) -> Array:
        """Joint torques (n,) [N·m]."""
        raise NotImplementedError


Controller = TrunkController | Gait | WholeBody
"""What the loop calls."""


Watcher = Callable[["TestBed"], None]


class TestBed:
    """A plant under its controller, with an estimator; both receive measurements only.

    The plant has been reset. The estimator gets every n-th measurement before the controller, which gets its estimates
    with `feed_back`, unless it refused the measurement. Torques are held for `hold` periods; two nearly halve the
    computing time of a walk. `arms` moves the joints outside the legs of a robot whose controller moves the legs only.
    """

    __test__ = False  # not a test case, although its name begins with Test

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
        arms: ArmTorques | None = None,
    ) -> None:
        self.plant, self.sensors, self.controller = plant, sensors, controller
        self.estimator, self.feed_back, self._arms = estimator, feed_back, arms
        self._every, self._hold, self._periods = every, hold, 0
        self._torque: Array = plant.effort
        self._mount = ImuMount.of(controller.robot)
        self.measurement: Measurement | None = None

    @property
    def trunk_controller(self) -> TrunkController | WholeBody:
        """The controller itself, or that of the gait."""
        return self.controller.controller if isinstance(self.controller, Gait) else self.controller

    def step(self) -> None:
        """One period: measure, estimate, control, simulate."""
        sample = self.sensors.read(self.plant)
        estimator = self.estimator if self._periods % self._every == 0 else None
        asked = self._periods % self._hold == 0
        self._periods += 1
        if asked or estimator is not None:
            measurement = measurement_of(sample, self._mount, self.controller.stance)
            self.measurement = measurement
            if estimator is not None:
                self._feed(estimator, measurement)
            if asked:
                self._torque = self._asked(measurement)
        self.plant.step(self._torque)

    def _asked(self, m: Measurement) -> Array:
        """The controller's torques, with those of the arms if it moves the legs only."""
        if self._arms is None:
            return self.controller.update(m)
        legs, motion = slice(self._arms.arms.first), (m.angular_velocity, m.force_at_origin)
        arms = self._arms.at(m.time, m.joint_position, m.joint_velocity, *motion)
        mine = {name: getattr(m, name)[legs] for name in ("joint_position", "joint_velocity", "effort")}
        return np.concatenate([self.controller.update(replace(m, **mine)), arms])

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
