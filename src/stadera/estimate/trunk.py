"""What is believed of the trunk, payload included, and what can be believed of it at all."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stadera.errors import StaderaError
from stadera.inertia import InertialParameters
from stadera.robot.kinematics import foot_positions
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration

Array = NDArray[np.float64]

_LEAST_MASS_SHARE = 0.1  # of the prior trunk's mass
_MOST_MASS_SHARE = 2.0  # of the prior robot's mass, on top of the prior trunk
_HEIGHT_SHARE = 0.5  # of the height of the hips above the feet


class ImplausibleError(StaderaError):
    """A mass or centre of mass that a trunk cannot have."""


@dataclass(frozen=True, eq=False)
class TrunkModel:
    """Mass and centre of mass of the trunk with all that is fixed to it: what a controller reckons with.

    Attributes:
        mass: [kg], positive.
        com_trunk: (3,) [m], in the trunk frame.
        inertia_com: (3, 3) [kg·m²] about the centre of mass, trunk axes; None where not known.

    Raises:
        ImplausibleError: a value that is not finite, a mass that is not positive.
    """

    mass: float
    com_trunk: Array
    inertia_com: Array | None = None

    def __post_init__(self) -> None:
        com = np.array(self.com_trunk, dtype=float)
        if com.shape != (3,) or not np.isfinite(com).all():
            raise ImplausibleError(f"a trunk's centre of mass needs three finite numbers, got {self.com_trunk}")
        if not (np.isfinite(self.mass) and self.mass > 0):
            raise ImplausibleError(f"a trunk's mass must be positive and finite, got {self.mass} kg")
        com.flags.writeable = False
        object.__setattr__(self, "mass", float(self.mass))
        object.__setattr__(self, "com_trunk", com)

    @classmethod
    def of(cls, parameters: InertialParameters) -> TrunkModel:
        """From ten parameters in the trunk frame."""
        return cls(parameters.mass, parameters.com, parameters.inertia_com)

    @classmethod
    def prior(cls, robot: Robot) -> TrunkModel:
        """The trunk of the model file."""
        return cls.of(robot.inertias[robot.trunk])


@dataclass(frozen=True, eq=False)
class TrunkBounds:
    """What is plausible: a range of masses and a box for the centre of mass, trunk frame.

    Attributes:
        mass: (least, most) [kg].
        low, high: (3,) [m], opposite corners of the box.
    """

    mass: tuple[float, float]
    low: Array
    high: Array

    def __post_init__(self) -> None:
        ordered = np.all(np.asarray(self.low) < np.asarray(self.high)) and 0 < self.mass[0] < self.mass[1]
        if not ordered:
            raise ImplausibleError(f"bounds of a trunk need low < high, got {self.low}, {self.high}, {self.mass} kg")

    @classmethod
    def of(cls, robot: Robot) -> TrunkBounds:
        """From the model.

        The box: in x and y the rectangle of the feet of the nominal stance (a trunk balanced outside it could not
        stand), in z half the standing height above and below the hips. The mass: a tenth of the prior trunk up to
        that trunk with twice the robot's mass on it.
        """
        return _bounds_of(robot)

    def contains(self, model: TrunkModel) -> bool:
        """Whether mass and centre of mass lie inside."""
        return self.complaint(model) is None

    def complaint(self, model: TrunkModel) -> str | None:
        """What is implausible about it, in one sentence; None where nothing is."""
        if not self.mass[0] <= model.mass <= self.mass[1]:
            return f"trunk mass {model.mass:.3f} kg lies outside {self.mass[0]:.3f} to {self.mass[1]:.3f} kg"
        com = model.com_trunk
        for axis, value, low, high in zip("xyz", com, self.low, self.high, strict=True):
            if not low <= value <= high:
                return f"trunk centre of mass {axis} = {value:.4f} m lies outside {low:.4f} to {high:.4f} m"
        return None

    def check(self, model: TrunkModel) -> TrunkModel:
        """The model itself.

        Raises:
            ImplausibleError: it lies outside.
        """
        if (complaint := self.complaint(model)) is not None:
            raise ImplausibleError(complaint)
        return model


@lru_cache(maxsize=16)
def _bounds_of(robot: Robot) -> TrunkBounds:
    """Kept for the last robots, values that never change: every estimator and controller asks for its own."""
    feet = foot_positions(robot, standing_configuration(robot)[None])[0]
    hips = np.array([robot.tree.translations[robot.tree.joints.index(leg.joints[0])] for leg in robot.legs])
    level = float(hips[:, 2].mean())
    reach = _HEIGHT_SHARE * (level - float(feet[:, 2].mean()))
    prior = robot.inertias[robot.trunk].mass
    return TrunkBounds(
        mass=(_LEAST_MASS_SHARE * prior, prior + _MOST_MASS_SHARE * robot.mass),
        low=np.array([*feet[:, :2].min(axis=0), level - reach]),
        high=np.array([*feet[:, :2].max(axis=0), level + reach]),
    )
