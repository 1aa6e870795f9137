"""Kinematics and dynamics of the legs at a measurement, evaluated once for all users."""

from __future__ import annotations

from dataclasses import replace

from stadera.body.instant import LegDynamics, LegMotion, LegState
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement


class MeasuredLegs:
    """Caches the state of the legs for the latest measurement, so that controller and estimators share the computation.

    The first moment of the legs includes what joints outside the legs have moved since the robot's reference: at rest
    it enters the balance in the same way, and the trunk's parameters stay those at the reference.

    Attributes:
        robot: the model of the legs.
        columns: (4, 3), index of each leg's joints in the tree's order.
        mass: [kg], of all leg links.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._dynamics, self._extra = LegDynamics(robot), robot.extra
        self.columns = self._dynamics.columns
        self.mass = self._dynamics.leg_mass
        self._last: Measurement | None = None
        self._state: LegState | None = None
        self._motion: LegMotion | None = None

    def at(self, measurement: Measurement) -> LegState:
        """The state at this measurement; its `feet` always come from forward kinematics."""
        if self._state is None or measurement is not self._last:
            m = measurement
            self._state = self._dynamics.at(m.joint_position, m.joint_velocity, m.angular_velocity, m.force_at_origin)
            if m.extra.size and self._extra is not None:
                moved = self._extra.first_moment(m.extra[: len(self._extra.joints)])
                self._state = replace(self._state, moment=self._state.moment + moved)
            self._last, self._motion = m, None
        return self._state

    def motion_at(self, measurement: Measurement) -> LegMotion:
        """Motion of the legs at this measurement, evaluated on demand."""
        self.at(measurement)
        if self._motion is None:
            self._motion = self._dynamics.motion()
        return self._motion
