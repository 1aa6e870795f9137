"""Model and sensor errors that affect the rows: their names, indices and prior covariance.

The rows are Aθ + C p = b with p = 0 if the robot equals its model. For sensors p is the reading minus the true value,
for the robot the true value minus the model's. Most of p is estimated from legs in the air (`stadera.trunk.swing`) and
from loaded ones (`stadera.trunk.joint_errors`); of the rest only the covariance is used (Schmidt's consider
parameters).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from stadera.constants import GRAVITY
from stadera.legs.friction import JointFriction
from stadera.robot.model import JointDynamics, Robot
from stadera.trunk.settings import ModelErrors
from stadera.types import Array, Bools

_SIZES = {
    "rotor": 12,
    "viscous": 12,
    "coulomb": 12,
    "torque_lag": 1,
    "offset": 12,
    "gain": 12,
    "encoder": 12,
    "contact": 12,
    "link_mass": 12,
    "link_com": 36,
    "imu_lever": 3,
    "imu_rotation": 3,
    "accelerometer": 3,
    "imu_response": 3,
    "velocity_lag": 1,
    "stiction": 12,
    "common_gain": 1,
    "regression": 3,
    "sampling": 1,
}


def _places() -> dict[str, slice]:
    out, start = {}, 0
    for name, size in _SIZES.items():
        out[name] = slice(start, start + size)
        start += size
    return out


PLACES = MappingProxyType(_places())
"""Index ranges of the errors in p, by name. Entries of twelve go by leg and joint; `link_com` by axis, leg and link;
`contact` by leg and trunk axis. `stiction` is the torque of static friction, `regression` the part removed from noisy
angular acceleration (`stadera.trunk.calibration`), `sampling` half the difference between rows of every other sample.
"""

ERRORS = sum(_SIZES.values())
JOINTS = slice(0, PLACES["offset"].stop)
"""Errors that legs in the air determine: these and offsets."""

LEARNT = slice(0, PLACES["velocity_lag"].stop)
"""Errors that are estimated together with the trunk (`stadera.trunk.joint_errors`). Of all others the mean is zero."""

STICKING = PLACES["stiction"]
"""Static friction. Before any row, only these errors and those in `JOINTS` are correlated among each other."""

INVISIBLE = ("common_gain", "regression", "sampling")
"""Errors that no residual shows, or whose size the log shows directly; they keep their prior size."""

_AS_STATED = (
    "torque_lag",
    "gain",
    "encoder",
    "contact",
    "link_mass",
    "link_com",
    "imu_lever",
    "imu_rotation",
    "accelerometer",
    "imu_response",
    "velocity_lag",
    "common_gain",
)
"""Errors whose standard deviations are those of `ModelErrors`, in the same unit."""


def _identified(robot: Robot, sizes: ModelErrors, limit: Array) -> dict[str, Array]:
    """Standard deviations (12,) of the terms of identified joints, by error: those of the identification, and what
    changes from log to log, in squares. NaN where there are none.
    """
    joints, none = [joint for leg in robot.legs for joint in leg.joints], JointDynamics(*[np.nan] * 4)
    values, stds = (
        np.array([(d.armature, d.viscous, d.coulomb, d.offset) for d in found]).T
        for found in ([robot.dynamics[j] for j in joints], [robot.dynamics_std.get(j, none) for j in joints])
    )
    friction = sizes.friction_drift
    drift = (sizes.rotor_drift * values[0], friction * values[1], friction * values[2], sizes.offset_drift * limit)
    names = ("rotor", "viscous", "coulomb", "offset")
    return {name: np.hypot(std, change) for name, std, change in zip(names, stds, drift, strict=True)}


class ErrorModel:
    """Prior covariance of one robot's model errors.

    Args:
        robot: provides effort limits and sizes.
        sizes: standard deviations.

    Attributes:
        limit: (12,) effort limits by leg and joint [N·m]; where the model has none, the torque that carries the robot's
            weight on one stretched leg.
        dry: (12,) Coulomb friction that the robot's model has [N·m]; the errors are beyond it, static friction is not.
        by_load: friction that grows with the torque carried, of a joint that carries a quarter of the robot [N·m].
        covariance: (ERRORS, ERRORS).
        length: of a leg [m].
        held: `ModelErrors.held`.
    """

    def __init__(self, robot: Robot, sizes: ModelErrors, length: float) -> None:
        given = np.array([[robot.limits[joint].effort for joint in leg.joints] for leg in robot.legs]).ravel()
        self.length, self.held = length, sizes.held
        largest = GRAVITY * robot.mass * length
        self.limit = np.where(given < 2.0 * largest, given, largest)
        leg_mass = sum(robot.inertias[link].mass for leg in robot.legs for link in leg.links) / 4.0
        std = np.zeros(ERRORS)
        std[PLACES["rotor"]] = sizes.rotor * leg_mass * length**2
        for name in ("viscous", "coulomb", "offset"):
            std[PLACES[name]] = getattr(sizes, name) * self.limit
        known = _identified(robot, sizes, self.limit)
        for name, own in known.items():
            place = PLACES[name]
            least = np.maximum(own, sizes.surest * std[place])
            std[place] = np.fmin(std[place], least)  # as it was for a joint or term that was not identified, NaN
        self.dry = np.abs(JointFriction.of(robot).coulomb).ravel()
        # on a leg bent to 80 % of its length, the foot below the hip, the knee is off the line by 0.3 of the length
        self.by_load = sizes.load_friction * 0.25 * 0.3 * largest
        std[PLACES["stiction"]] = sizes.held * np.hypot(self.dry, std[PLACES["coulomb"]])
        for name in _AS_STATED:
            std[PLACES[name]] = getattr(sizes, name)
        std[PLACES["regression"]] = std[PLACES["sampling"]] = 1.0
        alike = {"rotor": sizes.alike, "viscous": sizes.alike, "coulomb": sizes.alike, "stiction": sizes.sagging}
        found = {name: np.isfinite(own) for name, own in known.items()}
        self.covariance: Array = _correlation(alike, found | {"stiction": found["coulomb"]}) * np.outer(std, std)
        self.variance, self._sticking = np.diag(self.covariance).copy(), self.covariance[STICKING, STICKING].copy()
        self._invisible = np.zeros(ERRORS)
        for name in INVISIBLE:
            self._invisible[PLACES[name]] = self.variance[PLACES[name]]
        self._visible = self.variance - self._invisible

    def scaled(self, scale: float) -> tuple[Array, Array]:
        """Covariance of static friction (12, 12) and variances (ERRORS,) with all standard deviations but the invisible
        ones multiplied by `scale`.
        """
        return scale**2 * self._sticking, scale**2 * self._visible + self._invisible


def _correlation(alike: Mapping[str, float], known: Mapping[str, Bools]) -> Array:
    """Correlation matrix (ERRORS, ERRORS) of errors that are alike, by name, in the four legs' joints of one kind.

    Errors of identified joints, `known` (12,) by name, are changes since the identification; those of other joints are
    differences from the model file, which these tell nothing about.
    """
    correlation = np.eye(ERRORS)
    for name, shared in alike.items():
        for joint in range(3):
            kind = PLACES[name].start + joint + 3 * np.arange(4)
            own = known[name][joint::3]
            correlation[np.ix_(kind, kind)] = np.where(own[:, None] == own, shared, 0.0) + (1.0 - shared) * np.eye(4)
    return correlation
