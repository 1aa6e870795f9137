"""Two logs of a HyQ, quickly made: legs that swing on a held trunk, and a walk with a load that comes onto its back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stadera.inertia import InertialParameters
from stadera.lab.plant.leg import simulate_leg
from stadera.lab.plant.sensors import STANDARD
from stadera.logs import Recording, write_table
from stadera.robot import load_robot
from walking import Walk, recorded, walked

LOAD = InertialParameters.from_com(8.0, [0.1, 0.0, 0.2], 0.1 * np.eye(3))


class Swing:
    """Three joints on sinusoids about a middle (3,) [rad]."""

    def __init__(self, middle: np.ndarray, seconds: float = 5.0) -> None:
        self.time = np.arange(0.0, seconds, 0.004)
        speed = 2 * np.pi * np.array([0.5, 0.7, 0.9])
        angle = speed * self.time[:, None] + np.array([0.0, 1.0, 2.0])
        self.position, self.velocity = middle + 0.3 * np.sin(angle), 0.3 * speed * np.cos(angle)


def swing_log(path: Path) -> Path:
    """The four legs for five seconds at 250 Hz, without sensor errors."""
    robot = load_robot("hyq")
    legs = []
    for leg in robot.legs:
        limits = [robot.limits[joint] for joint in leg.joints]
        middle = np.array([(limit.lower + limit.upper) / 2 for limit in limits])
        legs.append(simulate_leg(robot, leg.name, Swing(middle)))
    whole = Recording(
        time=legs[0].time,
        joints=tuple(joint for leg in legs for joint in leg.joints),
        position=np.hstack([leg.position for leg in legs]),
        effort=np.hstack([leg.effort for leg in legs]),
    )
    return write_table(whole, path)


def walk_log(path: Path) -> Path:
    """4.5 s at 250 Hz with sensor errors; `LOAD` comes at 2.7 s."""
    robot = load_robot("hyq")
    motion = walked(robot, Walk(seconds=4.5, rate_hz=250.0, load=LOAD, loaded_at=2.7))
    return write_table(recorded(robot, motion, STANDARD, 0), path)
