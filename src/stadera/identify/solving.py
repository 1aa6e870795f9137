"""Solves for all legs of a robot, each from its own information, with drives' priors pooled over the legs.

The four knees of a robot have the same motor and gearbox, so their rotor inertia and friction are nearly equal, while
slow motion of a single leg separates the two badly. For each joint term, the prior's centre is the mean of the same
term over the other legs, weighted by its accuracy there::

    μ = Σ w_l θ_l / Σ w_l,    w_l = 1 / (var_l + (r θ̃)²),    width² = (r θ̃)² + 1 / Σ w_l

with r the spread between drives of one type and θ̃ the median of |θ_l|. The width never exceeds the original prior's. A
leg's own data do not enter its prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stadera.errors import IdentificationError
from stadera.identify.prior import Prior
from stadera.identify.solutions import Estimate, SolverSettings, consistent_solution, null_space_solution
from stadera.information import Information
from stadera.robot.model import Leg
from stadera.types import Progress


@dataclass(frozen=True)
class KindSpread:
    """Spread between drives of one type, one standard deviation relative to their mean.

    Rotor inertia and viscous friction are set by the drive's design; Coulomb friction also depends on wear and preload.
    """

    armature: float = 0.1
    viscous: float = 0.1
    coulomb: float = 0.5

    def __post_init__(self) -> None:
        for name in ("armature", "viscous", "coulomb"):
            if not getattr(self, name) > 0:
                raise IdentificationError(f"spread of {name!r} must be positive, got {getattr(self, name)}")


def pooled_prior(leg: Leg, prior: Prior, others: Sequence[tuple[Leg, Estimate]], spread: KindSpread) -> Prior:
    """A leg's prior, with centre and width of its drives' terms taken from the other legs, if there are any."""
    values, root = prior.values.copy(), prior.root.copy()
    for position, joint in enumerate(leg.joints):
        for term in ("armature", "viscous", "coulomb"):
            name = f"{joint}.{term}"
            if name not in prior.columns or not others:
                continue
            found, variance = [], []
            for other, estimate in others:
                k = estimate.columns.index(f"{other.joints[position]}.{term}")
                found.append(estimate.values[k])
                variance.append(estimate.covariance[k, k])
            k = prior.columns.index(name)
            values[k], root[k, k] = _mean(np.array(found), np.array(variance), getattr(spread, term), root[k, k])
    return replace(prior, values=values, root=root)


def _mean(
    found: NDArray[np.float64], variance: NDArray[np.float64], relative: float, widest: float
) -> tuple[float, float]:
    between = (relative * float(np.median(np.abs(found)))) ** 2
    weights = 1.0 / (variance + between + 1e-12 * widest**2)
    mean = float(weights @ found / weights.sum())
    return max(mean, 0.0), min(float(np.sqrt(between + 1.0 / weights.sum())), widest)


_SOLVERS = {"consistent": consistent_solution, "null-space": null_space_solution}


def solve_legs(
    legs: Sequence[tuple[Leg, Information, Prior]],
    method: str,
    spread: KindSpread | None,
    solver: SolverSettings,
    progress: Progress,
) -> list[tuple[Estimate, Estimate]]:
    """For each leg the requested solution and the null-space solution, from rows in units of their noise and the prior.

    `spread` is that between the drives of the legs; None to solve for each leg separately.
    """
    priors = [prior for _, _, prior in legs]
    if spread is not None and len(legs) > 1:
        alone = [consistent_solution(information, prior, solver) for _, information, prior in legs]
        drives = [(leg, estimate) for (leg, _, _), estimate in zip(legs, alone, strict=True)]
        others = [[drive for drive in drives if drive[0] is not leg] for leg, _, _ in legs]
        priors = [pooled_prior(leg, prior, o, spread) for (leg, _, prior), o in zip(legs, others, strict=True)]
    out = []
    for done, ((_, information, _), prior) in enumerate(zip(legs, priors, strict=True)):
        out.append((_SOLVERS[method](information, prior, solver), null_space_solution(information, prior, solver)))
        progress("solving", done + 1, len(legs))
    return out
