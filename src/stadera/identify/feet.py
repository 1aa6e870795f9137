"""Estimates the load on each foot in a log, which must be nearly zero while legs are identified in free swing.

The forces are those of a robot at rest (`LegModel.forces_at_rest`), averaged over the log: accelerations and friction
cancel over a motion that stays in place.
"""

from __future__ import annotations

import numpy as np

from stadera.constants import GRAVITY
from stadera.legs.model import LegModel
from stadera.logs.recording import Recording
from stadera.robot.model import Robot
from stadera.types import Array


def carried_shares(recording: Recording, robot: Robot, up: Array, samples: int = 4000) -> dict[str, float]:
    """Mean upward force on each foot as a share of the robot's weight.

    Args:
        recording: positions and efforts of the legs' joints; legs that are not recorded are skipped.
        robot: the model.
        up: (3,), the vertical in trunk axes, of any length.
        samples: number to which a longer log is thinned out.
    """
    model, joints = LegModel.of(robot), robot.tree.joints
    thin = slice(None, None, -(-len(recording) // samples))
    position, effort = np.zeros((2, len(recording.time[thin]), len(joints)))
    recorded = [leg for leg in robot.legs if set(leg.joints) <= set(recording.joints)]
    for leg in recorded:
        columns = [joints.index(joint) for joint in leg.joints]
        position[:, columns], effort[:, columns] = (
            recording.channel(name, leg.joints)[thin] for name in ("position", "effort")
        )
    vertical = up / np.linalg.norm(up)
    held = np.tile(GRAVITY * vertical, (len(position), 1))
    force, _ = model.forces_at_rest(position[:, model.columns], effort[:, model.columns], held)
    loads = force.mean(axis=0) @ vertical / (robot.mass * GRAVITY)
    return {leg.name: float(loads[robot.legs.index(leg)]) for leg in recorded}
