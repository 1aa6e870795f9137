"""Result of the estimator for motion: the trunk's ten parameters, their errors, and which of them were observed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stadera.inertia import InertialParameters
from stadera.trunk.load import TENSOR, centre_slope, described, mass_quantity, plain, quantity
from stadera.types import Array, Bools


@dataclass(frozen=True)
class ObservedLimits:
    """Standard deviations above which a quantity counts as not observed.

    Attributes:
        mass: share of the robot's mass [1]. com: share of the leg's length [1].
        inertia: share of the robot's mass times squared leg length [1].
        least_spread: least second moment of a body, share of its mass times squared leg length [1].
    """

    mass: float = 0.2
    com: float = 0.1
    inertia: float = 0.02
    least_spread: float = 1e-4

    def centre(self, robot_mass: float, length: float) -> Array:
        """Limits for mass and centre of mass, (4,) [kg, m]."""
        return np.array([self.mass * robot_mass, *[self.com * length] * 3])


@dataclass(frozen=True, eq=False)
class TrunkParameters:
    """Parameters of the trunk, payload included, trunk frame.

    Attributes:
        inertial: physically possible; components that were not observed are the prior's.
        covariance: (4, 4), of mass [kg] and centre of mass [m]; NaN where not observed.
        inertia_std: (6,) [kg·m²], of Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the trunk's origin; NaN where not observed.
        observed: (10,) bool, for mass, the three components of the centre of mass, and the six of the inertia (all or
            none).
        mass_std_without_scale: as of `Payload` [kg].
    """

    inertial: InertialParameters
    covariance: Array
    inertia_std: Array
    observed: Bools
    mass_std_without_scale: float | None = None

    def __repr__(self) -> str:
        return described(self, self.inertial.mass)

    @property
    def mass_std(self) -> float:
        """Standard deviation of the mass [kg], NaN where not observed."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def com(self) -> Array:
        """Centre of mass, (3,) [m], NaN where not observed."""
        return np.where(np.isnan(self.com_std), np.nan, self.inertial.com)

    @property
    def com_std(self) -> Array:
        """Standard deviation of the centre of mass, (3,) [m], NaN where not observed."""
        return np.sqrt(np.diag(self.covariance)[1:])

    def to_dict(self, mark: dict[str, bool]) -> dict[str, Any]:
        """Plain values for JSON; `mark` is added to mass and centre of mass."""
        std = self.inertia_std if self.observed[4:].all() else np.full(6, np.nan)
        return {
            "mass": mass_quantity(self.inertial.mass, self.mass_std, self.mass_std_without_scale) | mark,
            "com": {"value": plain(self.com), "std": plain(self.com_std)} | mark,
            "inertia": {n: quantity(v, s) for n, v, s in zip(TENSOR, self.inertial.vector[4:], std, strict=True)},
        }

    @classmethod
    def of(
        cls, vector: Array, covariance: Array, prior: InertialParameters, robot_mass: float, length: float
    ) -> TrunkParameters:
        """Computes the result from the ten parameters (10,) and their covariance (10, 10). The prior replaces
        components that were not observed.
        """
        limits = ObservedLimits()
        if not vector[0] > 0.0:
            return cls.unobserved(prior)
        slope = centre_slope(vector[:4])
        centre = slope @ covariance[:4, :4] @ slope.T
        observed = np.sqrt(centre.diagonal()) < limits.centre(robot_mass, length)
        value = vector[:4] / vector[0]
        value[0] = vector[0]
        if not observed.all():
            centre[~observed, :] = centre[:, ~observed] = np.nan
            value = np.where(observed, value, [prior.mass, *prior.com])
        std = np.sqrt(covariance.diagonal()[4:])
        seen = bool((std < limits.inertia * robot_mass * length**2).all())  # an inertia tensor needs all six components
        inertia = prior.inertia_com
        if seen:
            inertia = _possible(InertialParameters(vector).inertia_com, limits.least_spread * value[0] * length**2)
        inertial = InertialParameters.from_com(float(value[0]), value[1:], inertia)
        if not seen:
            std = np.full(6, np.nan)
        return cls(inertial, centre, std, np.concatenate([observed, np.full(6, seen)]))

    @classmethod
    def unobserved(cls, prior: InertialParameters) -> TrunkParameters:
        """The prior, with no component observed."""
        return cls(prior, unobserved(), np.full(6, np.nan), np.zeros(10, dtype=bool))


def unobserved() -> Array:
    """Covariance of an estimate in which nothing was observed, (4, 4), all NaN."""
    return np.full((4, 4), np.nan)


def _possible(inertia_com: Array, least: float) -> Array:
    """Nearest physically possible inertia about the centre of mass (3, 3): second moments not below `least`.

    Mass and centre of mass are unchanged, since they are known better.
    """
    second = 0.5 * np.trace(inertia_com) * np.eye(3) - inertia_com
    values, vectors = np.linalg.eigh(second)
    if values[0] >= least:
        return inertia_com
    second = (vectors * np.maximum(values, least)) @ vectors.T
    return np.asarray(np.trace(second) * np.eye(3) - second)
