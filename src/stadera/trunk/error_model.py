"""Errors of the model that rows are affected by: their names, places and prior covariance.

Aθ + C p = b with p zero for a robot that is as its model says; of sensors, p is what they give less what is true, of
the robot what is true less what the model has. Some of p are found from legs in the air
(`stadera.trunk.swing`); of the others only the covariance is known (Schmidt's consider parameters).
"""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from stadera.constants import GRAVITY
from stadera.robot.model import Robot
from stadera.trunk.settings import ModelErrors
from stadera.types import Array

_SIZES = {
    "rotor": 12,
    "viscous": 12,
    "coulomb": 12,
    "offset": 12,
    "torque_lag": 1,
    "gain": 12,
    "stiction": 12,
    "encoder": 12,
    "contact": 12,
    "link_mass": 12,
    "link_com": 36,
    "imu_lever": 3,
    "imu_rotation": 3,
    "accelerometer": 3,
    "velocity_lag": 1,
    "common_gain": 1,
    "regression": 3,
}


def _places() -> dict[str, slice]:
    out, start = {}, 0
    for name, size in _SIZES.items():
        out[name] = slice(start, start + size)
        start += size
    return out


PLACES = MappingProxyType(_places())
"""Where the errors are in p, by name. Twelve go by leg and joint; `link_com` by axis, leg and link; `contact` by leg
and axis of the trunk. `stiction` is what friction holds at standstill, `regression` what was taken from noisy angular
acceleration (`stadera.trunk.calibration`).
"""

ERRORS = sum(_SIZES.values())
JOINTS = slice(0, PLACES["torque_lag"].stop)
"""What a leg in the air tells: rotor inertia, viscous and Coulomb friction, offsets, and the torques' lag."""

INVISIBLE = ("common_gain", "regression")
"""Errors that no residual shows: they keep their prior size."""

HELD = 0.8
"""Of its Coulomb friction: standard deviation of what holds a joint at standstill, anything up to that friction."""

_SAGS = 0.9  # correlation of what holds joints of one kind


class ErrorModel:
    """Prior covariance of the errors of one robot.

    Args:
        robot: for its effort limits and sizes.
        sizes: standard deviations.

    Attributes:
        limit: (12,) effort limits by leg and joint [N·m]; where the model has none, the torque that holds the robot's
            weight on one stretched leg.
        covariance: (ERRORS, ERRORS).
    """

    def __init__(self, robot: Robot, sizes: ModelErrors, length: float) -> None:
        given = np.array([[robot.limits[joint].effort for joint in leg.joints] for leg in robot.legs]).ravel()
        largest = GRAVITY * robot.mass * length
        self.limit = np.where(given < 2.0 * largest, given, largest)
        leg_mass = sum(robot.inertias[link].mass for leg in robot.legs for link in leg.links) / 4.0
        std = np.zeros(ERRORS)
        std[PLACES["rotor"]] = sizes.rotor * leg_mass * length**2
        for name in ("viscous", "coulomb", "offset"):
            std[PLACES[name]] = getattr(sizes, name) * self.limit
        std[PLACES["stiction"]] = HELD * sizes.coulomb * self.limit
        for name in ("torque_lag", "gain", "encoder", "contact", "link_mass", "link_com", "imu_lever", "imu_rotation"):
            std[PLACES[name]] = getattr(sizes, name)
        for name in ("accelerometer", "velocity_lag", "common_gain"):
            std[PLACES[name]] = getattr(sizes, name)
        std[PLACES["regression"]] = 1.0
        correlation = np.eye(ERRORS)
        # a robot that sags under a load is held by all its knees alike
        alike = {"rotor": sizes.alike, "viscous": sizes.alike, "coulomb": sizes.alike, "stiction": _SAGS}
        for name, shared in alike.items():
            start = PLACES[name].start
            for joint in range(3):
                kind = start + joint + 3 * np.arange(4)
                correlation[np.ix_(kind, kind)] = shared + (1.0 - shared) * np.eye(4)
        self.covariance: Array = correlation * np.outer(std, std)
        self.visible = np.ones(ERRORS, dtype=bool)
        for name in INVISIBLE:
            self.visible[PLACES[name]] = False
