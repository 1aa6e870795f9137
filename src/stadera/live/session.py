"""Weighs one running robot: messages or samples in, its state out. Does not wait, send or draw."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stadera.checks import FATAL, Finding, diagnose
from stadera.constants import DAY
from stadera.errors import RecordingError, StaderaError
from stadera.live.intake import Intake
from stadera.live.state import LiveSettings, LiveState
from stadera.live.topics import Arrival
from stadera.logs.mend import Change, changed
from stadera.logs.recording import Recording, concatenate
from stadera.logs.topics import AS_RECORDED, ReadOptions, Topics
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.load import since_tare
from stadera.trunk.memory import Memory
from stadera.trunk.samples import Samples
from stadera.trust import Trust
from stadera.weigh.pipeline import trust_now
from stadera.weigh.reading import posed_as
from stadera.weigh.settings import Watch

_REFUSED = (*FATAL, "contradiction", "not_on_feet")
"""Causes with which nothing is weighed."""


class StreamGuard:
    """Checks the first seconds of a stream as every command checks a log: units, signs, order of legs, feet on the
    ground. In stretches of `seconds` [s], after `changes` of all samples; `fix` corrects unambiguous faults. `wrong`
    says why nothing can be weighed, one sentence with the option that corrects it; empty if the last stretch can.

    Samples are used at once. If the check then finds that they cannot be weighed, what was learnt is discarded, the
    state says what is wrong and which option corrects it, and each further stretch is checked until one is sound: a
    robot may lie when the session begins.
    """

    def __init__(
        self, robot: Robot, imu_frame: str | None, seconds: float, fix: bool = False, changes: Sequence[Change] = ()
    ) -> None:
        self._robot, self._frame, self._seconds, self._fix = robot, imu_frame, seconds, fix
        self._changes, self._parts, self._done = list(changes), list[Recording](), False
        self.wrong = ""

    def corrected(self, recording: Recording) -> Recording:
        """The samples after all changes."""
        return changed(recording, self._changes, first=False)

    def restart(self) -> None:
        """Announces that the next samples do not continue the previous ones."""
        self._parts.clear()

    def check(self, recording: Recording) -> tuple[tuple[str, ...], bool]:
        """Takes in corrected samples. Once a stretch is complete, until one is sound: findings and corrections, and
        whether what was learnt so far is to be discarded.
        """
        if self._done:
            return (), False
        self._parts.append(recording)
        if float(recording.time[-1] - self._parts[0].time[0]) < self._seconds:
            return (), False
        parts, self._parts = tuple(self._parts), []
        try:
            found = diagnose(concatenate(parts), self._robot, self._frame)
        except RecordingError:  # stretches that do not fit together
            return (), False
        if self._fix and (mends := [finding.mend for finding in found if finding.mend is not None]):
            self._changes += mends
            return tuple(mend.text for mend in mends), True
        refused = [finding for finding in found if finding.cause in _REFUSED]
        before, self.wrong = self.wrong, f"samples that can be weighed: {_said(refused[0])}" if refused else ""
        self._done = not refused
        since = float(parts[0].time[0])
        return tuple(finding.said(since) for finding in found if finding not in refused), bool(refused or before)


def _said(finding: Finding) -> str:
    """The finding with the option that corrects it; messages have no columns to be mapped."""
    if not finding.option.startswith("--columns"):
        return str(finding)
    return f"{finding.message}; correct it where the messages are sent{'' if finding.mend is None else ' or add --fix'}"


@dataclass(frozen=True)
class Answer:
    """Answer to a request: whether it succeeded, and a sentence."""

    success: bool
    message: str


class LiveSession:
    """Weighs one robot.

    Args:
        topics: the requested ones; None for those that match by type.
        imu_frame: frame of the IMU's values; None for the messages' own, else the model's.
        watch: called with all samples.
        reading: units of the messages, and changes of all samples, such as gear ratios.
        fix: correct unambiguous faults of the first seconds (units, signs, orders), with a note.
        weight: of the robot on a scale, see `TrunkEstimator.know_weight`.
        tare_after: time since the first sample [s] at which the tare is taken, or as soon as it can be; None: on
            request.
        memory: what earlier logs showed of this robot, see `stadera.trunk.memory`.
        at: link or frame on which the payload is, see `TrunkEstimator`.

    Attributes:
        intake: of the messages. estimator: of the trunk; None before the first samples. tare_after: as given, None once
            it was taken.
    """

    def __init__(
        self,
        robot: Robot,
        topics: Topics | None = None,
        imu_frame: str | None = None,
        settings: LiveSettings | None = None,
        watch: Watch | None = None,
        reading: ReadOptions = AS_RECORDED,
        fix: bool = False,
        weight: tuple[float, float] | None = None,
        tare_after: float | None = None,
        memory: Memory | None = None,
        at: str | None = None,
    ) -> None:
        self.robot, self.settings = robot, settings or LiveSettings()
        self.intake = Intake(robot, topics, self.settings, reading)
        self._guard = StreamGuard(robot, imu_frame, self.settings.guarded, fix, reading.changes)
        self.estimator: TrunkEstimator | None = None
        self.imu_frame, self.fix, self._watch, self._posed = imu_frame, fix, watch, robot
        self.tare_after, self._at = tare_after, at
        self._idle, self._weight = TrunkEstimator(robot, settings=self.settings.trunk, at=at), weight
        if weight is not None:
            self._idle.know_weight(*weight)  # raises immediately for one that the robot cannot have
        self._memory = None if memory is None else memory.check(robot)
        if imu_frame is not None:
            ImuMount.of(robot, imu_frame)  # raises immediately for an unknown name
        self._fault = ""
        self._begin, self._time, self._arrived = np.nan, np.nan, np.nan
        self._tared: tuple[int, float] | None = None  # number of changes before the tare, and its time [s]

    def feed(self, arrivals: Iterable[Arrival]) -> None:
        """Processes messages; unusable ones are counted, and none raises an error."""
        newest = np.nan
        for arrival in arrivals:
            self.intake.take(arrival)
            newest = arrival.arrived
        samples = self.intake.completed()
        if samples is not None:
            self.add(samples, newest)

    def add(self, samples: Recording, arrived: float) -> None:
        """Processes samples of the robot's joints with velocities, torques and IMU, on the intake's clock; `arrived` is
        on this machine's monotonic clock [s].
        """
        try:
            if self.intake.fresh:
                self._guard.restart()
            corrected = self._guard.corrected(samples)
            self._use(corrected)
            notes, anew = self._guard.check(corrected)
            self.intake.notes |= dict.fromkeys(notes)
            if anew:
                self.reset()
            self._fault = ""
        except (StaderaError, ArithmeticError, np.linalg.LinAlgError) as error:
            self._fault = f"samples that can be used: {error}"
            if self.estimator is not None:
                self.estimator.restart()
        self._arrived = arrived

    def tare(self) -> Answer:
        """Makes the present estimate of the trunk the reference for the payload."""
        estimator = self.estimator
        if estimator is None or np.isnan(estimator.estimate().time):
            return Answer(False, "no tare: nothing is learnt yet")
        if trust_now(estimator).verdict == "bad":
            return Answer(False, f"no tare: {'; '.join(trust_now(estimator).reasons)}")
        estimator.tare()
        self._tared = len(estimator.changes), self._time
        return Answer(True, f"tared at {self._time - self._begin:.2f} s")

    def reset(self) -> Answer:
        """Discards all estimates, including the tare and the changes."""
        self.estimator, self._tared = None, None
        return Answer(True, "everything learnt is forgotten; the model is the prior")

    def remembered(self) -> tuple[Memory | None, str]:
        """The memory with what was learnt since the beginning or the last reset, None if it stays as it was, and what
        to say of it.
        """
        if self._memory is None or self.estimator is None:
            return None, "the robot's memory stays as it was: nothing was learnt"
        return self.estimator.remembered(self._memory, time.time() / DAY)

    def event(self, until: float) -> tuple[object, ...]:
        """Key of the state that changes when a state must be sent at once: changes, verdict, missing input, tare."""
        estimator = self.estimator or self._idle
        verdict, lacking = self._trust(estimator).verdict, self._lacking(until)
        return len(estimator.changes), verdict, lacking, self._tared, estimator

    def state(self, now: float | None = None, until: float | None = None) -> LiveState:
        """The present state, on the clock of the arrivals [s], None for this machine's. Topics count as silent only up
        to `until`, the arrival up to which all messages were processed; None for now.
        """
        now = time.monotonic() if now is None else now
        estimator, intake = self.estimator or self._idle, self.intake
        payload, changes = estimator.payload, estimator.changes
        tared, tared_at = self._tared or (0, np.nan)
        after = () if payload is None else since_tare(changes[tared:], payload)
        stamp = 0 if np.isnan(self._time) else round(1e9 * self._time) - intake.clock.shift
        behind = time.time() - 1e-9 * stamp
        return LiveState(
            robot=self.robot.name,
            link=self.robot.trunk,
            time=self._time,
            stamp=stamp,
            status=str(estimator.estimate().status),
            trunk=estimator.trunk,
            payload=payload,
            changes=((*changes[:tared], *after) if payload is not None else changes)[-self.settings.changes :],
            trust=self._trust(estimator),
            rates={name: topic.look(now) for name, topic in sorted(intake.seen.items())},
            lost=intake.losses,
            lag=(now - self._arrived, behind if abs(behind) < self.settings.clocks_apart else np.nan),
            waiting_for=self._lacking(now if until is None else until),
            notes=tuple(intake.notes),
            spikes=estimator.spikes,
            impacts=estimator.impacts,
            begin=0.0 if np.isnan(self._begin) else self._begin,
            tared_at=tared_at,
        )

    def _trust(self, estimator: TrunkEstimator) -> Trust:
        trust = trust_now(estimator).with_legs(estimator.robot.distrust)
        return trust.at_most("bad", self._guard.wrong) if self._guard.wrong else trust

    # -- inside -----------------------------------------------------------------------------------------------
    def _lacking(self, now: float) -> tuple[str, ...]:
        if fault := self._fault or self._guard.wrong:
            return (fault,)
        replayed = not self.intake.seen and self.estimator is not None
        return () if replayed else self.intake.waiting_for(now)

    def _use(self, recording: Recording) -> None:
        """Passes samples to the estimator, unless the guard found that they cannot be weighed."""
        self._begin = float(recording.time[0]) if np.isnan(self._begin) else self._begin
        if self._guard.wrong:
            self._time = float(recording.time[-1])
            return
        estimator = self.estimator
        if estimator is None:
            frame = self.imu_frame or (recording.imu.frame if recording.imu is not None else None)
            mount = ImuMount.of(self.robot, frame)
            self._posed = posed_as(self.robot, recording.others)
            estimator = TrunkEstimator(self._posed, settings=self.settings.trunk, mount=mount, at=self._at)
            if self._weight is not None:
                estimator.know_weight(*self._weight)
            if self._memory is not None:
                estimator.recall(self._memory, time.time() / DAY)
        elif self.intake.fresh:
            estimator.restart()
        self.estimator, self.intake.fresh = estimator, False
        samples = Samples.of_recording(recording, self._posed, estimator.mount.name)
        after = np.inf if self.tare_after is None else self.tare_after
        due = 1 + int(np.searchsorted(samples.time, self._begin + after))
        for part in filter(len, (samples[:due], samples[due:])):
            estimator.add(part)
            self._time = float(part.time[-1])
            if self._time - self._begin >= after and self.tare().success:
                self.tare_after, after = None, np.inf
        if self._watch is not None:
            self._watch(samples, estimator)
