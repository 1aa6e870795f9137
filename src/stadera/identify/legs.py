"""Identifies legs from logs as in section II of the paper: rows, information, observability, solution, validation.

Each leg is a fixed-base arm on the held trunk. Its torques are weighted by the noise of their own residuals and by the
residuals' correlation (for real joints they are far from white), summed up once, and the small triangle is solved.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial, reduce
from os import PathLike

import numpy as np

from stadera.body import JointMotion, TrunkMotion
from stadera.checks import Guard
from stadera.identify.agreement import Agreement
from stadera.identify.floating import FloatingLog, KnownLegs, floating_log, remembered
from stadera.identify.gather import (
    Gathered,
    LegModels,
    LegScore,
    gather,
    information_of,
    scored,
    with_noise_of,
    with_varying_friction,
)
from stadera.identify.job import Job, LegTask, joints_of, parts_of, prepare, stands, wanted_legs
from stadera.identify.log import Part, Section, time_span
from stadera.identify.observability import Combination, Observability, gradients_of, observability
from stadera.identify.result import Identification, KnownCombination, LegIdentification, unit_of
from stadera.identify.settings import IdentifySettings
from stadera.identify.solutions import Estimate, solve_legs, with_scale
from stadera.identify.trust import leg_warnings, log_warnings, trust_in
from stadera.information import Information
from stadera.logs.reader import Log, as_logs
from stadera.logs.recording import Recording
from stadera.logs.topics import LogFile
from stadera.process import one_thread
from stadera.robot.load import load_robot
from stadera.robot.model import Robot
from stadera.trunk.memory import Memory, days_of
from stadera.trunk.result import TrunkParameters
from stadera.trust import Trust
from stadera.types import Progress

__all__ = ["IdentifySettings", "identify"]


@one_thread()
def identify(
    robot: Robot | str | PathLike[str],
    logs: Log | Iterable[Log],
    settings: IdentifySettings | None = None,
    validation: Log | Iterable[Log] | None = None,
    progress: Progress | None = None,
    *,
    fix: bool = False,
    force: bool = False,
    memory: Memory | None = None,
) -> Identification:
    """Identifies the inertia, rotor inertia and friction of legs that swing freely while the trunk is held.

    Args:
        robot: the prior (CAD) model: a robot, its name, or a path to a URDF or MJCF.
        logs: one or several recordings, or paths and LogFiles, which are streamed; their information is merged.
        settings: see `IdentifySettings`.
        validation: separate logs for validation; then all of `logs` is used for training.
        progress: called with the step's name, items done and total (0 if unknown).
        fix: correct units and signs of the logs that are certainly wrong, and add a note.
        force: use logs whose units or signs are wrong; `trust` says so.
        memory: what earlier logs told of this robot; `Memory.none(robot)` begins one. The result's `memory` has these
            logs too.

    Raises:
        IdentificationError: the memory is of another robot or another model.
        RecordingError: there are no logs, or they lack a joint or its torque, are too short, or feet carry load.
        UnknownNameError: no such robot, leg or joint.
        ModelError: the model file cannot be read.
        UntrustedError: units or signs of a log are wrong, and `force` is false.
    """
    model = load_robot(robot)
    asked, watch = settings or IdentifySettings(), progress or (lambda *_: None)
    wanted, memory = wanted_legs(model, asked), None if memory is None else memory.check(model)
    guard = Guard(model, joints_of(model, wanted), on_feet=False)
    admitted = partial(guard.admitted, fix=fix, force=force)
    fitted = tuple(map(admitted, as_logs(logs)))
    evaluated = None if validation is None else tuple(map(admitted, as_logs(validation)))
    on_feet = tuple(log for log in fitted if stands(log, model, wanted, asked))
    forced = tuple(str(finding) for log in fitted for finding in guard.units(log)) if force else ()
    in_air = tuple(log for log in fitted if log not in on_feet)
    if not in_air:
        return _from_feet(model, on_feet, wanted, asked, watch, forced, memory)
    job = prepare(model, in_air, asked, watch)
    return _identified(replace(job, doubts=(*forced, *job.doubts)), in_air, on_feet, evaluated, memory)


def _from_feet(
    robot: Robot,
    logs: Sequence[LogFile | Recording],
    wanted: tuple[str, ...],
    asked: IdentifySettings,
    progress: Progress,
    doubts: tuple[str, ...],
    memory: Memory | None,
) -> Identification:
    """By logs of a robot on its feet alone, whose prior are the model's values."""
    names = (*wanted, *(leg.name for leg in robot.legs if leg.name not in wanted and asked.spread is not None))
    tasks = [LegTask.of(robot, robot.leg(name), asked) for name in names]
    floats: list[FloatingLog] = []
    kept = memory
    for log in logs:
        floats.append(floating_log(robot, log, progress, asked.width.mass, kept))
        kept = floats[-1].memory or kept
    agree = memory is not None and memory.logs and all(log.memory for log in floats)
    known = KnownLegs.by(memory, robot) if memory is not None and agree else None
    told = [_floating_information(task, floats, Information.empty(task.prior.columns), known) for task in tasks]
    posed = [(task.leg, found, task.prior) for task, found in zip(tasks, told, strict=True)]
    agreement = _agreement(tasks, [log.source for log in floats], [], floats)
    estimates = solve_legs(posed, asked.method, asked.spread, asked.solver, progress)
    estimates = [_widened(found, agreement) for found in estimates]
    ranks = [found.observability.rank for found, _ in estimates]
    legs = tuple(
        LegIdentification(task.leg, task.nominal, *found, structural_rank=rank, information=information)
        for task, found, rank, information in zip(tasks, estimates, ranks, told, strict=True)
    )
    trust = reduce(_with_trust_of, floats[1:], floats[0].trust)
    for doubt in doubts:
        trust = trust.at_most("doubtful", doubt)
    return Identification(
        robot=robot,
        source=", ".join(dict.fromkeys(log.source for log in floats)),
        method=asked.method,
        legs=legs[: len(wanted)],
        torque_lag=floats[0].torque_lag,
        validated_on=None,
        trust=trust,
        notes=(*_feet_notes(floats), *(log.said for log in floats if log.said)),
        warnings=agreement.differs if agreement else (),
        trunk=_best_trunk(floats),
        agreement=agreement,
        memory=None if kept is memory else kept,
    )


def _floating_information(
    task: LegTask, floats: Sequence[FloatingLog], own: Information, known: KnownLegs | None = None
) -> Information:
    """A leg's information with that of logs on its feet, and of the robot's memory; offsets are those of the only log,
    or of the legs in the air.
    """
    alone = len(floats) == 1 and not own.count
    logs = [log.of_leg(task.leg.name, task.fixed, offsets=alone) for log in floats]
    logs += [] if known is None else [known.of_leg(task.leg.name, task.fixed, offsets=False)]
    return reduce(Information.merge, logs, own)


def _with_trust_of(trust: Trust, log: FloatingLog) -> Trust:
    if log.trust.verdict == "good":
        return trust
    return trust.at_most(log.trust.verdict, f"{log.source}: {next(iter(log.trust.reasons), 'its fit is poor')}")


def _best_trunk(floats: Sequence[FloatingLog]) -> TrunkParameters | None:
    """The trunk of the log that tells most of its mass."""
    return min((log.trunk for log in floats), key=lambda t: np.nan_to_num(t.mass_std, nan=np.inf), default=None)


def _feet_notes(floats: Sequence[FloatingLog]) -> tuple[str, ...]:
    how = "a robot on its feet: equations of its base, contact forces eliminated"
    return tuple(f"{log.source}: {how}" for log in floats)


def _identified(
    job: Job,
    fitted: Sequence[LogFile | Recording],
    on_feet: Sequence[LogFile | Recording],
    evaluated: Sequence[LogFile | Recording] | None,
    memory: Memory | None,
) -> Identification:
    """The passes over admitted logs of legs in the air, and of the robot on its feet."""
    training, held_back, validated_on = parts_of(job, fitted, evaluated)
    at_rest = not training.moves(job.drop_below)
    slowest = f"{job.settings.signals.drop_below:g} rad/s"
    still = [f"no sample moves (all joint velocities stay below {slowest}): samples at rest are used"] * at_rest
    if at_rest:
        job = replace(job, drop_below=0.0)
    job = with_varying_friction(job, training)
    gathered = gather(job, training)
    gathered = with_noise_of(job, training, gathered, [asked for asked, _ in _solve(job, gathered)])
    kept, said = _remembered(job, fitted, gathered, memory)
    recalled = None if kept is None or memory is None or not memory.logs else KnownLegs.by(memory, job.robot)
    estimates = _solve(job, gathered, recalled=recalled)
    floats: list[FloatingLog] = []
    if on_feet:
        floats = [floating_log(job.robot, log, job.progress, job.settings.width.mass) for log in on_feet]
        estimates = _solve(job, gathered, floats, recalled)
    names, parts = _compared_parts(job, fitted, training, held_back)
    # a log has noise of its own, in which the difference from others is not
    several = len(parts) > 2 or names[0].startswith("log ")
    told = [_alone(job, part) if several else information_of(job, part, gathered) for part in parts]
    agreement = _agreement(job.tasks, [*names, *(log.source for log in floats)], told, floats)
    estimates = [_widened(found, agreement) for found in estimates]
    legs, samples = _scored_legs(job, gathered, estimates, training, held_back)
    alike = "the drives of the legs are assumed alike: each joint's rotor inertia and friction draw on the other legs'"
    pooled = [alike] * (job.settings.spread is not None and len(job.tasks) > 1)
    doubts = (*job.doubts, *log_warnings(job.vertical, legs, samples, job.settings.trust))
    return Identification(
        robot=job.robot,
        source=", ".join(dict.fromkeys(log.source for log in (*fitted, *on_feet))),
        method=job.settings.method,
        legs=legs,
        torque_lag=job.preprocessing.effort_delay,
        validated_on=validated_on if any("validation" in leg.rmse for leg in legs) else None,
        trust=reduce(_with_trust_of, floats, trust_in(job, gathered, [asked for asked, _ in estimates], doubts)),
        notes=(*training.notes, job.vertical.note, *job.notes, *pooled, *_feet_notes(floats), *filter(None, [said])),
        trunk=_best_trunk(floats),
        warnings=(*still, *doubts, *(agreement.differs if agreement else ())),
        agreement=agreement,
        memory=kept,
    )


def _remembered(
    job: Job, logs: Sequence[LogFile | Recording], gathered: Sequence[Gathered], memory: Memory | None
) -> tuple[Memory | None, str]:
    """The memory with the logs of legs in the air, None if they contradict it, and what to say of it."""
    if memory is None:
        return None, ""
    legs = [(task.prior, data.whitened(task.fixed)) for task, data in zip(job.tasks, gathered, strict=True)]
    return remembered(job.robot, memory, days_of(time_span(logs[0], job.joints)[0]), legs)


def _alone(job: Job, part: Part) -> list[Information]:
    """Information of one log on each leg, in units of the noise that its own solution leaves."""
    own = gather(job, part)
    own = with_noise_of(job, part, own, [asked for asked, _ in _solve(job, own)])
    return [data.whitened(task.fixed) for task, data in zip(job.tasks, own, strict=True)]


def _compared_parts(
    job: Job, logs: Sequence[LogFile | Recording], training: Part, held_back: Part | None
) -> tuple[list[str], list[Part]]:
    """Parts to compare: each log, or the beginning and the rest of a single one."""
    rest = () if held_back is None else held_back.stretches
    held = () if held_back is None else (held_back,)
    if len(training.stretches) > 1 or len(rest) > 1 or (rest and rest[0].log is not training.stretches[0].log):
        stretches: dict[int, list[Section]] = {}
        for stretch in (*training.stretches, *rest):
            stretches.setdefault(id(stretch.log), []).append(stretch)
        names = [f"log {k + 1} ({own[0].log.source})" for k, own in enumerate(stretches.values())]
        return names, [training.of(own, *held) for own in stretches.values()]
    if not rest:
        start, stop = time_span(logs[0], job.joints)
        own, middle = training.stretches[0], 0.5 * (start + stop)
        halves = replace(own, stop=middle), replace(own, start=middle)
        return ["the first half", "the second half"], [training.of([half]) for half in halves]
    return ["the first part", "the rest"], [training, *held]


def _agreement(
    tasks: Sequence[LegTask], names: Sequence[str], told: Sequence[Sequence[Information]], floats: Sequence[FloatingLog]
) -> Agreement | None:
    """Between parts of legs in the air, with `told` by part and leg, and logs on its feet."""
    if len(names) < 2:
        return None
    single = not floats and len(told) == 2 and not names[0].startswith("log ")
    legs = []
    for k, task in enumerate(tasks):
        lasting = [c for c in task.prior.columns if not c.endswith(".offset")]
        own = [part[k] if single else part[k].marginal(lasting) for part in told]
        legs.append(([*own, *(log.of_leg(task.leg.name, task.fixed, offsets=False) for log in floats)], task.prior))
    return Agreement.of(names, legs)


def _widened(found: tuple[Estimate, Estimate], agreement: Agreement | None) -> tuple[Estimate, Estimate]:
    if agreement is None:
        return found
    first, second = (replace(e, covariance=agreement.widened(e.columns, e.covariance)) for e in found)
    return first, second


def _scored_legs(
    job: Job,
    gathered: Sequence[Gathered],
    estimates: Sequence[tuple[Estimate, Estimate]],
    training: Part,
    held_back: Part | None,
) -> tuple[tuple[LegIdentification, ...], int]:
    """Results of the requested legs, evaluated on both parts, and the largest number of moving samples."""
    wanted = range(job.wanted)
    models = [_models(job, job.tasks[k], gathered[k], estimates[k][0]) for k in wanted]
    scores = {"training": scored(job.step("scoring"), training, models, job.trunk, job.drop_below)}
    if held_back is not None:
        scores["validation"] = scored(job.step("validating"), held_back, models, job.trunk, job.drop_below)
    legs = tuple(
        _leg_result(job, job.tasks[k], gathered[k], *estimates[k], {part: score[k] for part, score in scores.items()})
        for k in wanted
    )
    return legs, max(score.samples for score in scores["training"])


def _solve(
    job: Job, gathered: Sequence[Gathered], floats: Sequence[FloatingLog] = (), recalled: KnownLegs | None = None
) -> list[tuple[Estimate, Estimate]]:
    own = [with_scale(g.whitened(t.fixed), job.settings.width.gain) for t, g in zip(job.tasks, gathered, strict=True)]
    legs = [
        (t.leg, _floating_information(t, floats, known, recalled), t.prior)
        for t, known in zip(job.tasks, own, strict=True)
    ]
    return solve_legs(legs, job.settings.method, job.settings.spread, job.settings.solver, job.progress)


def _models(job: Job, task: LegTask, data: Gathered, estimate: Estimate) -> LegModels:
    parameters = {
        "prior": task.nominal,
        "prior_friction": dict(task.nominal) | dict(data.friction_only),
        "identified": dict(task.fixed) | estimate.by_name(),
    }
    return LegModels(task, parameters, {joint: job.robot.limits[joint].effort for joint in task.leg.joints})


def _leg_result(
    job: Job, task: LegTask, data: Gathered, estimate: Estimate, null_space: Estimate, scores: Mapping[str, LegScore]
) -> LegIdentification:
    structure = structural_observability(task, job.trunk)
    lasting = structural_observability(task.constant, job.trunk).combinations()
    part = scores.get("validation", scores["training"])
    evaluated = part.excess() if part.samples else {}
    result = LegIdentification(
        leg=task.leg,
        model=task.nominal,
        estimate=estimate,
        null_space=null_space,
        friction_only=data.friction_only,
        combinations=tuple(_known(found, estimate) for found in lasting),
        structural_rank=structure.rank,
        noise=data.noise,
        rmse={part: score.rmse for part, score in scores.items() if score.samples},
        traces=tuple(score.trace(part) for part, score in scores.items()),
        information=task.lasting(data.whitened(task.fixed)),
        varying=task.varying,
        worse=tuple(name for name, excess in evaluated.items() if excess > job.settings.trust.worse),
    )
    return leg_warnings(result, scores, job.settings.trust)


def structural_observability(task: LegTask, trunk: TrunkMotion, samples: int = 1000) -> Observability:
    """Observability of a leg on a held trunk in rich motion without noise: the algebraic rank and combinations."""
    n = len(task.leg.joints)
    rng = np.random.default_rng(0)
    motion = JointMotion(*(s * rng.uniform(-1, 1, (samples, n)) for s in (1.5, 5.0, 30.0)))
    rows = task.rows(motion, np.zeros((samples, n)), trunk, std=1e-9)
    return observability(Information.of(rows, task.columns).fix(task.fixed), task.prior)


def _known(combination: Combination, estimate: Estimate) -> KnownCombination:
    gradient = gradients_of([combination], estimate.columns)[0]
    return KnownCombination(
        text=str(combination),
        prior=float(gradient @ estimate.prior.values),
        value=float(gradient @ estimate.values),
        std=float(np.sqrt(np.maximum(gradient @ estimate.covariance @ gradient, 0.0))),
        unit=unit_of(combination.terms[0][0]),
        verdict=estimate.observability.verdicts(gradient)[0],
    )
