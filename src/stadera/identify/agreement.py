"""Do logs, or the parts of one log, agree on each parameter?

Each part is compared with all others together. With the prior θ = θ₀ + S x, x ~ N(0, 1), and A the information of a
part on x, its estimate is x̂ = C b, C = (A + 1)⁻¹, and the difference of two estimates has the covariance

    C₁ A₁ C₁ + C₂ A₂ C₂ + D Dᵀ,      D = C₁ A₁ - C₂ A₂

the last term since the prior draws both towards the model, and differently so. Errors that the information considers,
such as a lag of the torques, are each part's own and add what they do to each. Only parameters that both sides know
twice as well as the prior are compared. Of so many looks the largest is large by chance: a parameter differs if its
deviation has a probability below 5 % divided by the number of looks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import reduce
from typing import Any

import numpy as np
from scipy.special import ndtri

from stadera.identify.prior import Prior
from stadera.information import Information
from stadera.types import Array

_CAUSES = {
    "armature": "another gain of the torques",
    "viscous": "another temperature or speed",
    "coulomb": "another temperature, or wear",
    "offset": "drift of the torque sensor, or another temperature",
}


@dataclass(frozen=True)
class Compared:
    """One parameter in several parts."""

    z: float  # largest deviation of a part from the others, in standard deviations
    spread: float  # standard deviation of the parts' values, in the parameter's unit
    agrees: bool  # False if the deviation is beyond chance


@dataclass(frozen=True, eq=False)
class Agreement:
    """How well parts of the data agree."""

    parts: tuple[str, ...]  # their names
    looks: int  # number of comparisons
    chi2: float  # mean square of the deviations, 1 if the error bars are right
    parameters: Mapping[str, Compared]  # of those that several parts determine, by name

    @classmethod
    def of(
        cls, parts: Sequence[str], legs: Sequence[tuple[Sequence[Information], Prior]], chance: float = 0.05
    ) -> Agreement:
        """Compares parts by their information on some legs, each with the leg's prior."""
        found = [compared for informations, prior in legs for compared in _deviations(informations, prior)]
        deviations = [abs(z) for _, zs, _ in found for z in zs]
        looks = len(deviations)
        beyond = -ndtri(0.5 * chance / max(looks, 1))
        return cls(
            tuple(parts),
            looks,
            float(np.mean(np.square(deviations))) if looks else 1.0,
            {name: Compared(max(map(abs, zs)), spread, bool(max(map(abs, zs)) < beyond)) for name, zs, spread in found},
        )

    @property
    def differs(self) -> tuple[str, ...]:
        """What differs most, and its likely cause, one sentence each; others may differ because of these."""
        apart = sorted((item for item in self.parameters.items() if not item[1].agrees), key=lambda item: -item[1].z)
        most, where = 5, " and ".join(self.parts)
        out = [
            f"{name} differs between {where} by {found.z:.1f} standard deviations (spread {found.spread:.2g}): "
            f"{_cause(name)}; its error bar is widened by that"
            for name, found in apart[:most]
        ]
        return (*out, *([f"{len(apart) - most} more parameters differ less than these"] if len(apart) > most else []))

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self) | {"parts": list(self.parts), "differs": list(self.differs)}

    def widened(self, columns: Sequence[str], covariance: Array) -> Array:
        """A covariance of parameters with the spread of those that differ added."""
        known = (self.parameters.get(name) for name in columns)
        return covariance + np.diag([0.0 if f is None or f.agrees else f.spread**2 for f in known])


def _cause(name: str) -> str:
    term = name.rpartition(".")[2].partition("_")[0]
    return _CAUSES.get(term, "another load on the leg, or another gain of the torques")


def _deviations(
    informations: Sequence[Information], prior: Prior, known: float = 0.5
) -> list[tuple[str, list[float], float]]:
    """Name, deviations and spread of each parameter that a part and the others know better than `known` times the
    prior.
    """
    parts = [Information.empty(prior.columns).merge(information) for information in informations]
    values, deviations, seen = [], [], []
    for k, part in enumerate(parts):
        others = reduce(Information.merge, [*parts[:k], *parts[k + 1 :]])
        (x1, C1, A1, G1), (x2, C2, A2, G2) = _estimate(part, prior), _estimate(others, prior)
        drawn = C1 @ A1 - C2 @ A2
        covariance = C1 @ A1 @ C1 + C2 @ A2 @ C2 + drawn @ drawn.T + G1 @ G1.T + G2 @ G2.T
        std = _std(prior.root, covariance)
        deviations.append(prior.root @ (x1 - x2) / np.maximum(std, 1e-9 * prior.scales))
        stds = [_std(prior.root, C) for C in (C1, C2)]
        seen.append(np.max(stds, axis=0) < known * prior.scales)
        values.append(prior.values + prior.root @ x1)
    count = 1 if len(parts) == 2 else len(parts)  # two parts are one comparison
    out = []
    for k, name in enumerate(prior.columns):
        who = [i for i in range(len(parts)) if seen[i][k]]
        if who:
            spread = float(np.std([values[i][k] for i in who], ddof=1)) if len(who) > 1 else 0.0
            out.append((name, [float(deviations[i][k]) for i in who[:count]], spread))
    return out


def _estimate(information: Information, prior: Prior) -> tuple[Array, Array, Array, Array]:
    """x̂, C, A and what considered errors do to x̂, of information on the prior's columns, by singular values: the normal
    matrix of data without noise has half their digits.
    """
    U, sizes, Vt = np.linalg.svd(information.R @ prior.root)
    x = Vt.T @ (sizes / (1.0 + sizes**2) * (U.T @ (information.z - information.R @ prior.values)))
    considered = Vt.T @ ((sizes / (1.0 + sizes**2))[:, None] * (U.T @ information.G))
    return x, (Vt.T / (1.0 + sizes**2)) @ Vt, (Vt.T * sizes**2) @ Vt, considered


def _std(root: Array, covariance: Array) -> Array:
    return np.asarray(np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", root, covariance, root), 0.0)))
