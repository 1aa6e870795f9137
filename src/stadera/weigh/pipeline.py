"""Weighs a log by any estimator, at rest or moving, in one pass, as it would process live data.

If the tare is a range of time, the log is used from the start of that range, and the payload is the difference from the
trunk estimated at its end. If the tare is another log, that log is processed first by the same estimator; constant
errors of the sensors (torque offsets, accelerometer bias, torque lag) are assumed to be the same in both.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from math import degrees
from typing import TYPE_CHECKING

import numpy as np

from stadera.errors import IdentificationError, RecordingError
from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.front import LIES
from stadera.trunk.load import SIGNIFICANT, LoadChange, Payload, since_tare
from stadera.trunk.measurement import Measurement, measurements_of, rotation_matrix
from stadera.trunk.memory import Memory, days_of
from stadera.trunk.protocol import RUNS_AWAY, Status, TrunkEstimate, Weigher
from stadera.trunk.registry import Setup, method_of
from stadera.trunk.samples import Samples
from stadera.trunk.standing.estimator import Stance, Vertical, level_axes
from stadera.trunk.standing.forces import measurements_without_imu
from stadera.trust import Trust, Verdict
from stadera.types import Array, Progress
from stadera.weigh.against_model import Footprint, doubts
from stadera.weigh.next_steps import steps_known
from stadera.weigh.reading import CheckedLog
from stadera.weigh.result import Refusal, Timeline, Weighing
from stadera.weigh.settings import TestWeight, Watch, WeighSettings

if TYPE_CHECKING:
    from stadera.lab.laws.orientation import PostureLaw

_BEFORE = "before the tare's time"
_IN_MOTION, _AT_REST = ("torque_lag", "spikes", "impacts", "drives"), ("balance", "vertical")
"""What an estimator may tell beyond the protocol, under its name in `Weighing`."""


@dataclass(frozen=True, eq=False)
class Request:
    """How to weigh; see the arguments of `stadera.weigh`. The robot as it is after all corrections."""

    robot: Robot
    method: str
    settings: WeighSettings
    tare: tuple[float, float] | CheckedLog | None = None
    stiffness: tuple[float, float, float] | None = None
    progress: Progress | None = None
    watch: Watch | None = None
    weight: tuple[float, float] | None = None
    known: TestWeight | None = None
    memory: Memory | None = None
    at: str | None = None


def weighed(request: Request, log: CheckedLog) -> Weighing:
    """The result of weighing a log. Raises as `stadera.weigh.weigh`."""
    before: _LogPass | None = None
    if isinstance(request.tare, CheckedLog):
        before = _LogPass(request, request.tare)
        before.read()
        before.tare(request.tare.source.source)
    reading = _LogPass(request, log, before)
    reading.read()
    if isinstance(request.tare, tuple) and not reading.tared:
        begin, end = (t - log.begin for t in request.tare)
        length = log.end - log.begin
        why = f"lies outside the log, which is {length:.3g} s long"
        if begin < length:
            why = f"is not over when the log ends, after {length:.4g} s"
        if (event := log.event) is not None and event.begin < request.tare[1] <= log.end:
            why = f"is not used after {event.begin - log.begin:.2f} s: {event.reason}"
        raise IdentificationError(f"{log.source.source}: the tare's time, {_since_zero(begin, end)}, {why}")
    return reading.result()


def _since_zero(begin: float, end: float) -> str:
    """A range of time since the log's beginning [s], which a first stamp just after zero does not make negative."""
    return f"{round(begin, 2) + 0.0:g} to {round(end, 2):g} s"


def trust_now(estimator: Weigher, learnt: float | None = None, begin: float = 0.0) -> Trust:
    """The estimator's trust in its result, lowered if it refuses the latest samples, those after `learnt` [s]; times
    are said as since `begin` [s].
    """
    trust, estimate = estimator.trust, estimator.estimate()
    if estimate.status is not Status.REFUSED or trust.verdict == "bad" or estimate.reason == LIES:
        return trust
    verdict: Verdict = "bad" if estimate.reason.startswith(RUNS_AWAY) else "doubtful"
    at = estimate.time if learnt is None else learnt
    return trust.at_most(verdict, f"as known at {at - begin:.2f} s; nothing was learnt after it: {estimate.reason}")


def _without_imu(vertical: Vertical | None) -> Iterator[str]:
    """Says by what a robot without an IMU was weighed."""
    if vertical is not None and vertical.source == "forces":
        yield (
            "no IMU: weighed while the joints stand still, with the direction of the feet's forces as the vertical, "
            f"known to ±{degrees(vertical.tilt_std):.2g}°, which is in the error bars; a steady push or pull and a "
            "floor that accelerates would be taken for weight, and neither inertia nor anything in motion is known"
        )


def _kind(reason: str) -> str:
    """A reason without its figures and names."""
    return re.sub(r"[-+]?\d[\d.]*|'[^']*'", "#", reason)


class _LogPass:
    """Processing of one log of a request; continues with the estimator of `before`, the processing of the tare's log,
    if there is one.

    Its timeline and refusals are asked for while the log is read.
    """

    def __init__(self, request: Request, log: CheckedLog, before: _LogPass | None = None) -> None:
        self.log = log
        self._request, self._before, self._method = request, before, method_of(request.method)
        self._range = request.tare if isinstance(request.tare, tuple) else None
        self._estimator = None if before is None else before.estimator
        self._changes_before = 0 if self._estimator is None else len(self._estimator.changes)
        self.tared, self._tared_at = before is not None, -np.inf
        self._time = np.nan  # of the last sample
        self._unsteady = ""  # what the load did within the tare's time
        self._shift = 0.0  # puts this log after the tare's on the estimator's clock [s]
        if before is not None:
            self._shift = before._time + before._shift + request.settings.log_gap - log.begin
        self._footprint = Footprint(request.robot, request.settings.model)
        self._entries: list[tuple[float, Array, Array, Array]] = []
        self._refused: list[Refusal] = []

    @property
    def estimator(self) -> Weigher:
        """The estimator, available after the first sample."""
        if self._estimator is None:
            raise IdentificationError(f"{self.log.source.source}: nothing could be learnt: no samples")
        return self._estimator

    def read(self) -> None:
        """Processes the log, and takes the tare at the end of its range."""
        progress, done = self._request.progress or (lambda *_: None), 0
        for chunk in self.log:
            if self._estimator is None:
                progress("preparing; the first run on a machine compiles for some seconds", 0, 0)
                self._estimator = self._made(chunk)
            self._check_rate(chunk.time)
            if chunk.imu is None and self.log is self._request.tare:
                self.log.notes["no IMU in the tare's log: its vertical is the direction of the feet's forces"] = None
            self._process(chunk)
            done += len(chunk)
            progress(f"weighing {self.log.source.name}", done, 0)

    def _process(self, chunk: Recording) -> None:
        """Processes a part of the log, piece by piece between the timeline's entries."""
        request, time, robot, frame = self._request, chunk.time, self._request.robot, self.log.imu_frame
        if self._shift:
            chunk = replace(chunk, time=time + self._shift)
        samples: Samples | list[Measurement]
        if not self._method.at_rest and isinstance(self._estimator, TrunkEstimator):
            seen = samples = Samples.of_recording(chunk, robot, frame)
        else:
            each = measurements_of(chunk, robot, frame) if chunk.imu else measurements_without_imu(chunk, robot)
            samples = list(each)
            seen = Samples.of(samples)
        self._footprint.add(time, seen.position, seen.specific_force)
        entries = set((np.flatnonzero(np.diff(np.floor(time / request.settings.entry)) > 0) + 1).tolist())
        begin, end = 0, len(time)
        if self._range is not None:
            begin = int(np.searchsorted(time, self._range[0]))
            end = int(np.searchsorted(time, self._range[1], "right"))
            if begin:
                self._refuse(float(time[0]), float(time[begin - 1]), _BEFORE)
        ends = {begin, end, len(time), *entries, *range(0, len(time), request.settings.ahead)}
        steps: Iterator[float] = iter(())
        if isinstance(samples, Samples) and isinstance(self._estimator, TrunkEstimator):
            steps = self._estimator.learning(samples[begin:].table)
        due = next(steps, np.inf)
        for start, stop in pairwise(sorted(k for k in ends if k >= begin)):
            if not isinstance(samples, Samples):
                self.estimator.add(samples[start:stop])
            while due <= chunk.time[stop - 1]:
                due = next(steps, np.inf)
            self._time = float(time[stop - 1])
            if request.watch is not None:
                request.watch(samples[start:stop], self.estimator)  # type: ignore[arg-type]
            self._record(float(time[start]), entry=stop in entries)
            self._tare_when_due()

    def tare(self, where: str) -> None:
        """Makes the present estimate of the trunk the reference for the payload."""
        if np.isnan((found := self.estimator.estimate()).time):
            raise IdentificationError(f"{where}: no tare: {self._nothing_learnt(found.reason)}")
        self.estimator.tare()
        if self._request.weight is not None and isinstance(self.estimator, TrunkEstimator):
            self.estimator.know_weight(*self._request.weight)  # the load may have changed since the beginning, unsaid
        self.tared, self._tared_at = True, self._time

    def result(self) -> Weighing:
        """The result from everything processed so far."""
        estimator, log, refused = self.estimator, self.log, self._refused
        estimate = estimator.estimate()
        self._require_learnt(estimate)
        self._enter()
        if (known := self._request.known) is not None and isinstance(estimator, TrunkEstimator):
            estimator.know_payload(known.mass, known.com, known.mass_std, known.com_std)
        memory, said = self._remembered()
        payload = estimator.payload
        logs = [log] if self._before is None else [self._before.log, log]
        learnt = estimate.time - self._shift
        trust, short = trust_now(estimator, learnt, log.begin), self._time - learnt < self._request.settings.stale
        trust = estimator.trust if short and trust.verdict != "bad" else trust
        time, values, stds, added = (np.array(column) for column in zip(*self._entries, strict=True))
        line = Timeline(time, values[:, 0], stds[:, 0], values[:, 1:], stds[:, 1:], None if payload is None else added)
        trust, stood = self._lowered(trust, payload, logs), self._footprint.stance
        elsewhere, place = self._whereabouts(payload)
        trust = trust.at_most("doubtful", elsewhere) if elsewhere else trust
        more = {name: getattr(estimator, name, None) for name in (_AT_REST if self._method.at_rest else _IN_MOTION)}
        return Weighing(
            robot=self._request.robot,
            source=log.source.source,
            method=self._request.method,
            status=str(estimate.status),
            trust=trust,
            trunk=estimator.trunk,
            time=learnt,
            payload=payload,
            changes=self._changes(payload),
            timeline=line,
            refusals=tuple(
                sorted((r for r in (*refused, *log.refusals) if r.end >= log.begin), key=lambda refusal: refusal.begin)
            ),
            begin=log.begin,
            end=log.end,
            notes=(
                *_without_imu(more.get("vertical")),
                *dict.fromkeys(note for read in logs for note in read.notes),
                *self._uncovered(),
                *filter(None, [place, said]),
            ),
            memory=memory,
            stance=None if stood is None else Stance(level_axes(stood[0]), stood[1]),
            steps_known=() if trust.verdict == "bad" else steps_known(self._request.robot, estimator),
            **more,  # type: ignore[arg-type]
        )

    # -- inside -----------------------------------------------------------------------------------------------
    def _whereabouts(self, payload: Payload | None) -> tuple[str, str]:
        """A doubt and a note, or empty, of where a load is and how sure that is, if places were compared: where its
        owner says that it is, or where it seems to be.
        """
        said, settings = self._request.at, self._request.settings
        if payload is None or not payload.places:
            return "", ""
        if abs(payload.mass) < SIGNIFICANT * payload.mass_std and not (said and self._changes(payload)):
            return "", ""
        best, second = sorted(payload.places.items(), key=lambda item: -item[1])[:2]
        at = said or payload.at or self._request.robot.trunk
        odds = best[1] / max(payload.places.get(at, 0.0) if best[0] != at else second[1], 1e-12)
        by = f"by odds of {min(odds, 1e6):.2g} to 1 against"
        if best[0] == at:
            return "", "" if said else f"the load is at {at}, {by} {second[0]}"
        if said:
            doubt = f"the load is said to be at {at}, but it is at {best[0]}, {by} {at}"
            return doubt if odds > settings.contradicted else "", ""
        taken = f"the load is taken to be at {at}, and cannot be told from one at {best[0]}"
        return "", f"{taken}: --at LINK says where it is, and motion of the limbs, or their torques in the log, show it"

    def _require_learnt(self, estimate: TrunkEstimate) -> None:
        """Raises IdentificationError: nothing was learnt, or nothing after the tare."""
        log = self.log
        if np.isnan(estimate.time):
            raise IdentificationError(f"{log.source.source}: {self._nothing_learnt(estimate.reason)}")
        if self._method.at_rest and estimate.time < self._tared_at + self._request.settings.entry:
            raise IdentificationError(
                f"{log.source.source}: the robot does not stand still after the tare's time, "
                f"{self._tared_at - log.begin:.3g} s{self._lacks()}"
            )

    def _nothing_learnt(self, reason: str) -> str:
        """Why there is no estimate yet, by the reason that the estimator gives last."""
        seen = [refusal for refusal in self._refused if refusal.reason != _BEFORE]
        if not (self._method.at_rest and seen):
            return f"nothing could be learnt: {reason or 'too few samples'}"
        longest = max(seen, key=lambda r: r.end - r.begin).reason
        return f"the robot never stands still, nothing to weigh by: {longest}{self._lacks()}"

    def _lacks(self) -> str:
        """Why a log is weighed at rest only, a clause; empty if that is not for what it lacks."""
        if self.log.first.imu is None:
            return "; the log has no IMU, without which only rest can be weighed by"
        slow = self._request.settings.too_slow(self.log.first.time)
        return f"; the log has {slow}" * bool(slow and self._method.at_rest)

    def _uncovered(self) -> Iterator[str]:
        """Says what a scale said, and, of a log without a tare, until when a load counts as part of the trunk."""
        if self._request.weight is not None:
            mass, std = self._request.weight
            when = "tare" if self.tared else "beginning"
            yield f"the robot's mass on a scale at the {when}: {mass:g} ± {std:.2g} kg"
        if (test := self._request.known) is not None:
            place = ", ".join(f"{v:g}" for v in test.com)
            yield f"the payload is said to be a test weight of {test.mass:g} kg at {place} m"
        if not self.tared and isinstance(self.estimator, TrunkEstimator):
            settings = self._request.settings.trunk
            known = settings.changes.history_walking * settings.block
            yield f"a load put on in the first {known:g} s may count as the trunk's; a tare (--tare) tells it apart"

    def _made(self, chunk: Recording) -> Weigher:
        request, robot, settings = self._request, self._request.robot, self._request.settings.trunk
        mount = ImuMount.of(robot, self.log.imu_frame, None if chunk.imu is None else chunk.imu.frame)
        if self._method.at_rest and len(chunk) > 1:  # a block has two samples, also of a slow log
            settings = settings.at_rest(float(np.clip(2.0 * np.median(np.diff(chunk.time)), settings.block, 0.2)))
        setup = Setup(robot, posture=self._posture(chunk, mount), mount=mount, settings=settings, at=request.at)
        estimator = self._method.make(setup)
        if isinstance(estimator, TrunkEstimator):
            if request.weight is not None:
                estimator.know_weight(*request.weight)
            if request.memory is not None:
                estimator.recall(request.memory, days_of(self.log.begin))
        return estimator

    def _remembered(self) -> tuple[Memory | None, str]:
        """The memory with this log, and what to say of it."""
        memory, estimator = self._request.memory, self.estimator
        if memory is None or not isinstance(estimator, TrunkEstimator):
            return None, ""
        return estimator.remembered(memory, days_of(self.log.begin))

    def _posture(self, first: Recording, mount: ImuMount) -> PostureLaw | None:
        """The trunk controller of the request, with the log's first orientation as its reference."""
        if (stiffness := self._request.stiffness) is None:
            return None
        if first.imu is None or first.imu.orientation is None:
            raise IdentificationError(
                f"{self.log.source.source}: the method 'orientation' needs columns imu.orientation.x, ..."
            )
        from stadera.lab.laws.orientation import PostureLaw

        reference = mount.trunk_rotation(rotation_matrix(first.imu.orientation[0]))
        return PostureLaw(np.array(stiffness), reference, feeds_back=False)

    def _check_rate(self, time: Array) -> None:
        if not self._method.at_rest and (slow := self._request.settings.too_slow(time)):
            raise RecordingError(f"{self.log.source.source}: {slow}")

    def _record(self, begin: float, *, entry: bool) -> None:
        """Notes a refusal since `begin` [s], and adds an entry to the timeline, once there is an estimate."""
        estimate = self.estimator.estimate()
        if estimate.reason:
            self._refuse(begin, self._time, estimate.reason)
        if entry and not np.isnan(estimate.time):
            self._enter()

    def _enter(self) -> None:
        trunk, payload = self.estimator.trunk, self.estimator.payload
        added = np.full(2, np.nan) if payload is None else np.array([payload.mass, payload.mass_std])
        std = np.sqrt(trunk.covariance.diagonal())
        value = np.array([trunk.inertial.mass, *trunk.inertial.com])
        self._entries.append((self._time, np.where(np.isnan(std), np.nan, value), std, added))

    def _tare_when_due(self) -> None:
        if self._range is None or self.tared or self._time < self._range[1]:
            return
        changes = [c for c in self.estimator.changes if c.kind != "shifted"]
        if changes:
            last, most = changes[-1], self._request.settings.tare_change * self._request.robot.mass
            self._unsteady = f"the load changes within the tare's time, at {last.time - self.log.begin:.2f} s"
            if max(abs(change.mass) for change in changes) > most:
                raise IdentificationError(f"{self.log.source.source}: {self._unsteady}")
            self._unsteady += f", by {last.mass:.2g} ± {last.mass_std:.1g} kg; the payload counts from then on"
        self.tare(_since_zero(*(t - self.log.begin for t in self._range)))

    def _refuse(self, begin: float, end: float, reason: str) -> None:
        last = self._refused[-1] if self._refused else None
        if (
            last is not None
            and _kind(last.reason) == _kind(reason)
            and begin - last.end < 2.0 * self._request.settings.entry
        ):
            self._refused[-1] = replace(last, end=end)
        else:
            self._refused.append(Refusal(begin, end, reason))

    def _changes(self, payload: Payload | None) -> tuple[LoadChange, ...]:
        """Changes of the load in this log, on its own clock."""
        shift = self._shift
        changes = self.estimator.changes[self._changes_before :]
        return since_tare([replace(c, time=c.time - shift, noticed=c.noticed - shift) for c in changes], payload)

    def _lowered(self, trust: Trust, payload: Payload | None, logs: list[CheckedLog]) -> Trust:
        """The estimator's trust, lowered by faults of the logs and by the model."""
        for log in logs:
            if log.event is not None:
                trust = trust.at_most(
                    "doubtful", f"as known at {log.event.begin - log.begin:.2f} s: {log.event.reason}"
                )
            for doubt in log.doubts:
                trust = trust.at_most(*doubt)
        if self._unsteady:
            trust = trust.at_most("doubtful", self._unsteady)
        found = self.estimator.trunk
        if found.observed[0]:
            robot, limits = self._request.robot, self._request.settings.model
            left_out = sum(part.end - part.begin for part in self._refused if part.reason == LIES)
            for doubt in doubts(robot, found.inertial, found.mass_std, payload, self._footprint, limits, left_out):
                trust = trust.at_most(*doubt)
        return trust
