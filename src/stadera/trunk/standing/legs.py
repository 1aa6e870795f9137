"""The legs' kinematics and dynamics at a measurement, evaluated once for all who ask."""

from __future__ import annotations

from stadera.legs.instant import LegDynamics, LegMotion, LegState
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement


class MeasuredLegs:
    """States of the legs by measurement; the last one is kept, so that controller and estimators share the work.

    Attributes:
        robot: the model of the legs.
        columns: (4, 3), where each leg's joints are in the tree's order.
        mass: [kg], of all leg links.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._dynamics = LegDynamics(robot)
        self.columns = self._dynamics.columns
        self.mass = self._dynamics.leg_mass
        self._last: Measurement | None = None
        self._state: LegState | None = None
        self._motion: LegMotion | None = None

    def at(self, measurement: Measurement) -> LegState:
        """The state at this measurement; its `feet` are forward kinematics, whatever the measurement says of them."""
        if self._state is None or measurement is not self._last:
            m = measurement
            self._state = self._dynamics.at(m.joint_position, m.joint_velocity, m.angular_velocity, m.force_at_origin)
            self._last, self._motion = m, None
        return self._state

    def motion_at(self, measurement: Measurement) -> LegMotion:
        """How the legs move at this measurement; evaluated only when asked for."""
        self.at(measurement)
        if self._motion is None:
            self._motion = self._dynamics.motion()
        return self._motion
