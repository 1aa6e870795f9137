"""Reads logs for weighing: chunk by chunk, checked for contradictions, and only while the robot is on its feet.

A log whose encoders, torques and IMU contradict each other throughout is refused. If it is consistent in a single
stretch, only that stretch is used: a robot that lies or hangs before it stands up, or falls at the end, does not obey
the model of a robot on its feet.

Joints that belong to no leg, of an arm or a lidar that turns, move as recorded, and the trunk's values are those with
them where they are at the log's beginning. A log that lacks them has them held at the model's zero.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from stadera.checks import FATAL, Finding, contradictions, diagnose
from stadera.checks.signals import dropouts
from stadera.checks.windows import window_faults, with_verdicts
from stadera.errors import RecordingError, UntrustedError
from stadera.logs import Recording, stream, take
from stadera.logs.recording import OtherJoints, with_velocity
from stadera.robot.model import Robot
from stadera.trunk.registry import METHODS
from stadera.trust import Verdict
from stadera.types import Array, Bools
from stadera.weigh.result import Refusal
from stadera.weigh.settings import Source, WeighSettings

_UNITS = ("time_unit", "position_unit", "velocity_unit", "velocity_order", "gyro_unit", "imu_gravity")
_VERDICTS: dict[str, Verdict] = {
    "contradiction": "bad",
    "not_on_feet": "bad",
    "torque_order": "doubtful",
    "torque_step": "doubtful",
    "limb_torques": "doubtful",
    "pushing": "doubtful",
    "no_gyro": "doubtful",
}


class CheckedLog:
    """The log of a weighing, or that of its tare, read once, in chunks with joint velocities; each chunk is checked
    before it is yielded.

    Args:
        force: use the log although signs, orders, frames or units are wrong.

    Attributes:
        first: its first chunk as recorded, which tells its channels and rate.
        notes: remarks on findings and on corrections made.
        doubts: verdict and reason of each finding that makes the result doubtful or bad.
        begin, end: of the log [s]; `end` as far as it was read.
        before, event: the times before and after the stretch in which the robot is on its feet, which are not used, and
            why; None if there are none.
        left_out: other times that are not used, because of a fault in them.

    Raises:
        RecordingError: as `stadera.logs.stream`, or for an empty log.
    """

    def __init__(
        self, robot: Robot, source: Source, settings: WeighSettings, imu_frame: str | None = None, force: bool = False
    ) -> None:
        self.source, self.imu_frame = source, imu_frame
        self._robot, self._settings, self._force = robot, settings, force
        self._chunks = stream(source, joints=robot.tree.joints, require=("effort",))
        first = next(self._chunks, None)
        if first is None:
            raise RecordingError(f"{source.source}: no samples")
        self.first = first
        self.begin, self.end = float(first.time[0]), np.nan
        self.notes: dict[str, None] = {}
        self.doubts: dict[tuple[Verdict, str], None] = {}
        self.before: Refusal | None = None
        self.event: Refusal | None = None
        self.left_out: list[Refusal] = []
        self._sound = False

    @property
    def refusals(self) -> tuple[Refusal, ...]:
        """The times that are not used."""
        return tuple(refusal for refusal in (self.before, *self.left_out, self.event) if refusal is not None)

    def require_imu(self, method: str) -> None:
        """Raises RecordingError: the log has no IMU. The message names the missing columns and the methods that need
        none.
        """
        if self.first.imu is not None:
            return
        try:
            stream(self.source, joints=self._robot.tree.joints, require=("imu",))
        except RecordingError as error:
            others = " or ".join(f"--method {name}" for name, other in METHODS.items() if not other.needs_imu)
            raise RecordingError(
                f"{error}; the method {method!r} needs an IMU; without one only a robot that stands still can be "
                f"weighed, by {others}, with the direction of its feet's forces as the vertical"
            ) from None

    def __iter__(self) -> Iterator[Recording]:
        """Yields the chunks, once. Raises RecordingError as `stadera.logs.stream`, UntrustedError if signs, orders,
        frames or units of the log are wrong and the result is not forced.
        """
        for chunk in chain((self.first,), self._chunks):
            self.end = float(chunk.time[-1])
            duration, limits = self.end - float(chunk.time[0]), self._settings.windows
            self._skip(window_faults(chunk, self._robot, limits), duration)
            checked = with_velocity(chunk)
            if not (used := self._used(checked.time)).all():
                checked = take(checked, used)
            self.notes |= dict.fromkeys(checked.notes)
            self.doubts |= {("doubtful", doubt): None for doubt in checked.doubts}
            for gap in dropouts(chunk.time):
                self._note(gap)
            if self.event is not None:
                self.event = replace(self.event, end=self.end)
            elif not len(checked):
                continue
            elif len(checked) > 1:
                if findings := diagnose(checked, self._robot, self.imu_frame):
                    self._found(findings, checked, duration)
                else:
                    self._sound = True
            if (used := self._used(checked.time)).any():
                yield checked if used.all() else take(checked, used)

    def _used(self, time: Array) -> Bools:
        """Samples at times (n,) [s] that are not left out, (n,)."""
        used = np.ones(len(time), dtype=bool)
        for part in self.left_out:
            used &= (time < part.begin) | (time > part.end)
        if self.before is not None:
            used &= time > self.before.end
        if self.event is not None:
            used &= time < self.event.begin
        return used

    def _skip(self, faults: Sequence[Finding], duration: float) -> None:
        """Leaves out the parts with faults that are short, and doubts the log for the others."""
        for fault, verdict in with_verdicts(faults, duration, self._settings.windows):
            if verdict is not None:
                self.doubts[verdict, fault.said(self.begin)] = None
                continue
            self.notes[f"{'left out: ' * bool(fault.spans)}{fault.said(self.begin)}"] = None
            parts = [Refusal(begin, end, fault.message) for begin, end in fault.spans]
            self.left_out += [part for part in parts if part.begin not in [known.begin for known in self.left_out]]

    def _found(self, findings: Sequence[Finding], chunk: Recording, duration: float) -> None:
        """Decides what the findings on a chunk of this duration [s] mean."""
        wrong = any(f.cause in (*FATAL, "contradiction", "not_on_feet") for f in findings)
        units = self.end == self.first.time[-1] and any(f.cause in _UNITS for f in findings)
        if wrong and not units and self._on_feet(chunk):
            self._sound, used = True, self._used(chunk.time)
            on_feet = diagnose(take(chunk, used), self._robot, self.imu_frame) if np.count_nonzero(used) > 1 else ()
            findings = [finding for finding in on_feet if finding.cause in FATAL]
        self._sound = self._sound or not wrong
        self._skip([finding for finding in findings if finding.spans], duration)
        for finding in findings:
            if not finding.spans and finding.cause != "dropout":  # some gaps are of what is left out
                self._note(finding)

    def _note(self, finding: Finding) -> None:
        text = f"{finding.cause.replace('_', ' ')}: {finding.said(self.begin)}"
        if finding.cause in FATAL:
            if not self._force:
                raise UntrustedError(f"{self.source.source}: {finding}")
            self.doubts["bad", finding.message] = None
        elif verdict := _VERDICTS.get(finding.cause):
            if verdict == "bad" and not self._force:
                raise UntrustedError(f"{self.source.source}: not to be trusted: {text}")
            self.doubts[verdict, text] = None
        else:
            self.notes[text] = None

    def _on_feet(self, chunk: Recording) -> bool:
        """Finds the stretch in which the robot is on its feet, in a chunk with contradictions."""
        window = self._settings.window
        edges = np.arange(chunk.time[0], chunk.time[-1], window)
        faults = [self._faults(chunk, edge, edge + window) for edge in edges]
        consistent = [not found for found in faults]
        first, stop = (0, (*consistent, False).index(False)) if self._sound else _single(consistent)
        if not self._sound and stop - first < self._settings.sound:
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
        return contradictions(part, self._robot, self.imu_frame) if len(part) > 1 else ()


def _single(consistent: Sequence[bool]) -> tuple[int, int]:
    """First and last-plus-one of the consistent windows if they are contiguous; else (0, 0)."""
    found = np.flatnonzero(consistent)
    unbroken = len(found) and found[-1] - found[0] + 1 == len(found)
    return (int(found[0]), int(found[-1]) + 1) if unbroken else (0, 0)


def with_extra_joints(robot: Robot, *logs: Source, named: int = 6) -> tuple[Robot, tuple[Source, ...], tuple[str, ...]]:
    """Returns the robot posed as at the beginning of the first of the logs that has its joints outside the legs, the
    logs with instructions to read these joints, and notes. A robot without such joints is returned unchanged.
    At most `named` joints are listed with their positions.
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
        few = len(extra.joints) <= named
        which = _listed(extra.joints) if few else f"{len(extra.joints)} joints"
        at = ", ".join(f"{value:.3g}" for value in posed.extra.reference)
        place = f"at {at} (rad or m), as at the beginning" if few else "as at the beginning"
        notes.append(
            f"{which} of no leg: they move as recorded, with the model's inertia; the trunk's values are those with "
            f"them {place}"
        )
    return posed, tuple(log for log, _ in read), tuple(dict.fromkeys(notes))


def posed_as(robot: Robot, recorded: OtherJoints | None) -> Robot:
    """The robot with its joints outside the legs where they are at the beginning of a recording, if it has them."""
    if recorded is None:
        return robot
    return robot.posed(dict(zip(recorded.names, recorded.position[0].tolist(), strict=True)))


def _reading_others(
    robot: Robot, log: Source, joints: tuple[str, ...], complete: float = 0.9, rows: int = 256
) -> tuple[Source, OtherJoints | None]:
    """The log that also reads these joints, and what it begins with; the log itself if it lacks them or has them in
    less than a share `complete` of its first `rows` samples.
    """
    if isinstance(log, Recording):
        other: Source = log.with_others(joints)
    else:
        other = replace(log, reading=replace(log.reading, others=joints))
    try:
        first = next(stream(other, joints=robot.tree.joints, rows=rows), None)
        if first is not None and first.others is not None:
            whole = next(stream(log, joints=robot.tree.joints, rows=rows))
            if len(first) >= complete * len(whole):
                return other, first.others
    except RecordingError:
        pass  # whoever reads the log says why
    return log, None


def _listed(joints: list[str] | tuple[str, ...]) -> str:
    return f"joint{'s' * (len(joints) > 1)} {', '.join(joints)}"
