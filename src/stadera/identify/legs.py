"""Identifies legs from logs as in section II of the paper: rows, information, observability, solution, validation.

Each leg is a fixed-base arm on the held trunk. Its torques are weighted by the noise of their own residuals and by the
residuals' correlation (for real joints they are far from white), summed up once, and the small triangle is solved.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial, reduce
from itertools import chain
from os import PathLike

import numpy as np

from stadera.body import JointMotion, TrunkMotion
from stadera.checks import Guard
from stadera.errors import IdentificationError, RecordingError
from stadera.identify.agreement import Agreement
from stadera.identify.floating import FloatingLog, KnownLegs, floating_log, remembered
from stadera.identify.gather import Gathered, LegScore, gather, information_of, with_varying_friction
from stadera.identify.job import (
    Job,
    LegTask,
    check_feet,
    check_motors,
    joints_of,
    parts_of,
    prepare,
    stands,
    wanted_legs,
)
from stadera.identify.log import Part, Section, head, require_distinct, time_span
from stadera.identify.observability import Observability, observability
from stadera.identify.result import Identification, LegIdentification
from stadera.identify.settings import IdentifySettings
from stadera.identify.solutions import Estimate, solve_legs, with_scale
from stadera.identify.trust import doubted, leg_warnings, log_warnings, trust_in
from stadera.information import Information
from stadera.logs.reader import Log, as_logs
from stadera.logs.recording import Recording
from stadera.logs.topics import LogFile
from stadera.process import one_thread
from stadera.robot.load import load_robot
from stadera.robot.model import Robot
from stadera.trunk.memory import Memory, days_of
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
        memory: what earlier logs showed of this robot; `Memory.none(robot)` begins one. The result's `memory` has these
            logs too.

    Raises:
        IdentificationError: the memory is of another robot or another model, or `settings` are none.
        RecordingError: there are no logs, or one is given twice, lacks a joint or its torque, or is too short; or feet
            carry load, without an IMU or for validation.
        UnknownNameError: no such robot, leg or joint.
        ModelError: the model file cannot be read.
        UntrustedError: units or signs of a log are wrong, or its motors are off, and `force` is false.
    """
    if not isinstance(settings, IdentifySettings | None):
        raise IdentificationError(f"settings are IdentifySettings, got {settings!r}; several logs go in a list: [a, b]")
    model = load_robot(robot)
    asked, watch = settings or IdentifySettings(), progress or (lambda *_: None)
    wanted, memory = wanted_legs(model, asked), None if memory is None else memory.check(model)
    guard = Guard(model, joints_of(model, wanted), on_feet=False)
    admitted = partial(guard.admitted, fix=fix, force=force)
    fitted = tuple(map(admitted, as_logs(logs)))
    evaluated = None if validation is None else tuple(map(admitted, as_logs(validation)))
    require_distinct((*fitted, *(evaluated or ())), guard.joints)
    on_feet = tuple(log for log in fitted if stands(log, model, wanted, asked))
    forced = tuple(str(finding) for log in fitted for finding in guard.units(log)) if force else ()
    in_air = tuple(log for log in fitted if log not in on_feet)
    _check_in_air(guard, wanted, asked, () if force else in_air, evaluated or (), fitted=bool(in_air))
    if not in_air:
        return _from_feet(model, on_feet, wanted, asked, watch, forced, memory)
    job = prepare(model, in_air, asked, watch)
    return _identified(replace(job, doubts=(*forced, *job.doubts)), in_air, on_feet, evaluated, memory)


def _check_in_air(
    guard: Guard,
    wanted: tuple[str, ...],
    asked: IdentifySettings,
    logs: Sequence[LogFile | Recording],
    evaluated: Sequence[LogFile | Recording],
    *,
    fitted: bool,
) -> None:
    """Raises UntrustedError if motors of one of the logs are off, and RecordingError if one for validation is of a
    robot on its feet, or if no log of legs in the air is `fitted`, whose torques alone are validated.
    """
    for log in evaluated:
        check_feet(head(log, guard.joints), guard.robot, wanted, asked, "legs are validated")
        if not fitted:
            what = "only torques of legs in the air are validated, and no log with such is fitted"
            raise RecordingError(f"{log.source}: {what}")
    for log in logs:
        check_motors(head(log, guard.joints), guard.robot, wanted, asked)


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
    known = _recalled(robot, memory) if all(log.memory for log in floats) else None
    informations = [_floating_information(task, floats, Information.empty(task.prior.columns), known) for task in tasks]
    posed = [(task.leg, found, task.prior) for task, found in zip(tasks, informations, strict=True)]
    agreement = _agreement(tasks, [], [], floats)
    solved = solve_legs(posed, asked.method, asked.spread, asked.solver, progress)
    estimates = [_widened(found, agreement) for found in solved]
    legs = tuple(
        LegIdentification(
            task.leg, task.nominal, found, structural_rank=found.observability.rank, information=information
        )
        for task, found, information in zip(tasks, estimates, informations, strict=True)
    )
    trust = reduce(_with_trust_of, floats[1:], floats[0].trust)
    for doubt in doubts:
        trust = trust.at_most("doubtful", doubt)
    of_memory = tuple(log.said for log in floats if log.said)
    whole = Identification(robot, "", asked.method, legs[: len(wanted)], floats[0].torque_lag, None, trust)
    return _completed(whole, logs, floats, agreement, None if kept is memory else kept, of_memory)


def _completed(
    result: Identification,
    logs: Sequence[LogFile | Recording],
    floats: Sequence[FloatingLog],
    agreement: Agreement | None,
    memory: Memory | None,
    of_memory: tuple[str, ...],
) -> Identification:
    """The result with its logs' names, and with what all logs together and those on its feet say."""
    how = "a robot on its feet: equations of its base, contact forces eliminated"
    return replace(
        result,
        source=", ".join(dict.fromkeys(log.source for log in logs)),
        trust=doubted(result.trust, result.legs),
        notes=(*result.notes, *(f"{log.source}: {how}" for log in floats), *of_memory),
        warnings=(*result.warnings, *(agreement.differs if agreement else ())),
        # the trunk of the log that tells most of its mass
        trunk=min((log.trunk for log in floats), key=lambda t: np.nan_to_num(t.mass_std, nan=np.inf), default=None),
        agreement=agreement,
        memory=memory,
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


def _recalled(robot: Robot, memory: Memory | None) -> KnownLegs | None:
    """What a memory with logs tells of the legs."""
    return None if memory is None or not memory.logs else KnownLegs.by(memory, robot)


def _with_trust_of(trust: Trust, log: FloatingLog) -> Trust:
    if log.trust.verdict == "good":
        return trust
    return trust.at_most(log.trust.verdict, f"{log.source}: {next(iter(log.trust.reasons), 'its fit is poor')}")


def _identified(
    job: Job,
    fitted: Sequence[LogFile | Recording],
    on_feet: Sequence[LogFile | Recording],
    evaluated: Sequence[LogFile | Recording] | None,
    memory: Memory | None,
) -> Identification:
    """The passes over admitted logs of legs in the air, and of the robot on its feet."""
    training, held_back, validated_on = parts_of(job, fitted, evaluated)
    job, still = _moving(job, training)
    gathered = gather(job, training, partial(_solve, job))
    kept, said = memory, ""
    if memory is not None:  # None if the logs contradict it
        known = [(task.prior, data.whitened(task.fixed)) for task, data in zip(job.tasks, gathered, strict=True)]
        kept, said = remembered(job.robot, memory, days_of(time_span(fitted[0], job.joints)[0]), known)
    recalled = None if kept is None else _recalled(job.robot, memory)
    floats = [floating_log(job.robot, log, job.progress, job.settings.width.mass) for log in on_feet]
    compared = None if evaluated else held_back  # what only validates widens no bar
    agreement = _agreed(job, fitted, training, compared, gathered, floats)
    estimates = [_widened(found, agreement) for found in _solve(job, gathered, floats, recalled)]
    legs, samples = _scored_legs(job, gathered, estimates, training, held_back)
    alike = "each joint's rotor inertia and friction draw on the other legs', as far as the log shows drives alike"
    pooled = [alike] * (job.settings.spread is not None and len(job.tasks) > 1)
    doubts = (*job.doubts, *log_warnings(job.vertical, samples, job.settings.trust))
    result = Identification(
        robot=job.robot,
        source="",
        method=job.settings.method,
        legs=legs,
        torque_lag=job.preprocessing.effort_delay,
        validated_on=validated_on if any("validation" in leg.rmse for leg in legs) else None,
        trust=reduce(_with_trust_of, floats, trust_in(job, gathered, estimates, doubts)),
        notes=(*training.notes, job.vertical.note, *job.notes, *pooled),
        warnings=(*still, *doubts),
    )
    return _completed(result, (*fitted, *on_feet), floats, agreement, kept, (said,) if said else ())


def _moving(job: Job, training: Part) -> tuple[Job, tuple[str, ...]]:
    """The job with the friction that its motion shows, and a warning on joints that do not move."""
    said, signals = [], job.settings.signals
    if not training.moves(job.drop_below):
        slowest = f"{signals.drop_below:g} rad/s"
        said = [f"no sample moves (all joint velocities stay below {slowest}): samples at rest are used"]
        job = replace(job, drop_below=0.0)
    if still := training.still(signals.travel):
        which = "all joints" if len(still) == len(job.joints) else ", ".join(j for j in job.joints if j in still)
        said.append(f"{which}: within {signals.travel:g} rad throughout: rotor inertia and friction do not show")
        job = replace(job, tasks=tuple(replace(task, still=still) for task in job.tasks))
    return with_varying_friction(job, training), tuple(said)


def _agreed(
    job: Job,
    logs: Sequence[LogFile | Recording],
    training: Part,
    held_back: Part | None,
    gathered: Sequence[Gathered],
    floats: Sequence[FloatingLog],
) -> Agreement | None:
    """Agreement of each log with the others, or of the beginning of a single one with the rest."""
    held = () if held_back is None else (held_back,)
    if len(training.stretches) > 1:
        stretches: dict[int, list[Section]] = {}
        for stretch in chain(training.stretches, *(part.stretches for part in held)):
            stretches.setdefault(id(stretch.log), []).append(stretch)
        names = [f"log {k + 1} ({own[0].log.source})" for k, own in enumerate(stretches.values())]
        known = []
        for sections in stretches.values():
            # a log has noise of its own, that its own solution leaves, in which the difference from others is not
            own = gather(job, training.of(sections, *held), partial(_solve, job))
            known.append([data.whitened(task.fixed) for task, data in zip(job.tasks, own, strict=True)])
        return _agreement(job.tasks, names, known, floats)
    if held:
        names, parts = ["the first part", "the rest"], [training, *held]
    else:
        (section,), (start, stop) = training.stretches, time_span(logs[0], job.joints)
        middle = 0.5 * (start + stop)
        names = ["the first half", "the second half"]
        halves = replace(section, stop=middle), replace(section, start=middle)
        parts = [training.of([half]) for half in halves]
    return _agreement(job.tasks, names, [information_of(job, part, gathered) for part in parts], floats, daily=True)


def _agreement(
    tasks: Sequence[LegTask],
    names: Sequence[str],
    informations: Sequence[Sequence[Information]],
    floats: Sequence[FloatingLog],
    *,
    daily: bool = False,
) -> Agreement | None:
    """Between parts of legs in the air, with `informations` by part and leg, and logs on its feet; of a single log also
    in what is `daily`, the torque offsets.
    """
    names = [*names, *(log.source for log in floats)]
    if len(names) < 2:
        return None
    legs = []
    for k, task in enumerate(tasks):
        own = [part[k] for part in informations]
        if floats or not daily:
            lasting = [c for c in task.prior.columns if not c.endswith(".offset")]
            own = [part.marginal(lasting) for part in own]
        legs.append(([*own, *(log.of_leg(task.leg.name, task.fixed, offsets=False) for log in floats)], task.prior))
    return Agreement.of(names, legs)


def _widened(found: Estimate, agreement: Agreement | None) -> Estimate:
    if agreement is None:
        return found
    return replace(found, covariance=agreement.widened(found.columns, found.covariance))


def _scored_legs(
    job: Job,
    gathered: Sequence[Gathered],
    estimates: Sequence[Estimate],
    training: Part,
    held_back: Part | None,
) -> tuple[tuple[LegIdentification, ...], int]:
    """Results of the requested legs, evaluated on both parts, and the largest number of moving samples."""
    parts = {"training": ("scoring", training)}
    if held_back is not None:
        parts["validation"] = "validating", held_back
    wanted = list(zip(job.tasks, gathered, estimates, strict=True))[: job.wanted]
    scores = [{part: _unscored(job, *leg) for part in parts} for leg in wanted]
    for name, (what, part) in parts.items():
        for done, chunk in enumerate(part):
            for found in scores:
                found[name].add(chunk, job.trunk, job.drop_below)
            job.progress(what, done + 1, 0)
    legs = tuple(_leg_result(job, *leg, found) for leg, found in zip(wanted, scores, strict=True))
    return legs, max(found["training"].samples for found in scores)


def _unscored(job: Job, task: LegTask, data: Gathered, estimate: Estimate) -> LegScore:
    parameters = {
        "prior": task.nominal,
        "prior_friction": dict(task.nominal) | dict(data.friction_only),
        "identified": dict(task.fixed) | estimate.by_name(),
    }
    return LegScore(task, parameters, {joint: job.robot.limits[joint].effort for joint in task.leg.joints})


def _solve(
    job: Job, gathered: Sequence[Gathered], floats: Sequence[FloatingLog] = (), recalled: KnownLegs | None = None
) -> list[Estimate]:
    own = [with_scale(g.whitened(t.fixed), job.settings.width.gain) for t, g in zip(job.tasks, gathered, strict=True)]
    legs = [
        (t.leg, _floating_information(t, floats, known, recalled), t.prior)
        for t, known in zip(job.tasks, own, strict=True)
    ]
    return solve_legs(legs, job.settings.method, job.settings.spread, job.settings.solver, job.progress)


def _leg_result(
    job: Job, task: LegTask, data: Gathered, estimate: Estimate, scores: Mapping[str, LegScore]
) -> LegIdentification:
    held_out = scores.get("validation")
    evaluated = held_out.excess(job.settings.trust.matters) if held_out is not None and held_out.samples else {}
    result = LegIdentification(
        leg=task.leg,
        model=task.nominal,
        estimate=estimate,
        friction_only=data.friction_only,
        structure=structural_observability(task.constant, job.trunk).combinations(),
        structural_rank=structural_observability(task, job.trunk).rank,
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
