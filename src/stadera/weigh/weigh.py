"""Weighs a robot from a log: chooses the estimator, runs it, refuses a result that cannot be trusted; inspects logs."""

from dataclasses import dataclass, replace
from numbers import Real
from os import PathLike

import numpy as np

from stadera.checks import Finding, Guard
from stadera.checks.other_robot import other_robots
from stadera.errors import IdentificationError, StaderaError, UntrustedError
from stadera.logs import LogFile
from stadera.logs.reader import Log, as_log, read_head
from stadera.logs.topics import OpenedLog
from stadera.robot import load_robot
from stadera.robot.model import Robot
from stadera.threads import one_thread
from stadera.trust import Trust
from stadera.types import Progress
from stadera.weigh.at_rest import weigh_at_rest
from stadera.weigh.in_motion import weigh_in_motion
from stadera.weigh.reading import choose_method, with_extra_joints
from stadera.weigh.result import Weighing
from stadera.weigh.settings import (
    IN_MOTION,
    Request,
    Source,
    Watch,
    WeighSettings,
    check_choice,
    is_in_motion,
    weight_of,
)


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
) -> Weighing:
    """Weighs the trunk of a robot, with everything attached to it, and the payload added since a tare.

    Args:
        robot: a robot, its name, or the path of its model file.
        log: joint positions and torques, and velocities and an IMU if available: a path, a LogFile or a Recording.
        tare: a range (begin, end) of the log's time [s] or another log in which the robot carries no payload. A range
            wholly before the log's first stamp counts from there, as for a log with Unix time.
        method: name from `stadera.trunk.registry.METHODS`, or FILE.py:Name for an estimator of your own, see
            `stadera.weigh.own`. None chooses "walking" (any motion, standing included) for a
            log with an IMU and at least 50 samples a second; otherwise a method at rest: "contact" with an IMU, "poses"
            without.
        imu_frame: frame of the IMU's values; None for the one named in the log, else the model's.
        stiffness: of the trunk controller about the trunk's axes [N·m/rad], for the method "orientation" only.
        force: return a result even if it cannot be trusted; `trust` and every output say so.
        fix: correct what is certainly wrong with the log (units, signs, order of joints), and add a note.
        settings: None for the defaults.
        progress: called with the step's name, samples done and total.
        watch: called with samples (IMU values in trunk axes) and the estimator, in motion only.
        weight: mass of the whole robot on a scale [kg], or (mass, standard deviation): at the tare, else at the log's
            beginning. It removes what the torques' common scale adds to the bars. In motion only.

    Raises:
        ModelError, UnknownNameError: no such robot, method or frame.
        RecordingError: the log cannot be read, or lacks a joint, its torque, or the IMU that the method needs.
        IdentificationError: the log contains no usable data, or none within the tare; options that do not fit the
            method.
        UntrustedError: units or signs of the log are wrong, or it contradicts the model or itself, without `force`.
    """
    check_choice(method, stiffness)
    tare = _range(tare)
    model, chosen = load_robot(robot), settings or WeighSettings()
    logs = [log] if tare is None or isinstance(tare, tuple) else [log, tare]
    model, read, said = with_extra_joints(model, *map(as_log, logs))
    guard = Guard(model, model.tree.joints, imu_frame=imu_frame)
    source, *others = [guard.admitted(_opened(each), fix=fix, force=force) for each in read]
    span, shifted = _in_time_of(source, tare, model) if isinstance(tare, tuple) else (None, ())
    unloaded = others[0] if others else span
    name = method or choose_method(model, source, unloaded, chosen)
    if not is_in_motion(name) and not model.quadruped:
        raise IdentificationError(
            f"{source.source}: the method {name!r}, at rest, is for four legs of three joints; {model.name} is weighed "
            f"by {IN_MOTION!r}, which needs an IMU and 50 samples a second"
        )
    on_scale = weight_of(f"{weight}") if isinstance(weight, int | float) else weight
    request = Request(model, source, unloaded, name, imu_frame, stiffness, force, chosen, progress, watch, on_scale)
    result = _trusted(request)
    trust = result.trust.with_legs(model.distrust)
    if kin := _other_robots(model, result):
        if result.payload is None:
            shifted = (*shifted, f"{kin}; or it carries a load")
        else:
            trust = trust.at_most("doubtful", f"{kin}; or it carried a load at the tare")
    return replace(result, trust=trust, notes=(*said, *shifted, *result.notes))


def _range(tare: object) -> tuple[float, float] | Log | None:
    """A tare's range as a pair; a list or an array of two numbers is one too."""
    if isinstance(tare, list | np.ndarray) and len(tare) == 2 and all(isinstance(end, Real) for end in tare):
        return float(tare[0]), float(tare[1])
    return tare  # type: ignore[return-value]


def _other_robots(robot: Robot, result: Weighing) -> str:
    """Says that the robot, as it was at the tare, is as heavy as another one known by name; empty if it is not."""
    if not np.isfinite(result.mass):
        return ""
    added = 0.0 if result.payload is None else result.payload.mass
    mass = robot.mass + result.mass - robot.inertias[robot.trunk].mass - added
    others = other_robots(robot, mass, result.payload is None)
    what = "with all that is on it" if result.payload is None else "without the payload"
    has = f"the robot has {mass:.3g} kg {what}, {robot.name} {robot.mass:.3g} kg"
    return f"{has}: perhaps it is {' or '.join(others[:3])}" if others else ""


def _trusted(request: Request) -> Weighing:
    """The result of the request's estimator, unless it is refused."""
    result = weigh_in_motion(request) if request.in_motion else weigh_at_rest(request)
    if result.trust.verdict == "bad" and not request.force:
        raise UntrustedError(f"{request.source.source}: not to be trusted: {'; '.join(result.trust.reasons)}")
    return result


def _in_time_of(source: Source, tare: tuple[float, float], robot: Robot) -> tuple[tuple[float, float], tuple[str, ...]]:
    """The tare's range in the log's own time, and a note if it was given from the log's beginning."""
    begin, end = tare
    first = float(read_head(source, robot.tree.joints).time[0])
    if not 0.0 <= begin < end < first:
        return tare, ()
    note = f"the tare's time, {begin:g} to {end:g} s, is before the log and taken from its beginning at {first:.3f} s"
    return (first + begin, first + end), (note,)


def _opened(log: Source) -> Source:
    """The log, its first chunk read once for all checks."""
    return OpenedLog.at(log) if isinstance(log, LogFile) else log


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
    notes = with_extra_joints(robot, as_log(log))[2]
    guard = Guard(robot, robot.tree.joints, imu_frame=imu_frame)
    source = as_log(log)
    if fix:
        source = guard.mended(source)
    findings = guard.findings(source)
    if any(finding.cause == "not_on_feet" for finding in findings):
        return Inspection(findings, notes=notes)
    try:
        trust = weigh(robot, source, imu_frame=imu_frame, progress=progress).trust
        return Inspection(findings, trust=trust, notes=notes)
    except StaderaError as error:
        return Inspection(findings, str(error), notes=notes)
