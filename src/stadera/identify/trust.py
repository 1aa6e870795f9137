"""How well the identified legs explain the torques: residual variance relative to noise and usual drive errors.

The error bars of an identification are based on its own residuals, so they widen with a bad fit, but they do not show
that the model is wrong. So each joint's residual is compared with the expected one,

    s² = (σ √(2 f_c / f_s))² + (a τ_c)² + (b rms τ)²

the torque's white noise σ in the band of the equations, the part of a drive's friction that Coulomb and viscous
friction do not explain, and errors of the reported torque besides its offset. The misfit of a leg is the mean over its
joints of residual variance over s²; the verdict follows the worst joint. A torque of the wrong sign is bad even if its
misfit is small; it is detected by reversing the sign and comparing the cost of the posterior.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from stadera.body import FRICTION_TERMS
from stadera.constants import NOTHING
from stadera.identify.gather import Gathered, LegScore
from stadera.identify.job import Job, LegTask, TrunkUp
from stadera.identify.observability import observability
from stadera.identify.result import LegIdentification
from stadera.identify.settings import TrustSettings
from stadera.identify.solutions import Estimate
from stadera.trust import Trust, Verdict

_LIKELIEST = (
    "the likeliest causes are another robot's model, torques of another joint, a foot that touches something, or a "
    "trunk that moves"
)


def trust_in(
    job: Job, gathered: Sequence[Gathered], estimates: Sequence[Estimate], remarks: Sequence[str] = ()
) -> Trust:
    """Fit quality of the requested legs, in the job's order; `remarks` are further reasons against trust."""
    settings = job.settings.trust
    wanted = list(zip(job.tasks, gathered, estimates, strict=True))[: job.wanted]
    fits = [_LegFit(task, data, estimate, _stated(job, task, estimate)) for task, data, estimate in wanted]
    is_bad, reasons = _explained(fits, settings, [t for t in FRICTION_TERMS if t not in job.settings.friction.terms])
    reasons = (*reasons, *_far(fits, settings.far), *remarks)
    verdict: Verdict = "bad" if is_bad else "doubtful" if reasons else "good"
    by_leg = {fit.task.leg.name: float(np.mean(list(fit.misfits.values()))) for fit in fits}
    return Trust(verdict, float(np.mean(list(by_leg.values()))), by_leg, reasons)


def _explained(
    fits: Sequence[_LegFit], settings: TrustSettings, left_out: Sequence[str]
) -> tuple[bool, tuple[str, ...]]:
    """Whether the model, without the joint terms left out, fails to explain the torques altogether, and where it
    explains them poorly.
    """
    loud = {joint: misfit for fit in fits for joint, misfit in fit.misfits.items() if misfit > settings.doubtful}
    signs = [reason for fit in fits for reason in fit.reversed(settings.reversed_gain)]
    if signs:
        return True, (*signs, *map(_loud, loud, loud.values()))
    if loud and left_out:
        whose, most = f"{len(loud)} joint{'s' * (len(loud) > 1)}", max(loud.values())
        what = f"{', '.join(left_out)} of the joints {'are' if len(left_out) > 1 else 'is'} not fitted"
        return most > settings.bad, (f"{what}: the torques' residuals of {whose} are up to {_times(most)}",)
    if not any(misfit > settings.bad for misfit in loud.values()):
        return False, tuple(map(_loud, loud, loud.values()))
    return True, (*map(_loud, loud, loud.values()), _LIKELIEST)


@dataclass(frozen=True, eq=False)
class _LegFit:
    """One leg's residuals, and their expected size `stated` by joint, s [N·m]."""

    task: LegTask
    data: Gathered
    estimate: Estimate
    stated: Mapping[str, float]

    @property
    def misfits(self) -> dict[str, float]:
        return {joint: (self.data.noise[joint] / std) ** 2 for joint, std in self.stated.items()}

    @property
    def rank(self) -> int:
        """Number of directions of links and drives that the data determine."""
        known = self.task.lasting(self.data.whitened(self.task.fixed))
        return observability(known, self.task.constant.prior).rank

    @property
    def distance(self) -> float:
        """|x|² of links and drives, from the model's values."""
        prior = self.task.constant.prior
        x = np.linalg.solve(prior.root, self.estimate.values[: len(prior.values)] - prior.values)
        return float(x @ x)

    def reversed(self, gain: float) -> Iterator[str]:
        """Yields the joints whose torque the model explains far better with the sign reversed."""
        joints = self.task.leg.joints
        costs = {flipped: self._cost(flipped) for flipped in ((), *((joint,) for joint in joints), joints)}
        best = min(costs, key=lambda flipped: costs[flipped])
        if best and gain * costs[best] < costs[()]:
            yield f"leg {self.task.leg.name}: the torque of {', '.join(map(repr, best))} seems to have the other sign"

    def _cost(self, flipped: tuple[str, ...]) -> float:
        """min |R θ - z|² + |x|² over θ = prior + root x, rows in units of the expected residual."""
        by_joint = tuple(
            replace(rows, z=-rows.z) if joint in flipped else rows
            for joint, rows in zip(self.task.leg.joints, self.data.by_joint, strict=True)
        )
        information = replace(self.data, noise=self.stated, by_joint=by_joint).whitened(self.task.fixed)
        prior = self.estimate.prior
        rows = np.vstack([information.R @ prior.root, np.eye(len(prior.values))])
        target = np.concatenate([information.z - information.R @ prior.values, np.zeros(len(prior.values))])
        return information.cost + float(np.sum((rows @ np.linalg.lstsq(rows, target)[0] - target) ** 2))


def _stated(job: Job, task: LegTask, estimate: Estimate) -> dict[str, float]:
    found, settings = dict(task.fixed) | estimate.by_name(), job.settings.trust

    def size(joint: str) -> float:
        friction, torque = settings.friction * found[f"{joint}.coulomb"], settings.torque * job.torque_rms[joint]
        return float(np.linalg.norm([job.torque_noise[joint], friction, torque, NOTHING]))

    return {joint: size(joint) for joint in task.leg.joints}


def _loud(joint: str, misfit: float) -> str:
    return f"joint {joint!r}: the torque's residual is {_times(misfit)}"


def _times(misfit: float) -> str:
    return f"{np.sqrt(misfit):.3g} times what noise and the usual imperfections of drives leave"


def _far(fits: Sequence[_LegFit], chance: float) -> Iterator[str]:
    """Yields a reason if all legs together are further from the model than the prior allows."""
    if any(fit.estimate.method != "consistent" for fit in fits):
        return
    distance, rank = sum(f.distance for f in fits), sum(f.rank for f in fits)
    if distance > chdtri(max(rank, 1), chance):
        yield (
            f"the values are {np.sqrt(distance / max(rank, 1)):.2g} times as far from the model's as usual: look at "
            f"the model, and at the unit of the torques"
        )


def leg_warnings(result: LegIdentification, scores: Mapping[str, LegScore], limits: TrustSettings) -> LegIdentification:
    """Returns the result with its warnings."""
    at_rest = [
        f"the leg does not move in the {part} part: no RMSE there" for part, s in scores.items() if not s.samples
    ]
    rank, possible = result.estimate.observability.rank, result.structural_rank
    poor = (
        f"poor excitation: the data determine {rank} of the {possible} combinations that a richer motion would; "
        f"the others rest on the model's values"
    )
    data, prediction = _data(result, scores["training"], limits), _prediction(result, scores.get("validation"))
    warnings = (*at_rest, *([poor] if rank < possible else []), *_joint_terms(result), *data, *prediction)
    return replace(result, warnings=warnings)


def doubted(trust: Trust, legs: Sequence[LegIdentification]) -> Trust:
    """Trust in a fit that is at most doubtful if legs are impossible, not measured, or predict worse than CAD."""
    doubts = {
        "the solution is not physically consistent: do not hand it to a controller or a simulator": [
            leg for leg in legs if not leg.estimate.is_physical
        ],
        "the log measures nothing: every value is the model's own": [
            leg for leg in legs if leg.estimate.observability.rank == 0
        ],
        "torques that were not fitted are predicted worse than by CAD with fitted friction, by more than chance": [
            leg for leg in legs if "" in leg.worse
        ],
    }
    for doubt, which in doubts.items():
        if which:
            trust = trust.at_most("doubtful", f"{', '.join(leg.leg.name for leg in which)}: {doubt}")
    return trust


def log_warnings(vertical: TrunkUp, samples: int, limits: TrustSettings) -> tuple[str, ...]:
    """Warnings that concern the whole log."""
    turning = "the IMU shows a turning trunk: the trunk is assumed to be held, the results are not to be trusted"
    warnings = {
        turning: vertical.turning >= limits.turning,
        f"only {samples} moving samples": samples < limits.fewest,
    }
    return tuple(sentence for sentence, applies in warnings.items() if applies)


def _joint_terms(result: LegIdentification) -> Iterator[str]:
    width = dict(zip(result.estimate.columns, result.estimate.prior.scales.tolist(), strict=True))
    for joint in result.leg.joints:
        for term in ("armature", "viscous", "coulomb"):
            value = result.estimate.unconstrained.get(f"{joint}.{term}", 0.0)
            found = result.parameters.get(f"{joint}.{term}")
            if found is None or found.std is None or value > -max(found.std, 1e-6 * width[f"{joint}.{term}"]):
                continue
            word = {"armature": "rotor inertia"}.get(term, f"{term} friction")
            if result.estimate.method == "null-space":
                yield f"{joint}: {word} came out negative ({value:.3g} {found.unit}), which no joint has"
            else:
                yield (
                    f"{joint}: without the physical constraint {word} would come out negative "
                    f"({value:.3g} {found.unit}); look for a torque lag or an unmodelled effect"
                )


def _data(result: LegIdentification, score: LegScore, limits: TrustSettings) -> Iterator[str]:
    if score.samples:
        far = {joint: share for joint, share in score.outliers(limits.outlier).items() if share > limits.outliers}
        if far:
            shares = ", ".join(f"{joint} {100 * share:.1f} %" for joint, share in far.items())
            yield f"outliers, off by more than {limits.outlier:g} times the RMSE: {shares} of the samples"
        still = np.ptp(score.trace("").measured, axis=0) == 0.0
        for joint, same in zip(result.leg.joints, still, strict=True):
            if same:
                yield f"{joint}: the recorded torque never changes; it determines nothing, whatever was found with it"
    for joint, count in score.saturated.items():
        if count:
            at = f"{count} sample{'' if count == 1 else 's'} at the torque limit"
            yield f"{joint}: {at}; a saturated torque is not a measured one"


def _prediction(result: LegIdentification, score: LegScore | None) -> list[str]:
    if score is None or not score.samples:
        return []
    rmse = score.rmse
    return [
        f"{joint}: on the validation part the identified model is worse than CAD with friction "
        f"({rmse['identified'][joint]:.3g} against {rmse['prior_friction'][joint]:.3g} N·m)"
        for joint in result.leg.joints
        if joint in result.worse
        and rmse["identified"][joint] > 1e-6 * np.sqrt(np.mean(np.square(list(rmse["prior"].values()))) + 1e-30)
    ]
