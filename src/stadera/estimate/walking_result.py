"""What weighing while walking finds: the trunk's parameters, a payload, changes of the load, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.square_root import SquareRoot
from stadera.estimate.walking_unknowns import UNKNOWNS
from stadera.inertia import InertialParameters

Array = NDArray[np.float64]

_MASS_LIMIT, _COM_LIMIT, _INERTIA_LIMIT = 0.05, 0.05, 0.02
_LEAST_SPREAD = 1e-4  # of a trunk's second moments, as a share of mass times squared leg length


@dataclass(frozen=True, eq=False)
class TrunkParameters:
    """The trunk, payload included, trunk frame.

    Attributes:
        inertial: physically possible; what was not observed is as believed at the start.
        covariance: (4, 4), of mass [kg] and centre of mass [m].
        inertia_std: (6,) [kg·m²], of Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the trunk's origin.
        observed: (10,) bool, of mass, three components of the centre of mass, six of the inertia, these all or none.
    """

    inertial: InertialParameters
    covariance: Array
    inertia_std: Array
    observed: NDArray[np.bool_]

    @classmethod
    def of(cls, known: SquareRoot, start: InertialParameters, limit: Array, length: float) -> TrunkParameters:
        """Read from what is known, the ten parameters first; `start` for what was not observed."""
        centre = Centre.of(known, start, limit)
        std = np.linalg.norm(known.root[4:10], axis=1)
        seen = bool((std < limit[4:]).all())  # five components of a tensor are not one
        inertia = start.inertia_com
        if seen:
            least = _LEAST_SPREAD * centre.value[0] * length**2
            inertia = _possible(InertialParameters(known.mean[:10]).inertia_com, least)
        inertial = InertialParameters.from_com(float(centre.value[0]), centre.value[1:], inertia)
        std = np.where(seen, std, np.nan)
        return cls(inertial, centre.covariance, std, np.concatenate([centre.observed, np.full(6, seen)]))


class Centre(NamedTuple):
    """Mass [kg] and centre of mass [m].

    Attributes:
        value: (4,), of the start where not observed.
        covariance: (4, 4), NaN where not observed.
        observed: (4,) bool.
    """

    value: Array
    covariance: Array
    observed: NDArray[np.bool_]

    @classmethod
    def of(cls, known: SquareRoot, start: InertialParameters, limit: Array) -> Centre:
        """Read from what is known; a mass that is not positive is handed on as it is."""
        vector = known.mean[:4]
        if not vector[0] > 0:
            return cls(vector, np.full((4, 4), np.nan), np.zeros(4, dtype=bool))
        root = centre_slope(vector) @ known.root[:4]
        covariance = root @ root.T
        observed = np.sqrt(np.diag(covariance)) < limit[:4]
        value = np.array([vector[0], *(vector[1:] / vector[0])])
        if not observed.all():
            covariance[~observed, :] = covariance[:, ~observed] = np.nan
            value = np.where(observed, value, [start.mass, *start.com])
        return cls(value, covariance, observed)


@dataclass(frozen=True, eq=False)
class Payload:
    """What was put on since the tare, trunk frame.

    Attributes:
        parameters: the ten, a difference: need not be physically possible.
        covariance: (10, 10), of the ten.
        mass, mass_std: [kg].
        com, com_std: (3,) [m]; NaN where not observed, and all of it while the mass is less than three of its
            deviations from zero.
    """

    parameters: InertialParameters
    covariance: Array
    mass: float
    mass_std: float
    com: Array
    com_std: Array

    @classmethod
    def of(cls, vector: Array, covariance: Array, limit: float) -> Payload:
        """From the difference of ten parameters; components with a deviation above `limit` [m] are not observed."""
        mass, mass_std = float(vector[0]), float(np.sqrt(covariance[0, 0]))
        com = com_std = np.full(3, np.nan)
        if abs(mass) > 3.0 * mass_std:
            slope = centre_slope(vector[:4])[1:]
            std = np.sqrt(np.diag(slope @ covariance[:4, :4] @ slope.T))
            com, com_std = (np.where(std < limit, v, np.nan) for v in (vector[1:4] / mass, std))
        return cls(InertialParameters(vector), covariance, mass, mass_std, com, com_std)


@dataclass(frozen=True, eq=False)
class LoadChange:
    """A change of the load, trunk frame.

    Attributes:
        time: [s], about when; noticed: [s], when it was found.
        before, after: the ten parameters, as known on either side.
        mass, mass_std: [kg], of the difference; constant errors of the sensors are alike on both sides and not in it,
            but what gains and a doubted model do to the difference is.
        kind: on, off, or shifted: the mass is the same, to three standard deviations or 0.5 % of the robot's.
    """

    time: float
    noticed: float
    before: InertialParameters
    after: InertialParameters
    mass: float
    mass_std: float
    kind: Literal["on", "off", "shifted"]


@dataclass(frozen=True, eq=False)
class ChangeBegun:
    """A change whose other side is still being weighed: what was known before it."""

    time: float
    noticed: float
    before: SquareRoot
    least: float

    def weighed(self, now: SquareRoot) -> LoadChange:
        """The change, by what is known now."""
        first, last = self.before.mean[:10], now.mean[:10]
        mass = float(last[0] - first[0])
        doubt = now.root[0, len(now) :] - self.before.root[0, len(self.before) :]
        std = float(np.linalg.norm([_white_mass_std(self.before), _white_mass_std(now), *doubt]))
        kind: Literal["on", "off", "shifted"] = "on" if mass > 0 else "off"
        if abs(mass) < max(3.0 * std, self.least):
            kind = "shifted"
        return LoadChange(self.time, self.noticed, InertialParameters(first), InertialParameters(last), mass, std, kind)


def centre_slope(moments: Array) -> Array:
    """(4, 4): how mass and centre of mass change with mass and first moment (4,)."""
    mass = moments[0]
    slope = np.eye(4)
    slope[1:] /= mass
    slope[1:, 0] = -moments[1:4] / mass**2
    return slope


def known_to(robot_mass: float, length: float) -> Array:
    """(10,) standard deviations [kg, m, kg·m²] above which mass, centre of mass and inertia count as not observed."""
    return np.array(
        [
            _MASS_LIMIT * robot_mass,
            *[_COM_LIMIT * length] * 3,
            *[_INERTIA_LIMIT * robot_mass * length**2] * 6,
        ]
    )


def _possible(inertia_com: Array, least: float) -> Array:
    """The nearest inertia about the centre of mass (3, 3) that a body can have: second moments not below `least`.

    Mass and centre of mass stay: it is they that are known well.
    """
    second = 0.5 * np.trace(inertia_com) * np.eye(3) - inertia_com
    values, vectors = np.linalg.eigh(second)
    if values[0] >= least:
        return inertia_com
    second = (vectors * np.maximum(values, least)) @ vectors.T
    return np.asarray(np.trace(second) * np.eye(3) - second)


def _white_mass_std(known: SquareRoot) -> float:
    """Of the mass, the constants taken as they are: what averages out [kg]."""
    return float(np.linalg.norm(np.linalg.inv(known.first(UNKNOWNS).R[:10, :10])[0]))
