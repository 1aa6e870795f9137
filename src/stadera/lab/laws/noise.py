"""Contact forces with the noise of torques and feet that weights what the laws learn from them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import ModelError
from stadera.robot.model import Robot
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class ForceNoise:
    """Standard deviations of torques and feet. "Constant" errors do not average out over a run.

    Attributes:
        torque_white, torque_constant: (J,) [N·m], of the legs' joints, leg by leg and outwards.
        foot_position: [m], of each component of a foot's position in the trunk frame, constant.
        leg_mass: relative error of the mass of a leg's link, constant.
        repeatable: residual of a pose at rest, as a share of the robot's weight, moments at 1 m. Assumed.

    Raises:
        ModelError: torques of different shapes, or a value that is negative or not finite.
    """

    torque_white: Array
    torque_constant: Array
    foot_position: float = 0.0
    leg_mass: float = 0.0
    repeatable: float = 1e-4

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = np.asarray(getattr(self, name), dtype=float)
            if not (np.isfinite(value).all() and (value >= 0).all()):
                raise ModelError(f"force noise {name!r} must be finite and not negative")
            if name.startswith("torque") and (value.ndim != 1 or value.shape != np.shape(self.torque_white)):
                raise ModelError(f"force noise {name!r} needs one value for each joint of the legs, got {value.shape}")

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
        joints = [joint for leg in robot.legs for joint in leg.joints]
        limit = np.array([robot.limits[joint].effort for joint in joints])
        limit = np.where(np.isfinite(limit), limit, 0.5 * robot.mass * GRAVITY * lever)
        coulomb = np.array([robot.dynamics[joint].coulomb for joint in joints])
        return cls(white * limit, np.hypot(constant * limit, coulomb / np.sqrt(3.0)), foot_position, leg_mass)


class NoisyForces(ContactForceEstimator):
    """Contact forces; `noise` of torques and feet, None for the default shares of the effort limits."""

    def __init__(self, robot: Robot, noise: ForceNoise | None = None) -> None:
        super().__init__(robot)
        self.noise = noise or ForceNoise.of(robot)
