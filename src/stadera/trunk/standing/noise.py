"""Sizes of the errors of joint torques and foot positions, from which the covariance of contact forces is computed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import ModelError
from stadera.robot.model import Leg, Robot
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class ForceNoise:
    """Standard deviations of torques and feet. "Constant" errors do not average out over a run.

    Attributes:
        torque_white, torque_constant: (4, 3) [N·m], by leg and joint.
        foot_position: [m], of each component of a foot's position in the trunk frame, constant.
        leg_mass: relative error of the mass of a leg's link, constant.
        repeatable: residual of a pose at rest, as a share of the robot's weight, moments at 1 m. Assumed.

    Raises:
        ModelError: wrong shape, or a value that is negative or not finite.
    """

    torque_white: Array
    torque_constant: Array
    foot_position: float = 0.0
    leg_mass: float = 0.0
    repeatable: float = 1e-4

    def __post_init__(self) -> None:
        for name in ("torque_white", "torque_constant", "foot_position", "leg_mass", "repeatable"):
            value = np.asarray(getattr(self, name), dtype=float)
            if not (np.isfinite(value).all() and (value >= 0).all()):
                raise ModelError(f"force noise {name!r} must be finite and not negative")
            if name.startswith("torque") and value.shape != (4, 3):
                raise ModelError(f"force noise {name!r} needs shape (4, 3), got {value.shape}")

    @classmethod
    def of(
        cls,
        robot: Robot,
        white: float = 0.0033,
        constant: float = 0.0033,
        foot_position: float = 0.0,
        leg_mass: float = 0.02,
        lever: float = 0.5,
    ) -> ForceNoise:
        """Torque noise as shares of the joints' effort limits.

        Static friction of a joint at rest lies anywhere within its Coulomb friction ± τ_c: τ_c / √3 is added to the
        constant part. A joint without effort limit is treated as one made to carry half the robot's weight at
        `lever` [m].
        """
        fallback = 0.5 * robot.mass * GRAVITY * lever

        def limits(leg: Leg) -> list[float]:
            efforts = [robot.limits[joint].effort for joint in leg.joints]
            return [effort if np.isfinite(effort) else fallback for effort in efforts]

        limit = np.array([limits(leg) for leg in robot.legs])
        coulomb = np.array([[robot.dynamics[joint].coulomb for joint in leg.joints] for leg in robot.legs])
        return cls(white * limit, np.hypot(constant * limit, coulomb / np.sqrt(3.0)), foot_position, leg_mass)
