"""Warnings on a result, one sentence each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stadera.identify.held import TrunkUp
from stadera.identify.residuals import LegScore
from stadera.identify.result import LegIdentification
from stadera.identify.settings import TrustSettings


def leg_warnings(result: LegIdentification, scores: Mapping[str, LegScore], limits: TrustSettings) -> LegIdentification:
    """Returns the result with its warnings."""
    warnings = (
        *_at_rest(scores),
        *_excitation(result),
        *_joint_terms(result),
        *_data(result, scores["training"], limits),
        *_prediction(result, scores.get("validation")),
    )
    return replace(result, warnings=warnings)


def log_warnings(
    vertical: TrunkUp, legs: tuple[LegIdentification, ...], samples: int, limits: TrustSettings
) -> tuple[str, ...]:
    """Warnings that concern the whole log."""
    warnings = []
    if vertical.turning >= limits.turning:
        warnings.append(
            "the IMU shows a turning trunk: the trunk is assumed to be held, the results are not to be trusted"
        )
    if all(leg.estimate.observability.rank == 0 for leg in legs):
        warnings.append("the motion excites nothing: every value is the model's own")
    if samples < limits.fewest:
        warnings.append(f"only {samples} moving samples")
    return tuple(warnings)


def _at_rest(scores: Mapping[str, LegScore]) -> list[str]:
    return [f"the leg does not move in the {part} part: no RMSE there" for part, s in scores.items() if not s.samples]


def _excitation(result: LegIdentification) -> list[str]:
    rank, possible = result.estimate.observability.rank, result.structural_rank
    if rank >= possible:
        return []
    return [
        f"poor excitation: the data determine {rank} of the {possible} combinations that a richer motion would; "
        f"the others rest on the model's values"
    ]


def _joint_terms(result: LegIdentification) -> list[str]:
    out = []
    unconstrained = result.null_space.by_name()
    width = dict(zip(result.estimate.columns, result.estimate.prior.scales.tolist(), strict=True))
    for joint in result.leg.joints:
        for term in ("armature", "viscous", "coulomb"):
            value = unconstrained.get(f"{joint}.{term}", 0.0)
            found = result.parameters.get(f"{joint}.{term}")
            if found is None or found.std is None or value > -max(found.std, 1e-6 * width[f"{joint}.{term}"]):
                continue
            word = {"armature": "rotor inertia"}.get(term, f"{term} friction")
            if result.estimate.method == "null-space":
                out.append(f"{joint}: {word} came out negative ({value:.3g} {found.unit}), which no joint has")
            else:
                out.append(
                    f"{joint}: without the physical constraint {word} would come out negative "
                    f"({value:.3g} {found.unit}); look for a torque lag or an unmodelled effect"
                )
    if not result.estimate.is_physical:
        out.append("the solution is not physically consistent: do not hand it to a controller or a simulator")
    return out


def _data(result: LegIdentification, score: LegScore, limits: TrustSettings) -> list[str]:
    out = []
    if score.samples:
        far = {joint: share for joint, share in score.outliers(limits.outlier).items() if share > limits.outliers}
        if far:
            shares = ", ".join(f"{joint} {100 * share:.1f} %" for joint, share in far.items())
            out.append(f"outliers, off by more than {limits.outlier:g} times the RMSE: {shares} of the samples")
        still = np.ptp(score.trace("").measured, axis=0) == 0.0
        out += [
            f"{joint}: the recorded torque never changes; it determines nothing, whatever was found with it"
            for joint, same in zip(result.leg.joints, still, strict=True)
            if same
        ]
    for joint in result.leg.joints:
        if score.saturated[joint]:
            out.append(
                f"{joint}: {score.saturated[joint]} samples at the torque limit; "
                f"a saturated torque is not a measured one"
            )
    return out


def _prediction(result: LegIdentification, score: LegScore | None) -> list[str]:
    if score is None or not score.samples:
        return []
    rmse = score.rmse
    worse = [j for j in result.leg.joints if rmse["identified"][j] > rmse["prior_friction"][j] * (1 + 1e-9)]
    return [
        f"{joint}: on the validation part the identified model is no better than CAD with friction "
        f"({rmse['identified'][joint]:.3g} against {rmse['prior_friction'][joint]:.3g} N·m)"
        for joint in worse
        if rmse["identified"][joint] > 1e-6 * np.sqrt(np.mean(np.square(list(rmse["prior"].values()))) + 1e-30)
    ]
