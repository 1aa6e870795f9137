"""Posture of a robot in the world from encoders and IMU: poses of trunk and links, feet and their forces.

The tilt follows the direction of the specific force, stabilised over short times by the gyro (a complementary filter);
the heading comes from the gyro alone. The robot's position is not measured: the lowest foot is on the ground, below a
trunk that does not translate.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.robot.imu import ImuMount
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.samples import Samples
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.types import Array, Bools


@dataclass(frozen=True, eq=False)
class Posture:
    """Posture at one instant, world axes: z upwards, the ground at zero, origin below the trunk's."""

    time: float  # [s]
    rotation: Array  # (3, 3), of the trunk
    origin: Array  # (3,) [m], of the trunk
    rotations: Array  # (links, 3, 3), of all links, trunk first
    origins: Array  # (links, 3) [m], of all links
    contacts: Array  # (4, 3) [m]
    forces: Array  # (4, 3) [N], of the ground on the feet
    stance: Bools  # (4,), loaded feet


class Postures:
    """Tracks one robot's posture, every `period` [s]; the tilt follows the specific force with time constant `settling`
    [s].
    """

    def __init__(self, robot: Robot, settling: float = 1.0, period: float = 0.04) -> None:
        self._settling, self._period = settling, period
        self._robot, self._forces = robot, ContactForceEstimator(robot)
        self._world: Rotation | None = None  # of the trunk
        self._last, self._due, self._age = -np.inf, -np.inf, 0.0

    def of(self, samples: Samples, mount: ImuMount) -> Iterator[Posture]:
        """Yields the postures due among these samples, IMU values in trunk axes."""
        for k in range(len(samples)):
            time = float(samples.time[k])
            if time < self._last:  # restarted
                self._world, self._due, self._age = None, -np.inf, 0.0
            if time >= self._due:
                since = int(np.searchsorted(samples.time, self._last))
                self._turn(samples[slice(min(since, k), k + 1)])
                self._due = time + self._period
                yield self._posture(samples, k, mount)
        self._turn(samples[samples.time > self._last])

    def _turn(self, samples: Samples) -> None:
        """Updates the trunk's attitude with these samples."""
        if not len(samples):
            return
        force = samples.specific_force.mean(axis=0)
        elapsed = min(float(samples.time[-1]) - self._last, self._settling)
        if self._world is None:
            self._world = Rotation.align_vectors([[0.0, 0.0, 1.0]], [force])[0]
        else:
            turned = self._world * Rotation.from_rotvec(samples.angular_velocity.mean(axis=0) * elapsed)
            up = turned.apply(force / np.linalg.norm(force))
            self._age = min(self._age + elapsed, self._settling)  # at first the mean of all forces so far
            share = elapsed / self._age if self._age > 0.0 else 0.0
            self._world = Rotation.from_rotvec(share * np.cross(up, [0.0, 0.0, 1.0])) * turned
        self._last = float(samples.time[-1])

    def _posture(self, samples: Samples, k: int, mount: ImuMount) -> Posture:
        assert self._world is not None
        R = self._world.as_matrix()
        one = Measurement(
            float(samples.time[k]),
            samples.position[k],
            samples.velocity[k],
            samples.effort[k],
            samples.angular_velocity[k],
            samples.specific_force[k],
            lever=mount.translation,
        )
        found = self._forces.at(one)
        contacts = found.contact @ R.T
        lift = np.array([0.0, 0.0, -contacts[:, 2].min()])
        rotations, origins = forward_kinematics(self._robot.tree, samples.position[k : k + 1])
        forces = np.where(np.isfinite(found.force), found.force, 0.0) @ R.T
        return Posture(
            one.time, R, lift, R @ rotations[0], origins[0] @ R.T + lift, contacts + lift, forces, found.stance
        )
