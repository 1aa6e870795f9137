"""Mass and centre of mass of the trunk, payload included, and their plausible range."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stadera.errors import StaderaError
from stadera.inertia import InertialParameters
from stadera.legs.model import foot_positions
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array


class ImplausibleError(StaderaError):
    """A mass or centre of mass that a trunk cannot have."""


@dataclass(frozen=True, eq=False)
class TrunkModel:
    """Mass and centre of mass of the trunk with all that is fixed to it: what a controller works with.

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


@dataclass(frozen=True)
class PlausibleRange:
    """How far a trunk may be from the model's.

    Attributes:
        least_mass: share of the model's trunk.
        most_load: of the model's robot, on top of the trunk.
        height: of the centre of mass above and below the hips, as a share of their height above the feet.
    """

    least_mass: float = 0.1
    most_load: float = 2.0
    height: float = 0.5


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
    def of(cls, robot: Robot, plausible: PlausibleRange | None = None) -> TrunkBounds:
        """From the model, made once a robot.

        The box: in x and y the rectangle of the feet of the nominal stance (a trunk balanced outside it could not
        stand), in z half the standing height above and below the hips. The mass: a tenth of the prior trunk up to
        that trunk with twice the robot's mass on it.
        """
        return _bounds_of(robot, plausible or PlausibleRange())

    @property
    def spread(self) -> Array:
        """(4,): standard deviations of mass [kg] and centre of mass [m] spread evenly over what is plausible."""
        ranges = [self.mass[1] - self.mass[0], *(np.asarray(self.high) - np.asarray(self.low))]
        return np.asarray(np.array(ranges) / np.sqrt(12.0))

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
def _bounds_of(robot: Robot, plausible: PlausibleRange) -> TrunkBounds:
    feet = foot_positions(robot, standing_configuration(robot)[None])[0]
    hips = np.array([robot.tree.translations[robot.tree.joints.index(leg.joints[0])] for leg in robot.legs])
    level = float(hips[:, 2].mean())
    reach = plausible.height * (level - float(feet[:, 2].mean()))
    prior = robot.inertias[robot.trunk].mass
    return TrunkBounds(
        mass=(plausible.least_mass * prior, prior + plausible.most_load * robot.mass),
        low=np.array([*feet[:, :2].min(axis=0), level - reach]),
        high=np.array([*feet[:, :2].max(axis=0), level + reach]),
    )
