"""Legs from a log, section II of the paper end to end: rows, information, observability, solution, validation.

Each leg is a fixed-base arm on the held trunk. Its torques are whitened with their own residual noise (and by how many
samples one independent sample is worth, for residuals of real joints are far from white), summed up once, and solved
for on the small triangle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from stadera.errors import IdentificationError
from stadera.identify.gather import Gathered, gather, with_noise_of
from stadera.identify.information import Information
from stadera.identify.job import Job, LegTask, Progress, parts_of, prepare
from stadera.identify.log import Log, name_of
from stadera.identify.observability import Combination, Observability, observability
from stadera.identify.pooling import pooled_prior
from stadera.identify.residuals import LegModels, LegScore, scored
from stadera.identify.result import Identification, KnownCombination, LegIdentification, unit_of
from stadera.identify.settings import IdentifySettings
from stadera.identify.solutions import Estimate, consistent_solution, null_space_solution
from stadera.identify.warnings import leg_warnings, log_warnings
from stadera.regressors import JointMotion, TrunkMotion
from stadera.robot.model import Robot

__all__ = ["IdentifySettings", "identify"]

_SOLVERS = {"consistent": consistent_solution, "null-space": null_space_solution}


def identify(
    robot: Robot,
    logs: Sequence[Log],
    settings: IdentifySettings | None = None,
    validation: Sequence[Log] | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identifies legs that swing freely while the trunk is held.

    Args:
        robot: the prior (CAD) model.
        logs: recordings, or paths that are streamed; what they say is merged.
        settings: see `IdentifySettings`.
        validation: other logs to validate on; then nothing of `logs` is kept back.
        progress: told a step's name, how far it is and how long it is (0: not known).

    Raises:
        RecordingError: logs that lack a joint or its torque, or are too short.
        UnknownNameError: no such leg or joint.
        IdentificationError: no logs.
    """
    if not logs:
        raise IdentificationError("identification needs at least one log")
    job = prepare(robot, logs, settings or IdentifySettings(), progress or (lambda *_: None))
    training, held_back, validated_on = parts_of(job, logs, validation)
    warnings: tuple[str, ...] = ()
    if not training.moves(job.drop_below):
        slowest = job.drop_below
        warnings = (f"no sample moves (all joint velocities stay below {slowest:g} rad/s): samples at rest are used",)
        job = job.with_samples_at_rest()
    gathered = gather(job, training)
    gathered = with_noise_of(job, training, gathered, [asked for asked, _ in _solve(job, gathered)])
    estimates = _solve(job, gathered)
    wanted = range(job.wanted)
    models = [_models(job, job.tasks[k], gathered[k], estimates[k][0]) for k in wanted]
    scores = {"training": scored(job.step("scoring"), training, models, job.trunk, job.drop_below)}
    if held_back is not None:
        scores["validation"] = scored(job.step("validating"), held_back, models, job.trunk, job.drop_below)
    legs = tuple(
        _leg_result(job, job.tasks[k], gathered[k], *estimates[k], {part: score[k] for part, score in scores.items()})
        for k in wanted
    )
    if not any("validation" in leg.rmse for leg in legs):
        validated_on = None
    return Identification(
        robot=robot,
        source=", ".join(dict.fromkeys(name_of(log) for log in logs)),
        method=job.settings.method,
        legs=legs,
        torque_lag=job.preprocessing.effort_delay,
        validated_on=validated_on,
        notes=(*training.notes, job.vertical.note, *job.notes, *_pooling_note(job)),
        warnings=warnings + log_warnings(job.vertical, legs, max(score.samples for score in scores["training"])),
    )


def _solve(job: Job, gathered: Sequence[Gathered]) -> list[tuple[Estimate, Estimate]]:
    """For each leg the solution asked for and the null-space one, the drives pooled over the legs."""
    solver, spread = _SOLVERS[job.settings.method], job.settings.spread
    whitened = [g.whitened(task.fixed) for g, task in zip(gathered, job.tasks, strict=True)]
    priors = [task.prior for task in job.tasks]
    if spread is not None and len(job.tasks) > 1:
        alone = [consistent_solution(w, prior) for w, prior in zip(whitened, priors, strict=True)]
        others = [[(t.leg, e) for t, e in zip(job.tasks, alone, strict=True) if t is not task] for task in job.tasks]
        priors = [pooled_prior(t.leg, t.prior, o, spread) for t, o in zip(job.tasks, others, strict=True)]
    out = []
    for done, (information, prior) in enumerate(zip(whitened, priors, strict=True)):
        out.append((solver(information, prior), null_space_solution(information, prior)))
        job.progress("solving", done + 1, len(priors))
    return out


def _pooling_note(job: Job) -> tuple[str, ...]:
    if job.settings.spread is None or len(job.tasks) < 2:
        return ()
    return (
        "the drives of the legs are taken to be alike: each joint's rotor inertia and friction lean on the other legs'",
    )


def _models(job: Job, task: LegTask, data: Gathered, estimate: Estimate) -> LegModels:
    return LegModels(
        regressor=task.regressor,
        parameters={
            "prior": task.believed,
            "prior_friction": dict(task.believed) | dict(data.friction_only),
            "identified": dict(task.fixed) | estimate.by_name(),
        },
        limits={joint: job.robot.limits[joint].effort for joint in task.leg.joints},
    )


def _leg_result(
    job: Job, task: LegTask, data: Gathered, estimate: Estimate, null_space: Estimate, scores: Mapping[str, LegScore]
) -> LegIdentification:
    structure = structural_observability(task, job.trunk)
    result = LegIdentification(
        leg=task.leg,
        model=task.believed,
        estimate=estimate,
        null_space=null_space,
        friction_only=data.friction_only,
        combinations=tuple(_known(found, estimate) for found in structure.combinations()),
        structural_rank=structure.rank,
        noise=data.noise,
        correlation=data.correlation,
        rmse={part: score.rmse for part, score in scores.items() if score.samples},
        traces=tuple(score.trace(part) for part, score in scores.items()),
    )
    return leg_warnings(result, scores)


def structural_observability(task: LegTask, trunk: TrunkMotion, samples: int = 1000) -> Observability:
    """What rich motion without noise would tell of a leg on a held trunk: algebraic rank, identifiable combinations."""
    n = len(task.leg.joints)
    rng = np.random.default_rng(0)
    motion = JointMotion(*(s * rng.uniform(-1, 1, (samples, n)) for s in (1.5, 5.0, 30.0)))
    rows = task.regressor.rows(motion, np.zeros((samples, n)), trunk, std=1e-9)
    return observability(Information.of(rows, task.regressor.columns).fix(task.fixed), task.prior)


def _known(combination: Combination, estimate: Estimate) -> KnownCombination:
    gradient = np.zeros(len(estimate.columns))
    for name, factor in combination.terms:
        gradient[estimate.columns.index(name)] = factor
    return KnownCombination(
        text=str(combination),
        prior=float(gradient @ estimate.prior.values),
        value=float(gradient @ estimate.values),
        std=float(np.sqrt(np.maximum(gradient @ estimate.covariance @ gradient, 0.0))),
        unit=unit_of(combination.terms[0][0]),
        verdict=estimate.observability.verdicts(gradient)[0],
    )
