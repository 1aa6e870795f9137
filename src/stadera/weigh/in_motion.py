"""A moving robot weighed from its log, in one pass, memory flat in its length: walking, trotting, swaying or standing.

The walking estimator (`stadera.estimate.walking`) reads the log as it would have read the robot. With a range of time
for the tare, the trunk as known at its end is what the payload is the difference to; with a log of its own, that one is
read first, and what is constant in the sensors (torque offsets, accelerometer bias, torque lag) is taken to be the same
in both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stadera.errors import IdentificationError, RecordingError
from stadera.estimate.protocol import Status
from stadera.estimate.walking import WalkingEstimator
from stadera.estimate.walking_noise import WalkingNoise
from stadera.estimate.walking_result import LoadChange, Payload, TrunkParameters
from stadera.estimate.walking_samples import Samples
from stadera.recording import LogFile, stream
from stadera.robot.model import Robot
from stadera.weigh.diagnosis import checked
from stadera.weigh.imu import require_imu
from stadera.weigh.result import Refusal

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

_MODEL = 0.02, 0.002, 0.2
"""1 σ of what is not known of the links' masses and centres of mass [m] and of the joints' friction."""
_LAG = 5e-3  # s, 1 σ of what is not known of the torques' lag
_EVERY = 0.1  # s, from one entry of the timeline to the next
_BETWEEN = 10.0  # s, put between the tare's log and the other
_AHEAD = 512  # samples taken in at once, at most
_SLOWEST = 0.02  # s between samples, above which the motion between them is not seen
_JITTER = 1.02  # times that, which stamps may come to by rounding


@dataclass(frozen=True, eq=False)
class MotionTimeline:
    """What was known over time; trunk frame.

    Attributes:
        time: (entries,) [s].
        mass, mass_std: (entries,) [kg]. com, com_std: (entries, 3) [m]. NaN where not observed.
    """

    time: Array
    mass: Array
    mass_std: Array
    com: Array
    com_std: Array


@dataclass(frozen=True, eq=False)
class MotionWeighing:
    """What a weighing in motion found.

    Attributes:
        robot: that was believed in.
        source: the log.
        status: of the estimator at the end.
        trunk: with all that is on it, as it was at the end of the log.
        payload: added since the tare, None without a tare.
        changes: of the load, in order.
        timeline: see `MotionTimeline`.
        torque_lag: by how much torques were found to be late, and its standard deviation [s].
        refusals: when nothing could be learnt, and why.
        begin, end: of the log [s].
        notes: one sentence each.
    """

    robot: Robot
    source: str
    status: str
    trunk: TrunkParameters
    payload: Payload | None
    changes: tuple[LoadChange, ...]
    timeline: MotionTimeline
    torque_lag: tuple[float, float]
    refusals: tuple[Refusal, ...]
    begin: float
    end: float
    notes: tuple[str, ...] = ()


def weigh_in_motion(
    robot: Robot,
    log: str | PathLike[str],
    tare: tuple[float, float] | Path | LogFile | None = None,
    imu_frame: str | None = None,
    progress: Progress | None = None,
) -> MotionWeighing:
    """Weighs a robot that moves.

    Args:
        robot: whose legs are believed in, friction and rotor inertia among them.
        log: of joint positions, velocities and torques and of an IMU; a LogFile chooses among a bag's topics.
        tare: a range of the log's time [s], or another log, in which the robot is without its payload.
        imu_frame: in which the IMU's values are; None for the log's own, else the model's.
        progress: told how many samples are done.

    Raises:
        RecordingError: a log that cannot be read or lacks a joint, its velocity or torque, or the IMU.
        IdentificationError: a tare's time that the log does not hold; a log from which nothing could be learnt.
    """
    reading = _Reading(robot, imu_frame, progress)
    until = np.inf
    if isinstance(tare, tuple):
        until = tare[1]
    elif tare is not None:
        reading.read(LogFile.of(tare))
        reading.tare(str(tare))
        reading.forget_the_way()
    source = LogFile.of(log)
    reading.read(source, tare if isinstance(tare, tuple) else None)
    if until < np.inf and not reading.tared:
        raise IdentificationError(
            f"{source}: the tare's time, {tare[0]:g} to {tare[1]:g} s, lies outside the log, "  # type: ignore[index]
            f"{reading.begin:g} to {reading.end:g} s"
        )
    return reading.result(str(source))


class _Reading:
    """One weighing's working state."""

    def __init__(self, robot: Robot, imu_frame: str | None, progress: Progress | None) -> None:
        self.robot, self._frame, self._progress = robot, imu_frame, progress
        self.estimator = WalkingEstimator(robot, WalkingNoise.of(robot, torque_lag=_LAG).with_model(*_MODEL))
        self.tared, self.begin, self.end = False, np.nan, np.nan
        self._shift, self._done = 0.0, 0
        self._notes: dict[str, None] = {}
        self.forget_the_way()

    def forget_the_way(self) -> None:
        """Begins a new log: a timeline of its own, later than all before."""
        self._entries: list[tuple[float, Array, Array]] = []
        self._refused: list[Refusal] = []
        self._changes_before = len(self.estimator.changes)
        self._due, self._shift = -np.inf, self._shift + (0.0 if np.isnan(self.end) else self.end + _BETWEEN)
        self.begin = np.nan

    def read(self, log: LogFile, tare: tuple[float, float] | None = None) -> None:
        """Takes a log in; a new tare at the end of its time, if there is one."""
        told = f"weighing {log.name}"
        require_imu(log, self.robot, "walking")
        for chunk in stream(log, joints=self.robot.tree.joints, require=("velocity", "effort", "imu")):
            self._notes |= dict.fromkeys((*chunk.notes, *checked(chunk, self.robot, self._frame)))
            samples = Samples.of_recording(chunk, self.robot, self._frame)
            self._check_rate(log, samples)
            if np.isnan(self.begin):
                self.begin = float(samples.time[0])
                self._shift -= self.begin if self._shift else 0.0
            for start in range(0, len(samples), _AHEAD):
                self._take(samples[start : start + _AHEAD], tare)
            self._done += len(samples)
            if self._progress:
                self._progress(told, self._done, 0)

    def tare(self, where: str) -> None:
        """The trunk of now is the reference."""
        if not self.estimator.parameters().observed[0]:
            raise IdentificationError(f"{where}: too short for a tare, the trunk's mass is not known by its end")
        self.estimator.tare()
        self.tared = True

    def result(self, source: str) -> MotionWeighing:
        estimate, changes = self.estimator.estimate(), self.estimator.changes[self._changes_before :]
        if not self._entries or np.isnan(estimate.time):
            raise IdentificationError(f"{source}: nothing could be learnt: {estimate.reason or 'too few samples'}")
        time, values, stds = (np.array(column) for column in zip(*self._entries, strict=True))
        return MotionWeighing(
            robot=self.robot,
            source=source,
            status=str(estimate.status),
            trunk=self.estimator.parameters(),
            payload=self.estimator.payload(),
            changes=tuple(replace(c, time=c.time - self._shift, noticed=c.noticed - self._shift) for c in changes),
            timeline=MotionTimeline(time, values[:, 0], stds[:, 0], values[:, 1:], stds[:, 1:]),
            torque_lag=self.estimator.torque_lag,
            refusals=tuple(self._refused),
            begin=self.begin,
            end=self.end,
            notes=tuple(self._notes),
        )

    # -- inside ---------------------------------------------------------------------------------------------------
    def _check_rate(self, log: LogFile, samples: Samples) -> None:
        steps = np.diff(samples.time)
        if len(steps) and float(np.median(steps)) > _JITTER * _SLOWEST:
            raise RecordingError(
                f"{log}: {1.0 / float(np.median(steps)):.0f} samples a second do not show how a robot moves, "
                f"{1.0 / _SLOWEST:.0f} are needed; while it stands still --method contact weighs it"
            )

    def _take(self, samples: Samples, tare: tuple[float, float] | None) -> None:
        """Adds samples bit by bit, looking at the estimator between; the tare falls where it belongs."""
        edges = np.searchsorted(samples.time, np.arange(samples.time[0], samples.time[-1] + _EVERY, _EVERY))
        if tare is not None and not self.tared:
            edges = np.append(edges, np.searchsorted(samples.time, tare[1], side="right"))
        cuts = np.unique(np.clip([*edges, len(samples)], 0, len(samples)))
        for start, stop in zip(np.append(0, cuts[:-1]), cuts, strict=True):
            if stop > start:
                self._add(samples[int(start) : int(stop)])
                if tare is not None and not self.tared and self.end >= tare[1]:
                    self.tare(f"{tare[0]:g} to {tare[1]:g} s")

    def _add(self, samples: Samples) -> None:
        self.end = float(samples.time[-1])
        self.estimator.add(replace(samples, time=samples.time + self._shift))
        estimate = self.estimator.estimate()
        if estimate.status is Status.REFUSED:
            self._note_refusal(float(samples.time[0]), estimate.reason)
        if self.end >= self._due and estimate.time == estimate.time:
            std = estimate.std
            self._entries.append((self.end, np.where(np.isnan(std), np.nan, estimate.value), std))
            self._due = self.end + _EVERY

    def _note_refusal(self, begin: float, reason: str) -> None:
        last = self._refused[-1] if self._refused else None
        if last is not None and last.reason == reason and begin - last.end < 2.0 * _EVERY:
            self._refused[-1] = replace(last, end=self.end)
        else:
            self._refused.append(Refusal(begin, self.end, reason))
