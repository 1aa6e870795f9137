"""What the walking estimator takes its sensors' errors to be."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from stadera.errors import ModelError
from stadera.estimate.noise import ForceNoise
from stadera.robot.model import Robot

Array = NDArray[np.float64]

_MODEL = ("link_mass", "link_com", "friction")
_KNOWN_SOLE, _UNKNOWN_SOLE = 1e-3, 5e-3  # m


@dataclass(frozen=True, eq=False)
class WalkingNoise:
    """Standard deviations. White errors are new in every sample; constant ones stay over the run and are unknowns.

    Attributes:
        torque, torque_constant: (4, 3) [N·m], by leg and joint.
        joint_position: white [rad].
        joint_velocity: white [rad/s].
        gyro: white [rad/s].
        accelerometer, accelerometer_constant: [m/s²], each axis.
        torque_lag: by how much torques may arrive later or earlier than they are thought to [s].
        velocity_lag: by how much velocities' differences may come late or early, likewise [s].
        sole: by how much further from the feet's centres the ground may touch than the model's radius says [m].
        torque_gain: of each joint's torque, as a share of it; not sought, but in the error bars.
        link_mass: of the legs' links, each as a share of its mass, likewise.
        link_com: of their centres of mass, each component, likewise [m].
        friction: of the joints' Coulomb friction, each as a share of it, likewise.

    Raises:
        ModelError: a wrong shape, a value that is not positive and finite.
    """

    torque: Array
    torque_constant: Array
    joint_position: float = 2e-4
    joint_velocity: float = 0.02
    gyro: float = 0.003
    accelerometer: float = 0.05
    accelerometer_constant: float = 0.03
    torque_lag: float = 5e-4
    velocity_lag: float = 5e-4
    sole: float = 1e-3
    torque_gain: float = 2e-3
    link_mass: float = 0.0
    link_com: float = 0.0
    friction: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = np.asarray(getattr(self, field.name), dtype=float)
            if field.name in ("torque", "torque_constant") and value.shape != (4, 3):
                raise ModelError(f"walking noise {field.name!r} needs shape (4, 3), got {value.shape}")
            if not (np.isfinite(value).all() and (value > 0).all()) and not (
                field.name in ("torque_gain", *_MODEL) and value == 0
            ):
                raise ModelError(f"walking noise {field.name!r} must be positive and finite, got {value}")

    @property
    def doubts_model(self) -> bool:
        """Whether errors of the legs' model are to be in the error bars."""
        return any(getattr(self, name) > 0 for name in _MODEL)

    @classmethod
    def of(cls, robot: Robot, scale: float = 1.0, torque_lag: float = 5e-4) -> WalkingNoise:
        """As good robots have them: torques to 0.33 % of the joints' limits, white and constant, the rest as above.

        Args:
            robot: for its limits; half of its joints' Coulomb friction counts into the constant part. Where it does
                not know its feet's radius, their soles may lie anywhere within some millimetres.
            scale: of all of them but lags, soles and gains.
        """
        share = ForceNoise.of(robot, 0.0033 * scale, 0.0033 * scale)
        return cls(
            share.torque_white,
            share.torque_constant,
            joint_position=2e-4 * scale,
            joint_velocity=0.02 * scale,
            gyro=0.003 * scale,
            accelerometer=0.05 * scale,
            accelerometer_constant=0.03 * scale,
            torque_lag=torque_lag,
            sole=_KNOWN_SOLE if all(leg.foot_radius for leg in robot.legs) else _UNKNOWN_SOLE,
        )

    def with_model(self, link_mass: float, link_com: float, friction: float) -> WalkingNoise:
        """With a model of legs and joints that is off by so much: see the attributes."""
        return replace(self, link_mass=link_mass, link_com=link_com, friction=friction)
