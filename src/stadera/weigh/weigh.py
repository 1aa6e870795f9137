"""Weighs a robot from a log: chooses the estimator, runs it, refuses a result that cannot be trusted; inspects logs."""

from dataclasses import dataclass, replace
from numbers import Real
from os import PathLike

import numpy as np

from stadera.checks import Finding, Guard
from stadera.checks.limits import CheckLimits
from stadera.checks.other_robot import other_robots
from stadera.errors import IdentificationError, RecordingError, StaderaError, UntrustedError, positive
from stadera.logs.columns import HALF_IMU
from stadera.logs.reader import Log, as_log
from stadera.logs.recording import Recording
from stadera.process import one_thread
from stadera.robot import load_robot
from stadera.robot.limbs import place_of
from stadera.robot.model import Robot
from stadera.trunk.load import SIGNIFICANT
from stadera.trunk.memory import Memory
from stadera.trunk.registry import method_of
from stadera.trust import Trust
from stadera.types import Progress
from stadera.weigh.pipeline import Request, weighed
from stadera.weigh.reading import CheckedLog, with_extra_joints
from stadera.weigh.result import Weighing
from stadera.weigh.settings import IN_MOTION, TestWeight, Watch, WeighSettings, check_choice, tare_of, weight_std

AT_REST = "standing"
"""Name in `METHODS` of the library's method at rest."""


@one_thread()
def weigh(
    robot: Robot | str | PathLike[str],
    log: Log,
    tare: tuple[float, float] | Log | None = None,
    method: str | None = None,
    *,
    imu_frame: str | None = None,
    stiffness: tuple[float, float, float] | None = None,
    force: bool = False,
    fix: bool = False,
    settings: WeighSettings | None = None,
    progress: Progress | None = None,
    watch: Watch | None = None,
    weight: float | tuple[float, float] | None = None,
    known: TestWeight | None = None,
    memory: Memory | None = None,
    at: str | None = None,
) -> Weighing:
    """Weighs the trunk of a robot, with everything attached to it, and the payload added since a tare.

    Args:
        robot: a robot, its name, or the path of its model file.
        log: joint positions and torques, and velocities and an IMU if available: a path, a LogFile or a Recording.
        tare: a range (begin, end) of the log's time [s] or another log in which the robot carries no payload. A range
            wholly before the log's first stamp counts from there, as for a log with Unix time.
        method: name from `stadera.trunk.registry.METHODS`, or FILE.py:Name for an estimator of your own, see
            `stadera.trunk.registry`. None chooses "walking" (any motion, standing included) for a
            log with an IMU and at least 50 samples a second; otherwise "standing", at rest.
        imu_frame: frame of the IMU's values; None for the one named in the log, else the model's.
        stiffness: of the trunk controller about the trunk's axes [N·m/rad], for the method "orientation" only.
        force: return a result even if it cannot be trusted; `trust` and every output say so.
        fix: correct what is certainly wrong with the log (units, signs, order of joints), and add a note.
        settings: None for the defaults.
        progress: called with the step's name, samples done and total.
        watch: called with samples (IMU values in trunk axes) and the estimator, in motion only.
        weight: mass of the whole robot on a scale [kg], or (mass, standard deviation): at the tare, else at the log's
            beginning. It removes what the torques' common scale adds to the bars. In motion only.
        known: the payload since the tare, if its owner knows it: it calibrates gains and offsets. In motion only.
        memory: what earlier logs showed of this robot; `Memory.none(robot)` begins one. The result's `memory` has this
            log besides. In motion only.
        at: link or frame of the model on which the payload is, such as a hand's: its mass and centre in that frame,
            by what the legs and the limb's own joints feel; the trunk is without it. None compares trunk, torso, and
            the ends of all limbs, and says which is the likeliest (`Payload.places`). In motion only.

    Raises:
        ModelError, UnknownNameError: no such robot, method, link or frame.
        RecordingError: the log cannot be read, or lacks a joint, its torque, or the IMU that the method needs.
        IdentificationError: the log contains no usable data, or none within the tare; options that do not fit the
            method.
        UntrustedError: units or signs of the log are wrong, or it contradicts the model or itself, without `force`.
    """
    check_choice(method, stiffness)
    tare, chosen = _range(tare), settings or WeighSettings()
    logs = [log] if tare is None or isinstance(tare, tuple) else [log, tare]
    model, read, said = with_extra_joints(load_robot(robot), *map(as_log, logs))
    if fix:
        guard = Guard(model, model.tree.joints, imu_frame=imu_frame)
        model, read, said = with_extra_joints(model, *(guard.mended(each) for each in read))  # posed by sound values
    source, *others = (CheckedLog(model, each, chosen, imu_frame, force) for each in read)
    span = _in_time_of(source, tare) if isinstance(tare, tuple) else None
    on_scale = weight if isinstance(weight, tuple) or weight is None else (weight, weight_std(weight))
    request = Request(
        model,
        method or _choose_method(source, others, chosen),
        chosen,
        others[0] if others else span,
        stiffness,
        progress,
        watch,
        on_scale,
        known,
        memory,
        at,
    )
    _check_request(request, source, others)
    return _with_doubts_of_model(weighed(request, source), said, force, on_scale=weight is not None)


def _with_doubts_of_model(result: Weighing, said: tuple[str, ...], force: bool, *, on_scale: bool) -> Weighing:
    """The result with notes, and with what its robot's legs and mass say of its trust. Raises UntrustedError: it is not
    to be trusted, and not forced.
    """
    if result.trust.verdict == "bad" and not force:
        raise UntrustedError(f"{result.source}: not to be trusted: {'; '.join(result.trust.reasons)}")
    trust = result.trust.with_legs(result.robot.distrust)
    doubt, note = _of_its_mass(result, on_scale)
    trust = trust.at_most("doubtful", doubt) if doubt else trust
    return replace(result, trust=trust, notes=(*said, *filter(None, [note]), *result.notes))


def _choose_method(log: CheckedLog, others: list[CheckedLog], settings: WeighSettings) -> str:
    """Chooses the method for a log: in motion, standing included, with an IMU and at least 50 samples a second,
    otherwise at rest. A tare's log needs an IMU as well. Raises RecordingError for a log with half an IMU, of which
    perhaps only a column's name is not known.
    """
    first = log.first
    if first.imu is None:
        if half := next((note for note in first.notes if note.startswith(HALF_IMU)), ""):
            raise RecordingError(
                f"{first.source}: {half}: name it with --columns, or weigh without the IMU, at rest only, by "
                f"--method {AT_REST}"
            )
        return AT_REST
    slow = settings.too_slow(first.time)
    return AT_REST if slow or any(other.first.imu is None for other in others) else IN_MOTION


def _check_request(request: Request, log: CheckedLog, others: list[CheckedLog]) -> None:
    """Checks that robot, method and options of a request suit each other and the logs. Raises RecordingError or
    IdentificationError.
    """
    robot, at, source, method = request.robot, request.at, log.source, method_of(request.method)
    if at is not None and place_of(robot, at).body >= len(robot.tree.joints) and log.first.others is None:
        raise RecordingError(f"{source.source}: --at {at}: the log lacks the joints that carry it")
    if request.weight is not None:
        positive("a robot's weight on a scale", request.weight[0], "kg", IdentificationError)
    if not isinstance(request.known, TestWeight | None):
        got = type(request.known).__name__
        raise IdentificationError(f"known takes a stadera.weigh.TestWeight(mass, com), got {got}")
    if not isinstance(request.memory, Memory | None):
        got = type(request.memory).__name__
        raise IdentificationError(
            f"memory takes a stadera.trunk.memory.Memory, as Memory.read(path, robot) gives it, got {got}"
        )
    _check_options(request, source.source)
    if method.needs_imu:
        for each in [log] if method.at_rest else [log, *others]:
            each.require_imu(request.method)
    topics = None if isinstance(source, Recording) else source.topics.imu
    for option, named in (("--imu-topic", topics), ("--imu-frame", log.imu_frame)):
        if named is not None and log.first.imu is None:
            raise RecordingError(f"{source.source}: {option} {named}: the log has no IMU that can be used")
    if (unfelt := [leg.name for leg in robot.legs if any(leg.unfelt)]) and method.at_rest:
        raise IdentificationError(
            f"{source.source}: {request.method!r} weighs on feet whose contact their joints tell; those of "
            f"{', '.join(unfelt)} are too few for a component of it, whose bound {IN_MOTION!r} knows, also at rest, in "
            f"a log with an IMU"
        )


def _check_options(request: Request, source: str) -> None:
    """Checks that the method uses all that the request has."""
    both = (IN_MOTION, AT_REST)
    limited = (
        (request.watch, "only weighing in motion can be watched", both[:1]),
        (request.weight, "a weight is used", both),
        (request.known or request.memory, "a test weight and a memory are used", both),
        (request.at, "a payload elsewhere than on the trunk is weighed in motion only", both[:1]),
    )
    for asked, what, by in limited:
        if asked is not None and request.method not in by:
            only = " or ".join(map(repr, by))
            raise IdentificationError(f"{source}: {what}, by {only}; this log is weighed by {request.method!r}")


def _range(tare: object) -> tuple[float, float] | Log | None:
    """A tare's range as a pair; a list or an array of two numbers is one too. IdentificationError: another range."""
    if isinstance(tare, str) and isinstance(span := tare_of(tare), tuple):
        raise IdentificationError(f"a tare {tare!r}: a range of time is a pair of numbers, {span}")
    if isinstance(tare, tuple | list | np.ndarray | Real):
        ends = () if isinstance(tare, Real) else tuple(tare)
        if not (len(ends) == 2 and all(isinstance(end, Real) for end in ends)):
            raise IdentificationError(f"a tare's range is a pair of numbers (begin, end) [s], got {tare!r:.60}")
        return float(ends[0]), float(ends[1])
    return tare  # type: ignore[return-value]


def _of_its_mass(result: Weighing, on_scale: bool) -> tuple[str, str]:
    """A doubt and a note, or empty, if the robot as it was at the tare is as heavy as another one known by name, or,
    unless it stood on a scale, far heavier than its model.
    """
    robot, payload, limits = result.robot, result.payload, CheckLimits()
    if not np.isfinite(result.mass):
        return "", ""
    added = 0.0 if payload is None or payload.at else payload.mass
    mass = robot.mass + result.mass - robot.inertias[robot.trunk].mass - added
    what = "with all that is on it" if payload is None else "without the payload"
    has, ratio = f"the robot has {mass:.3g} kg {what}, {robot.name} {robot.mass:.3g} kg", mass / robot.mass
    if others := other_robots(robot, mass, payload is None):
        text = f"{has}: perhaps it is {' or '.join(others[:3])}; or it"
        return ("", f"{text} carries a load") if payload is None else (f"{text} carried a load at the tare", "")
    if payload is None or on_scale or ratio - 1.0 < max(limits.bare, SIGNIFICANT * result.mass_std / robot.mass):
        return "", ""
    larger = f"all torques are up to {ratio:.2g} times too large, and the payload with them"
    return "", f"{has}: something is on it that the model lacks, or {larger}; a scale tells (--weight)"


def _in_time_of(log: CheckedLog, tare: tuple[float, float]) -> tuple[float, float]:
    """The tare's range in the log's own time; one before the log counts from its beginning. Raises
    IdentificationError: it does not begin before its end.
    """
    (begin, end), first = tare, log.begin
    if not begin < end:
        raise IdentificationError(f"a tare's range needs a beginning before its end, got {tare} s")
    return (first + begin, first + end) if 0.0 <= begin < end < first else tare


@dataclass(frozen=True)
class Inspection:
    """Result of inspecting a log: faults of its first chunk, in which most show, and notes on joints that belong to no
    leg.
    """

    findings: tuple[Finding, ...]
    refusal: str = ""  # why weighing fails, one line; empty if it succeeds
    trust: Trust | None = None  # of the weighing; None if it was refused, or if the robot is in the air
    notes: tuple[str, ...] = ()

    @property
    def sound(self) -> bool:
        """True if no fault was found and weighing succeeds."""
        return not self.findings and self.trust is not None and self.trust.verdict == "good"


def inspected(
    robot: Robot, log: Log, imu_frame: str | None = None, *, fix: bool = False, progress: Progress | None = None
) -> Inspection:
    """Checks a log, and weighs from it unless the robot is in the air. Arguments as in `stadera.weigh`. Raises
    RecordingError: the log cannot be read.
    """
    robot, (source,), notes = with_extra_joints(robot, as_log(log))
    guard = Guard(robot, robot.tree.joints, imu_frame=imu_frame)
    if fix:
        robot, (source,), notes = with_extra_joints(robot, guard.mended(source))
    findings = guard.findings(source)
    if any(finding.cause == "not_on_feet" for finding in findings):
        return Inspection(findings, notes=notes)
    try:
        trust = weigh(robot, source, imu_frame=imu_frame, progress=progress).trust
        return Inspection(findings, trust=trust, notes=notes)
    except StaderaError as error:
        return Inspection(findings, str(error), notes=notes)
