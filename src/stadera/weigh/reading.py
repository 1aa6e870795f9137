"""Reads logs for weighing: chunk by chunk, checked for contradictions, and only while the robot is on its feet.

A log whose encoders, torques and IMU contradict each other throughout is refused. If it is consistent in a single
stretch, only that stretch is used: a robot that lies or hangs before it stands up, or falls at the end, does not obey
the model of a robot on its feet.

Joints that belong to no leg, of an arm or a lidar that turns, move as recorded, and the trunk's values are those with
them where they are at the log's beginning. A log that lacks them has them held at the model's zero.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from stadera.checks import FATAL, Finding, contradictions, diagnose
from stadera.checks.windows import window_faults, with_verdicts
from stadera.errors import RecordingError, UntrustedError
from stadera.logs import Recording, stream, take
from stadera.logs.columns import HALF_IMU
from stadera.logs.reader import HEAD_ROWS, read_head
from stadera.logs.recording import OtherJoints, with_velocity
from stadera.robot.model import Robot
from stadera.trunk.registry import METHODS, method_of
from stadera.trust import Verdict
from stadera.weigh.result import Refusal
from stadera.weigh.settings import IN_MOTION, Request, Source, WeighSettings

WITH_IMU, WITHOUT_IMU = "contact", "poses"
"""Default methods at rest."""

_COMPLETE = 0.9  # share of the samples that must have the joints of no leg for these to be used
_VERDICTS: dict[str, Verdict] = {
    "contradiction": "bad",
    "not_on_feet": "bad",
    "stuck": "bad",
    "torque_step": "doubtful",
    "pushing": "doubtful",
}


def choose_method(robot: Robot, source: Source, tare: object, settings: WeighSettings) -> str:
    """Chooses the method for a log: in motion, standing included, with an IMU and at least 50 samples a second,
    otherwise at rest. A tare's log needs an IMU as well. Raises RecordingError as `read_head`, and for a log with half
    an IMU, of which perhaps only a column's name is not known.
    """
    first = read_head(source, robot.tree.joints)
    if first.imu is None:
        if half := next((note for note in first.notes if note.startswith(HALF_IMU)), ""):
            raise RecordingError(
                f"{source.source}: {half}: name it with --columns, or weigh without the IMU, at rest only, by "
                f"--method {WITHOUT_IMU}"
            )
        return WITHOUT_IMU
    other = None if tare is None or isinstance(tare, tuple) else read_head(tare, robot.tree.joints)  # type: ignore[arg-type]
    slow = np.median(np.diff(first.time)) > settings.jitter / settings.least_rate
    return WITH_IMU if slow or (other is not None and other.imu is None) else IN_MOTION


def check_source(request: Request) -> bool:
    """Checks that a log has the channels that the method needs. Returns True if it has an IMU. Raises RecordingError:
    there are no joint torques, or no IMU although the method or an option needs one.
    """
    log, method = request.source, request.method
    if read_head(log, request.robot.tree.joints).imu is not None:
        return True
    if method_of(method).needs_imu:
        require_imu(request.robot, log, method)
    topics = None if isinstance(log, Recording) else log.topics.imu
    for option, asked in (("--imu-topic", topics), ("--imu-frame", request.imu_frame)):
        if asked is not None:
            raise RecordingError(f"{log.source}: {option} {asked}: the log has no IMU that can be used")
    return False


def require_imu(robot: Robot, source: Source, method: str) -> None:
    """Checks that a log has an IMU. Raises RecordingError: there is none. The message names the missing columns and the
    methods that need no IMU.
    """
    try:
        stream(source, joints=robot.tree.joints, require=("imu",))
    except RecordingError as error:
        others = " or ".join(f"--method {name}" for name, other in METHODS.items() if not other.needs_imu)
        raise RecordingError(
            f"{error}; the method {method!r} needs an IMU; without one only a robot that stands still can be weighed, "
            f"by {others}, with the direction of its feet's forces as the vertical"
        ) from None


class CheckedLog:
    """The log of a weighing, or that of its tare, in chunks with joint velocities, each checked before it is yielded.
    Can be iterated several times.

    Attributes:
        notes: remarks on findings and on corrections made.
        doubts: verdict and reason of each finding that makes the result doubtful or bad.
        begin, end: of the log [s]; NaN before the first iteration.
        before, event: the times before and after the stretch in which the robot is on its feet, which are not used, and
            why; None if there are none.
        left_out: other times that are not used, because of a fault in them.
    """

    def __init__(self, request: Request, source: Source, require: tuple[str, ...] = ()) -> None:
        self.notes: dict[str, None] = {}
        self.doubts: dict[tuple[Verdict, str], None] = {}
        self.begin, self.end = np.nan, np.nan
        self.before: Refusal | None = None
        self.event: Refusal | None = None
        self.left_out: list[Refusal] = []
        self._request, self.source, self._require = request, source, require
        self._sound = False

    @property
    def refusals(self) -> tuple[Refusal, ...]:
        """The times that are not used."""
        return tuple(refusal for refusal in (self.before, *self.left_out, self.event) if refusal is not None)

    def __iter__(self) -> Iterator[Recording]:
        """Yields the chunks. Raises RecordingError as `stadera.logs.stream`, UntrustedError if signs, orders, frames or
        units of the log are wrong and the request does not force a result.
        """
        known = not np.isnan(self.end)  # from an earlier reading
        for chunk in stream(self.source, joints=self._request.robot.tree.joints, require=("effort", *self._require)):
            checked = with_velocity(chunk)
            if not known:
                self.begin = float(chunk.time[0]) if np.isnan(self.begin) else self.begin
                self._check_windows(chunk)
                self.end = float(chunk.time[-1])
                self.notes |= dict.fromkeys(checked.notes)
                self.doubts |= {("doubtful", doubt): None for doubt in checked.doubts}
                if self.event is None:
                    self._check(checked)
            if self.event is not None:
                self.event = replace(self.event, end=max(self.event.end, self.end))
                checked = take(checked, checked.time < self.event.begin)
            for part in self.left_out:
                checked = take(checked, (checked.time < part.begin) | (checked.time > part.end))
            if self.before is not None:
                checked = take(checked, checked.time > self.before.end)
            if len(checked):
                yield checked

    def _check_windows(self, chunk: Recording) -> None:
        limits, duration = self._request.settings.windows, float(chunk.time[-1] - chunk.time[0])
        for fault, verdict in with_verdicts(window_faults(chunk, self._request.robot, limits), duration, limits):
            if verdict is not None:
                self.doubts[verdict, fault.message(self.begin)] = None
                continue
            self.notes[f"left out: {fault.message(self.begin)}"] = None
            parts = [Refusal(begin, end, f"{fault.what} {fault.evidence}") for begin, end in fault.windows]
            self.left_out += [part for part in parts if part.begin not in [known.begin for known in self.left_out]]

    def _check(self, chunk: Recording) -> None:
        findings = diagnose(chunk, self._request.robot, self._request.imu_frame)
        wrong = any(f.cause in (*FATAL, "contradiction", "not_on_feet") for f in findings)
        if wrong and self._on_feet(chunk):
            self._sound = True
            return
        self._sound = self._sound or not wrong
        most = self._request.settings.windows.left_out * float(chunk.time[-1] - chunk.time[0])
        for finding in findings:
            if finding.span is not None and finding.span[1] - finding.span[0] <= most:
                self.notes[f"left out: {finding}"] = None
                self.left_out.append(Refusal(*finding.span, finding.message))
            else:
                self._note(finding)

    def _note(self, finding: Finding) -> None:
        text = f"{finding.cause.replace('_', ' ')}: {finding}"
        if finding.cause in FATAL:
            if not self._request.force:
                raise UntrustedError(f"{self.source.source}: {finding}")
            self.doubts["bad", finding.message] = None
        elif verdict := _VERDICTS.get(finding.cause):
            if verdict == "bad" and not self._request.force:
                raise UntrustedError(f"{self.source.source}: not to be trusted: {text}")
            self.doubts[verdict, text] = None
        else:
            self.notes[text] = None

    def _on_feet(self, chunk: Recording) -> bool:
        """Finds the stretch in which the robot is on its feet, in a chunk with contradictions."""
        window = self._request.settings.window
        edges = np.arange(chunk.time[0], chunk.time[-1], window)
        faults = [self._faults(chunk, edge, edge + window) for edge in edges]
        consistent = [not found for found in faults]
        first, stop = (0, (*consistent, False).index(False)) if self._sound else _single(consistent)
        if not self._sound and stop - first < self._request.settings.sound:
            return False
        if first > 0:
            reason = f"sensors contradict each other up to here, as before a robot stands up: {faults[0][0]}"
            self.before = Refusal(float(chunk.time[0]), float(edges[first]) + 0.5 * window, reason)
        if stop < len(edges):
            reason = f"sensors contradict each other from here on, as in a fall: {faults[stop][0]}"
            self.event = Refusal(float(edges[stop]) - 0.5 * window, float(chunk.time[-1]), reason)
        return first > 0 or stop < len(edges)

    def _faults(self, chunk: Recording, begin: float, end: float) -> tuple[str, ...]:
        part = take(chunk, slice(*np.searchsorted(chunk.time, [begin, end])))
        return contradictions(part, self._request.robot, self._request.imu_frame) if len(part) > 1 else ()


def _single(consistent: Sequence[bool]) -> tuple[int, int]:
    """First and last-plus-one of the consistent windows if they are contiguous; else (0, 0)."""
    found = np.flatnonzero(consistent)
    unbroken = len(found) and found[-1] - found[0] + 1 == len(found)
    return (int(found[0]), int(found[-1]) + 1) if unbroken else (0, 0)


def with_extra_joints(robot: Robot, *logs: Source) -> tuple[Robot, tuple[Source, ...], tuple[str, ...]]:
    """Returns the robot posed as at the beginning of the first of the logs that has its joints outside the legs, the
    logs with instructions to read these joints, and notes. A robot without such joints is returned unchanged.
    """
    extra = robot.extra
    if extra is None:
        return robot, logs, ()
    read = [_reading_others(robot, log, extra.joints) for log in logs]
    notes: list[str] = []
    for log, recorded in read:
        if lacking := [joint for joint in extra.joints if recorded is None or joint not in recorded.names]:
            notes.append(f"{_listed(lacking)} of no leg: not in {log.name}, held at the model's zero")
    posed = posed_as(robot, next((recorded for _, recorded in read if recorded is not None), None))
    if posed is not robot and posed.extra is not None:
        angles = ", ".join(f"{value:.3g}" for value in posed.extra.reference)
        notes.append(
            f"{_listed(extra.joints)} of no leg: they move as recorded, with the model's inertia; the trunk's "
            f"values are those with them at {angles} (rad or m), as at the beginning"
        )
    return posed, tuple(log for log, _ in read), tuple(dict.fromkeys(notes))


def posed_as(robot: Robot, recorded: OtherJoints | None) -> Robot:
    """The robot with its joints outside the legs where they are at the beginning of a recording, if it has them."""
    if recorded is None:
        return robot
    return robot.posed(dict(zip(recorded.names, recorded.position[0].tolist(), strict=True)))


def _reading_others(robot: Robot, log: Source, joints: tuple[str, ...]) -> tuple[Source, OtherJoints | None]:
    """The log that also reads these joints, and what it begins with; the log itself if it lacks them or has gaps."""
    if isinstance(log, Recording):
        other: Source = log.with_others(joints)
    else:
        other = replace(log, reading=replace(log.reading, others=joints))
    try:
        first = next(stream(other, joints=robot.tree.joints, rows=HEAD_ROWS), None)
        if first is not None and first.others is not None:
            whole = next(stream(log, joints=robot.tree.joints, rows=HEAD_ROWS))
            if len(first) >= _COMPLETE * len(whole):
                return other, first.others
    except RecordingError:
        pass  # whoever reads the log says why
    return log, None


def _listed(joints: list[str] | tuple[str, ...]) -> str:
    return f"joint{'s' * (len(joints) > 1)} {', '.join(joints)}"
