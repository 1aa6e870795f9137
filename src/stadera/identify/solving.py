"""Solves for all legs of a robot, each from its own information, with drives' priors pooled over the legs."""

from __future__ import annotations

from collections.abc import Sequence

from stadera.identify.pooling import KindSpread, pooled_prior
from stadera.identify.prior import Prior
from stadera.identify.solutions import Estimate, SolverSettings, consistent_solution, null_space_solution
from stadera.information import Information
from stadera.robot.model import Leg
from stadera.types import Progress

_SOLVERS = {"consistent": consistent_solution, "null-space": null_space_solution}


def solve_legs(
    legs: Sequence[tuple[Leg, Information, Prior]],
    method: str,
    spread: KindSpread | None,
    solver: SolverSettings,
    progress: Progress,
) -> list[tuple[Estimate, Estimate]]:
    """For each leg the requested solution and the null-space solution.

    Args:
        legs: rows of each leg in units of their noise, and the prior of its parameters.
        method: "consistent" or "null-space".
        spread: spread between the drives of the legs; None to solve for each leg separately.
        solver: settings of each leg's problem.
        progress: called with the number of legs done.
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
