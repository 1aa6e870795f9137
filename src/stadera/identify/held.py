"""Is the trunk held, and are the legs in the air? The vertical of a held trunk, and the load on each foot in a log.

The vertical comes from the IMU if there is one. Feet must carry nearly nothing while legs are identified in free swing.
Their forces are those of a robot at rest, averaged over the log: accelerations and friction cancel over a motion that
stays in place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.body import Body, Motion
from stadera.constants import GRAVITY, SINGULAR
from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class TrunkUp:
    """The vertical in trunk axes (3,), a sentence on its source, and how fast the trunk turns (rms) [rad/s]."""

    up: Array
    note: str
    turning: float = 0.0


def vertical_of(recording: Recording, robot: Robot, up: tuple[float, float, float] | None) -> TrunkUp:
    """The given vertical, else the mean specific force in a log's IMU, else the trunk's z axis. UnknownNameError for an
    IMU frame that the robot lacks, ModelError for one that is fixed to a leg.
    """
    if up is not None:
        return TrunkUp(np.asarray(up, dtype=float), f"vertical given: ({up[0]:g}, {up[1]:g}, {up[2]:g}) in trunk axes")
    imu = recording.imu
    if imu is None:
        return TrunkUp(np.array([0.0, 0.0, 1.0]), "no IMU in the log and no vertical given: trunk taken as level")
    mean = ImuMount.of(robot, imu.frame).rotation @ imu.linear_acceleration.mean(axis=0)
    turning = float(np.sqrt(np.mean(np.sum(imu.angular_velocity**2, axis=1))))
    tilt = np.degrees(np.arccos(np.clip(mean[2] / np.linalg.norm(mean), -1.0, 1.0)))
    return TrunkUp(mean, f"vertical from the IMU: trunk tilted by {tilt:.1f}°", turning)


def carried_shares(recording: Recording, robot: Robot, up: Array, samples: int = 4000) -> dict[str, float]:
    """Mean upward force on each foot of a recorded leg as a share of the robot's weight, of postures in which the leg
    is not near-singular; `up` (3,) is the vertical in trunk axes. A log of more than `samples` is thinned out.
    """
    body, joints = Body.of(robot, others=False), robot.tree.joints
    thin = slice(None, None, -(-len(recording) // samples))
    position, effort = np.zeros((2, len(recording.time[thin]), len(joints)))
    recorded = [leg for leg in robot.legs if set(leg.joints) <= set(recording.joints)]
    for leg in recorded:
        columns = [joints.index(joint) for joint in leg.joints]
        position[:, columns], effort[:, columns] = (
            recording.channel(name, leg.joints)[thin] for name in ("position", "effort")
        )
    vertical = up / np.linalg.norm(up)
    still, rest = np.zeros_like(position), np.zeros((len(position), 3))
    state = body.at(Motion(position, still, still, rest, rest, rest + GRAVITY * vertical, vertical))
    with np.errstate(invalid="ignore"):  # of legs so stretched that they feel nothing, left out below
        force = body.forces(state, (state.torque - effort)[:, body.in_legs]) @ vertical / (robot.mass * GRAVITY)
    felt = np.abs(state.volume) > SINGULAR * robot.leg_length**3
    loads = np.where(felt, force, 0.0).sum(axis=0) / np.maximum(felt.sum(axis=0), 1)
    return {leg.name: float(loads[robot.legs.index(leg)]) for leg in recorded}
