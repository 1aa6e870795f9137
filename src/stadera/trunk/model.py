"""Mass and centre of mass of the trunk, payload included, and the range in which they are plausible."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stadera.body import Body, Motion
from stadera.errors import StaderaError, positive
from stadera.inertia import InertialParameters
from stadera.robot.model import Robot
from stadera.robot.stance import nominal_feet
from stadera.types import Array


class ImplausibleError(StaderaError):
    """The mass or centre of mass is impossible for a trunk."""


@dataclass(frozen=True, eq=False)
class TrunkModel:
    """Mass and centre of mass of the trunk with everything fixed to it, as used by controllers.

    Attributes:
        mass: [kg], positive.
        com_trunk: (3,) [m], in the trunk frame.
        inertia_com: (3, 3) [kg·m²] about the centre of mass, trunk axes; None where not known.

    Raises:
        ImplausibleError: a value is not finite, or the mass is not positive.
    """

    mass: float
    com_trunk: Array
    inertia_com: Array | None = None

    def __post_init__(self) -> None:
        com = np.array(self.com_trunk, dtype=float)
        if com.shape != (3,) or not np.isfinite(com).all():
            raise ImplausibleError(f"a trunk's centre of mass needs three finite numbers, got {self.com_trunk}")
        positive("a trunk's mass", self.mass, "kg", ImplausibleError)
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
    """Bounds for a plausible trunk: a range of masses and a box for the centre of mass, trunk frame.

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
    @lru_cache(maxsize=16)
    def of(cls, robot: Robot) -> TrunkBounds:
        """Computes the bounds from the robot's model.

        In x and y the box is the rectangle of the feet in the nominal stance (a trunk balanced outside it could not
        stand), of other robots than quadrupeds in the model's zero pose and wider by a quarter of a leg, in z half the
        standing height above and below the hips, or above the model's centre of mass where it is not a quadruped's: a
        box on the back of a G1 raises its centre, 0.14 m above the hips without, to 0.25 m. The mass ranges from a
        tenth of the prior trunk to the prior trunk plus twice the robot's mass.
        """
        feet, hips = _feet_of(robot), robot.hips
        level = float(hips[:, 2].mean())
        reach = 0.5 * (level - float(feet[:, 2].mean()))
        prior = robot.inertias[robot.trunk]
        top = level if robot.quadruped else max(level, float(prior.com[2]))
        return cls(
            mass=(0.1 * prior.mass, prior.mass + 2.0 * robot.mass),
            low=np.array([*feet[:, :2].min(axis=0), level - reach]),
            high=np.array([*feet[:, :2].max(axis=0), top + reach]),
        )

    @property
    def spread(self) -> Array:
        """Standard deviations (4,) of mass [kg] and centre of mass [m] for uniform distributions over the bounds."""
        ranges = [self.mass[1] - self.mass[0], *(np.asarray(self.high) - np.asarray(self.low))]
        return np.asarray(np.array(ranges) / np.sqrt(12.0))

    def complaint(self, model: TrunkModel) -> str | None:
        """One sentence on why the model is implausible; None if it is plausible."""
        if not self.mass[0] <= model.mass <= self.mass[1]:
            return f"trunk mass {model.mass:.3f} kg lies outside {self.mass[0]:.3f} to {self.mass[1]:.3f} kg"
        com = model.com_trunk
        for axis, value, low, high in zip("xyz", com, self.low, self.high, strict=True):
            if not low <= value <= high:
                return f"trunk centre of mass {axis} = {value:.4f} m lies outside {low:.4f} to {high:.4f} m"
        return None

    def check(self, model: TrunkModel) -> TrunkModel:
        """Returns the model unchanged if it is plausible.

        Raises:
            ImplausibleError: it is outside the bounds.
        """
        if (complaint := self.complaint(model)) is not None:
            raise ImplausibleError(complaint)
        return model


def _feet_of(robot: Robot) -> Array:
    """Feet in a stance (k, 3) [m]; of other robots than quadrupeds the corners of a wider rectangle."""
    if robot.quadruped:
        return nominal_feet(robot)
    still, rest, up = np.zeros((1, len(robot.tree.joints))), np.zeros((1, 3)), np.array([0.0, 0.0, 1.0])
    feet = Body.of(robot, others=False).at(Motion(still, still, still, rest, rest, rest, up)).feet[0]
    wide = 0.25 * robot.leg_length * np.array([1.0, 1.0, 0.0])
    return np.concatenate([feet - wide, feet + wide])
