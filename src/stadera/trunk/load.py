"""Payload since the tare and changes of the load, common to all estimators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite, sqrt
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from stadera.inertia import ORDER, InertialParameters
from stadera.results import finite_or_none
from stadera.types import Array

if TYPE_CHECKING:
    from stadera.trunk.result import TrunkParameters

SIGNIFICANT = 3.0
"""Standard deviations from zero above which a payload's mass, and its moments of inertia, are reported."""

ChangeKind = Literal["on", "off", "shifted"]
TENSOR = tuple(name.removeprefix("I") for name in ORDER[4:])
"""Names of an inertia's components: xx, xy, xz, yy, yz, zz."""


@dataclass(frozen=True, eq=False)
class Payload:
    """Mass added to the robot since the tare, in the frame of the link or frame `at`: the trunk's, or another's.

    Attributes:
        mass, mass_std: [kg].
        com: (3,) [m]. com_covariance: (3, 3) [m²]. NaN where not observed; all NaN if the mass is less than three
            standard deviations from zero.
        inertia: (3, 3) [kg·m²], about the payload's centre of mass, in that frame's axes; None where not observed.
        inertia_std: (6,) [kg·m²], of its Ixx, Ixy, Ixz, Iyy, Iyz, Izz; None where not observed.
        parameters: all ten, as the difference of two trunks, which need not be physically possible; None if only mass
            and centre of mass are estimated.
        mass_std_without_scale: the part of `mass_std` [kg] that is not due to the scale that all torques have in
            common, by which loads of one robot are compared; None if it is not known.
        at: the link or frame; empty for the trunk. places: probability of each place that was compared, none if that
            was not asked.
    """

    mass: float
    mass_std: float
    com: Array
    com_covariance: Array
    inertia: Array | None = None
    inertia_std: Array | None = None
    parameters: InertialParameters | None = None
    mass_std_without_scale: float | None = None
    at: str = ""
    places: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        where = f" at and in the frame of {self.at}" if self.at else ""
        return f"{described(self, self.mass)}{where}"

    @property
    def scale(self) -> float | None:
        """Standard deviation of the torques' common scale [1], by which the mass may be wrong beyond
        `mass_std_without_scale`.
        """
        return scale_of(self.mass, self.mass_std, self.mass_std_without_scale)

    @property
    def com_std(self) -> Array:
        """Standard deviation of the centre of mass, (3,) [m], NaN where not observed."""
        return np.sqrt(np.diag(self.com_covariance))

    def to_dict(self, frame: str, mark: dict[str, bool]) -> dict[str, Any]:
        """Plain values for JSON; `frame` is the trunk's; `mark` is added to mass and centre of mass."""
        tensor = None if self.inertia is None else self.inertia[np.triu_indices(3)].tolist()
        std = None if self.inertia_std is None else self.inertia_std.tolist()
        return {
            "mass": mass_quantity(self.mass, self.mass_std, self.mass_std_without_scale) | mark,
            "com": {"value": plain(self.com), "std": plain(self.com_std)} | mark,
            "com_covariance": [plain(row) for row in self.com_covariance],
            "inertia": tensor and dict(zip(TENSOR, tensor, strict=True)),
            "inertia_std": std and dict(zip(TENSOR, std, strict=True)),
            "frame": self.at or frame,
            "inertia_about": "com",
            "at": self.at or frame,
            "places": [{"at": at, "probability": share} for at, share in self.places.items()],
        }

    @classmethod
    def of_parameters(cls, vector: Array, covariance: Array, limit: float, by_scale: Array | None = None) -> Payload:
        """Computes a payload from the difference of two trunks' ten parameters.

        Args:
            vector: (10,). covariance: (10, 10).
            limit: standard deviation [m] above which a component of the centre of mass counts as not observed.
            by_scale: (10,), `Errors.by_scale`; None if it is not known.
        """
        found = cls.of_moments(vector[:4], covariance[:4, :4], np.full(3, limit))
        parameters = InertialParameters(vector)
        inertia = observed_inertia(parameters, covariance) if np.isfinite(found.com).all() else None
        std = None if inertia is None else inertia_com_std(parameters, covariance)
        alone = None if by_scale is None else without_scale(covariance[0, 0], by_scale[0])
        return replace(found, inertia=inertia, inertia_std=std, parameters=parameters, mass_std_without_scale=alone)

    @classmethod
    def of_moments(cls, moments: Array, covariance: Array, limit: Array) -> Payload:
        """Computes a payload from mass and first moment.

        Args:
            moments: (4,) [kg, kg·m]. covariance: (4, 4).
            limit: (3,), standard deviations [m] above which components of the centre of mass count as not observed.
        """
        mass, mass_std = float(moments[0]), float(np.sqrt(covariance[0, 0]))
        com, com_covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
        if abs(mass) > SIGNIFICANT * mass_std:
            slope = centre_slope(moments)[1:]
            com_covariance = slope @ covariance @ slope.T
            hidden = ~(np.sqrt(np.maximum(np.diag(com_covariance), 0.0)) < limit)
            com = np.where(hidden, np.nan, moments[1:] / mass)
            com_covariance[hidden, :] = com_covariance[:, hidden] = np.nan
        return cls(mass, mass_std, com, com_covariance)


@dataclass(frozen=True)
class LoadChange:
    """A change of the load.

    Attributes:
        time: estimated time of the change [s]. noticed: time of detection [s].
        mass, mass_std: difference in mass [kg]; errors common to both sides cancel.
        kind: on, off, or shifted if the mass is the same within its error.
        mass_std_without_scale: as of `Payload` [kg].
        at: the link on which the load came or from which it went; empty for the trunk.
    """

    time: float
    noticed: float
    mass: float
    mass_std: float
    kind: ChangeKind
    mass_std_without_scale: float | None = None
    at: str = ""

    def to_dict(self, mark: dict[str, bool]) -> dict[str, Any]:
        """Plain values for JSON; `mark` is added to the mass."""
        mass = mass_quantity(self.mass, self.mass_std, self.mass_std_without_scale) | mark
        return {"time": self.time, "noticed": self.noticed, "kind": self.kind, "mass": mass, "at": self.at or None}


def since_tare(changes: Sequence[LoadChange], payload: Payload | None) -> tuple[LoadChange, ...]:
    """The changes since a tare. If there is one only, it is the payload and gets the payload's mass, so both agree."""
    if payload is None or len(changes) != 1 or changes[0].kind == "shifted":
        return tuple(changes)
    alone = payload.mass_std_without_scale
    return (replace(changes[0], mass=payload.mass, mass_std=payload.mass_std, mass_std_without_scale=alone),)


def scale_of(mass: float, std: float, without: float | None) -> float | None:
    """What the torques' common scale adds to a mass's standard deviation, as a share of the mass; None if unknown."""
    if without is None or not (isfinite(std) and isfinite(without) and mass):
        return None
    return sqrt(max(std**2 - without**2, 0.0)) / abs(mass)


def without_scale(variance: float, by_scale: float) -> float:
    """A mass's standard deviation without the part that the torques' common scale brings."""
    return sqrt(max(variance - by_scale**2, 0.0))


def plain(values: Array) -> list[float | None]:
    """Numbers for JSON, None for NaN."""
    return [finite_or_none(value) for value in values]


def quantity(value: float, std: float) -> dict[str, float | None]:
    """A value and its standard deviation for JSON, both None if not observed."""
    seen = isfinite(std) and isfinite(value)
    return {"value": float(value) if seen else None, "std": float(std) if seen else None}


def mass_quantity(value: float, std: float, without: float | None) -> dict[str, float | None]:
    """A mass for JSON: "std" in all, and apart "std_without_scale" [kg] and "scale" [1], of the scale that all torques
    have in common.
    """
    scale = scale_of(value, std, without)
    return quantity(value, std) | {"std_without_scale": None if scale is None else without, "scale": scale}


def described(body: Payload | TrunkParameters, mass: float) -> str:
    """Mass and centre of mass with their standard deviations, without what was not observed."""
    from stadera.report.numbers import with_scale, with_std

    seen = zip("xyz", body.com, body.com_std, strict=True)
    shown = ", ".join(f"{axis} {with_std(v, s)}" for axis, v, s in seen if isfinite(s))
    weight = with_scale(mass, body.mass_std, body.mass_std_without_scale)
    return f"{weight}; com {shown + ' m' if shown else 'not observed'}"


def centre_slope(moments: Array) -> Array:
    """Derivative (4, 4) of mass and centre of mass with respect to mass and first moment (4,)."""
    mass = moments[0]
    slope = np.eye(4)
    slope[1:] /= mass
    slope[1:, 0] = -moments[1:4] / mass**2
    return slope


def observed_inertia(body: InertialParameters, covariance: Array) -> Array | None:
    """A payload's inertia about its centre of mass, (3, 3) [kg·m²], trunk axes; None if not observed.

    Observed means that each principal moment vᵀ J v differs significantly from zero, and that the three are physically
    possible.
    """
    moments, axes = np.linalg.eigh(body.inertia_com)
    x, y, z = axes
    slope = np.array([x * x, 2.0 * x * y, 2.0 * x * z, y * y, 2.0 * y * z, z * z]).T @ _inertia_com_slope(body)
    std = np.sqrt(np.einsum("ki,ij,kj->k", slope, covariance, slope))
    return body.inertia_com if (moments > SIGNIFICANT * std).all() and body.is_physical() else None


def inertia_com_std(body: InertialParameters, covariance: Array) -> Array:
    """Standard deviations (6,) [kg·m²] of Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the centre of mass.

    Args:
        body: its ten parameters. covariance: (10, 10), of these.
    """
    slope = _inertia_com_slope(body)
    return np.asarray(np.sqrt(np.einsum("ri,ij,rj->r", slope, covariance, slope)))


def _inertia_com_slope(body: InertialParameters) -> Array:
    """Derivative (6, 10) of the inertia J about the centre of mass with respect to the ten parameters.

    J = I - m (|c|² 1 - c cᵀ) with c = h / m, so that for the components a, b of J

        ∂J_ab/∂m = |c|² δ_ab - c_a c_b,   ∂J_ab/∂h_k = δ_ak c_b + δ_bk c_a - 2 c_k δ_ab,   ∂J_ab/∂I_ab = 1
    """
    c, one = body.com, np.eye(3)
    slope = np.zeros((6, 10))
    for row, (a, b) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        slope[row, 0] = c @ c * one[a, b] - c[a] * c[b]
        slope[row, 1:4] = one[a] * c[b] + one[b] * c[a] - 2.0 * c * one[a, b]
        slope[row, 4 + row] = 1.0
    return slope
