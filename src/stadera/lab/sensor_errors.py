"""Named sets of sizes of sensor errors, and of errors of the estimator's model."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from stadera.errors import ModelError, require_known


@dataclass(frozen=True)
class Gaussian:
    """A Gaussian error of every component, drawn once a run or for every sample."""

    mean: float = 0.0  # in the unit of the perturbed quantity
    std: float = 0.0  # likewise
    drawn: Literal["run", "sample"] = "run"  # "run" for a constant error, "sample" for a white one

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mean) and np.isfinite(self.std) and self.std >= 0):
            raise ModelError(f"a Gaussian error needs a finite mean and std ≥ 0, got {self.mean}, {self.std}")
        require_known("draw of a Gaussian error", (self.drawn,), ("run", "sample"))

    @property
    def is_zero(self) -> bool:
        """True if it adds nothing."""
        return self.mean == 0.0 and self.std == 0.0


@dataclass(frozen=True)
class SensorErrors:
    """Sizes of the errors, one standard deviation unless stated otherwise. "Constant" ones are drawn once a run."""

    position: float = 0.0  # white [rad]
    velocity: float = 0.0  # white [rad/s]
    torque: float = 0.0  # white, as a share of the joint's effort limit
    torque_constant: float = 0.0  # constant, likewise
    torque_delay: float = 0.0  # [s], of the measured torques
    gyro: float = 0.0  # white [rad/s]
    gyro_constant: float = 0.0  # constant [rad/s]
    accelerometer: float = 0.0  # white [m/s²]
    accelerometer_constant: float = 0.0  # constant [m/s²]
    orientation_constant: float = 0.0  # of each component of a rotation vector, in the IMU frame [rad]
    imu_misalignment: float = 0.0  # exact angle of the IMU's misalignment, about a random axis [rad]
    torque_offset: Gaussian = Gaussian()  # of every joint's torque [N·m] (Table IV)
    foot_position: Gaussian = Gaussian()  # of every component of the feet's positions in the trunk frame [m] (Table IV)
    friction: float = 0.0  # Coulomb friction in the plant's joints, as a share of the effort limit (exact)
    friction_known: float = 0.0  # relative error of the friction in the estimator's model
    leg_mass: float = 0.0  # relative error of the leg links' masses in the estimator's model
    leg_com: float = 0.0  # error of each component of their centres of mass [m]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float | int) and not (np.isfinite(value) and value >= 0):
                raise ModelError(f"sensor error {field.name!r} must be finite and not negative, got {value}")

    def times(self, factor: float) -> SensorErrors:
        """All sizes multiplied by a factor, except for those of a Gaussian."""
        sizes: dict[str, Any] = {name: factor * size for name, size in vars(self).items() if isinstance(size, float)}
        return replace(self, **sizes)


IDEAL = SensorErrors()
"""No errors at all."""

STANDARD = SensorErrors(
    position=2e-4,
    velocity=0.02,
    torque=0.0033,
    torque_constant=0.0033,
    gyro=0.003,
    gyro_constant=0.002,
    accelerometer=0.05,
    accelerometer_constant=0.03,
    orientation_constant=np.deg2rad(0.2),
)
"""Encoders, torque sensors and an IMU of good robots."""

HARSH = replace(
    STANDARD.times(2.0),
    torque_delay=0.003,
    imu_misalignment=np.deg2rad(0.5),
    friction=0.006,
    friction_known=0.2,
    leg_mass=0.05,
    leg_com=0.005,
)
"""Twice `STANDARD`, with late torques, joint friction, a misaligned IMU and a wrong model of the legs."""

ERROR_SETS = {"ideal": IDEAL, "standard": STANDARD, "harsh": HARSH}


def sensor_errors(name: str) -> SensorErrors:
    """The named set: ideal, standard or harsh."""
    require_known("set of sensor errors", (name.lower(),), ERROR_SETS)
    return ERROR_SETS[name.lower()]
