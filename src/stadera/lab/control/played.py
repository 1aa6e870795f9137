"""Plays a table of joint positions with a joint PD controller, as robots with their own body control do."""

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import StaderaError
from stadera.excite.sinusoids import Sinusoids
from stadera.excite.trunk.planted import AXES, Planted
from stadera.lab.control.stand import Gait
from stadera.lab.control.trunk import TrunkController
from stadera.logs.recording import Recording
from stadera.robot.stance import standing_configuration
from stadera.trunk.measurement import Measurement
from stadera.types import Array


class Played(Gait):
    """Holds the stance, and plays a motion when told to. Joints that the motion lacks hold the stance.

    Torques are stiffness and damping around the table, and those that hold the model's own weight on four feet in the
    stance; a load makes the robot sag a little.
    """

    full = 0.25  # error at which the stiffness alone asks for the whole limit [rad]: 180 N·m/rad on a Go2's calf
    damping = 0.03  # share of the stiffness [s]
    # effort taken for joints without a limit, as a share of the robot's weight times the legs' length
    unlimited = 1.0

    def __init__(self, controller: TrunkController) -> None:
        super().__init__(controller)
        robot = controller.robot
        limit = np.array([robot.limits[joint].effort for joint in robot.tree.joints])
        largest = self.unlimited * robot.mass * GRAVITY * robot.leg_length
        self._limit = np.where(np.isfinite(limit), limit, largest)
        self._rest, self._time, self._begin = standing_configuration(robot), 0.0, np.inf
        none = np.zeros((1, 6, 1))
        still = Sinusoids(AXES, none[0, :, 0], none[..., 0], none, none, none, np.array([0.0, 1.0]), 0.5)
        self._held = Planted.of(robot, still, 20.0).torques(robot.inertias[robot.trunk])[0][0]
        self._table: Recording | None = None
        self._columns: list[int] = []

    def play(self, table: Recording) -> None:
        """Plays a table from now on. Raises StaderaError: it has none of the robot's joints, or less than two rows."""
        joints = self.robot.tree.joints
        self._columns = [joints.index(joint) for joint in table.joints if joint in joints]
        if not self._columns:
            raise StaderaError(f"{table.source}: none of its joints is one of {self.robot.name}'s")
        if len(table) < 2:
            raise StaderaError(f"{table.source}: a motion needs at least two rows")
        self._table, self._begin = table, self._time

    def _wanted(self) -> tuple[Array, Array]:
        q, speed, table = self._rest.copy(), np.zeros_like(self._rest), self._table
        if table is not None:
            since = min(self._time - self._begin, float(table.time[-1] - table.time[0])) + float(table.time[0])
            step = 0.5 * float(np.median(np.diff(table.time)))
            for column in self._columns:
                path = table.position[:, table.joints.index(self.robot.tree.joints[column])]
                around = np.interp([since - step, since, since + step], table.time, path)
                q[column], speed[column] = around[1], (around[2] - around[0]) / (2.0 * step)
        return q, speed

    def update(self, measurement: Measurement) -> Array:
        self._time = measurement.time
        q, speed = self._wanted()
        stiffness = self._limit / self.full
        error = stiffness * (q - measurement.joint_position)
        error += self.damping * stiffness * (speed - measurement.joint_velocity)
        return np.asarray(np.clip(self._held + error, -self._limit, self._limit))
