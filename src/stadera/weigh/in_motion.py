"""Weighs a robot in any motion, in one pass over the log, with memory independent of its length.

The online estimator (`stadera.trunk.estimator`) processes the log as it would process live data. If the tare is a range
of time, the log is used from the start of that range, and the payload is the difference from the trunk estimated at its
end. If the tare is another log, that log is processed first; sensor constants (torque offsets, accelerometer bias,
torque lag) are assumed to be the same in both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from stadera.errors import IdentificationError, RecordingError
from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.load import LoadChange, Payload, since_tare
from stadera.trunk.protocol import Status
from stadera.trunk.registry import Setup, method_of
from stadera.trunk.samples import Samples
from stadera.trust import Trust, Verdict
from stadera.types import Array
from stadera.weigh.against_model import Footprint, doubts
from stadera.weigh.own import OwnEstimator
from stadera.weigh.reading import CheckedLog, require_imu
from stadera.weigh.result import Refusal, Timeline, Weighing
from stadera.weigh.settings import IN_MOTION, Request

_DIVERGED = "the estimate runs away"
"""Start of the estimator's refusal message when the estimate is implausible."""


def weigh_in_motion(request: Request) -> Weighing:
    """Weighs in any motion. Raises as `stadera.weigh.weigh`."""
    tare, robot = request.tare, request.robot
    require_imu(robot, request.source, request.method)
    before: _LogPass | None = None
    if tare is not None and not isinstance(tare, tuple):
        require_imu(robot, tare, request.method)
        before = _LogPass(request, CheckedLog(request, tare, ("imu",)))
        before.read()
        before.tare(tare.source)
    log = CheckedLog(request, request.source, ("imu",))
    reading = _LogPass(request, log, before)
    reading.read()
    if isinstance(tare, tuple) and not reading.tared:
        raise IdentificationError(
            f"{request.source.source}: the tare's time, {tare[0] - log.begin:g} to {tare[1] - log.begin:g} s, lies "
            f"outside the log, which is {log.end - log.begin:.3g} s long"
        )
    return reading.result()


def trust_now(estimator: TrunkEstimator | OwnEstimator, learnt: float | None = None, begin: float = 0.0) -> Trust:
    """The estimator's trust in its result, lowered if it refuses the latest samples, those after `learnt` [s]; times
    are said as since `begin` [s].
    """
    trust, estimate = estimator.trust, estimator.estimate()
    if estimate.status is not Status.REFUSED or trust.verdict == "bad":
        return trust
    verdict: Verdict = "bad" if estimate.reason.startswith(_DIVERGED) else "doubtful"
    at = estimate.time if learnt is None else learnt
    return trust.at_most(verdict, f"as known at {at - begin:.2f} s; nothing was learnt after it: {estimate.reason}")


class _LogPass:
    """Processing of one log of a request; continues with the estimator of `before`, the processing of the tare's log,
    if there is one.
    """

    def __init__(self, request: Request, log: CheckedLog, before: _LogPass | None = None) -> None:
        self.log = log
        self._request, self._before = request, before
        self._range = request.tare if isinstance(request.tare, tuple) and before is None else None
        self._estimator: TrunkEstimator | OwnEstimator | None = None if before is None else before.estimator
        self._changes_before = 0 if self._estimator is None else len(self._estimator.changes)
        self.tared = before is not None
        self._time = np.nan  # of the last sample
        self._shift: float | None = None if before is not None else 0.0
        self._done = 0
        self._footprint = Footprint(request.robot, request.settings.model)
        self._entries: list[tuple[float, Array, Array, Array]] = []
        self._refused: list[Refusal] = []

    @property
    def estimator(self) -> TrunkEstimator | OwnEstimator:
        """The estimator, available after the first sample."""
        if self._estimator is None:
            raise IdentificationError(f"{self.log.source.source}: nothing could be learnt: no samples")
        return self._estimator

    def read(self) -> None:
        """Processes the log and takes the tare at the end of its range."""
        settings, frame = self._request.settings, self._request.imu_frame
        for chunk in self.log:
            if self._estimator is None:
                if self._request.progress:
                    self._request.progress("preparing; the first run on a machine compiles for some seconds", 0, 0)
                self._estimator = self._made(chunk)
            samples = Samples.of_recording(chunk, self._request.robot, frame)
            self._check_rate(samples)
            self._footprint.add(samples)
            if self._shift is None and self._before is not None:  # puts this log after the tare's
                self._shift = self._before.last + settings.log_gap - self.log.begin
            for start in range(0, len(samples), settings.ahead):
                self._take(samples[start : start + settings.ahead])
            self._done += len(samples)
            if self._request.progress:
                self._request.progress(f"weighing {self.log.source.name}", self._done, 0)

    @property
    def last(self) -> float:
        """Time of the last sample on the estimator's clock [s]."""
        return self._time + (self._shift or 0.0)

    def tare(self, where: str) -> None:
        """Makes the present estimate of the trunk the reference for the payload."""
        if not self.estimator.parameters().observed[0]:
            raise IdentificationError(f"{where}: too short for a tare, the trunk's mass is not known by its end")
        self.estimator.tare()
        self.tared = True

    def result(self) -> Weighing:
        """The result from everything processed so far."""
        estimator, log = self.estimator, self.log
        estimate, payload = estimator.estimate(), estimator.payload
        self._enter()
        if not self._entries:
            raise IdentificationError(
                f"{log.source.source}: nothing could be learnt: {estimate.reason or 'too few samples'}"
            )
        time, values, stds, payloads = (np.array(column) for column in zip(*self._entries, strict=True))
        logs = [log] if self._before is None else [self._before.log, log]
        learnt = estimate.time - (self._shift or 0.0)
        return Weighing(
            robot=self._request.robot,
            source=log.source.source,
            method=self._request.method,
            status=str(estimate.status),
            trust=self._trust(learnt, logs),
            trunk=estimator.parameters(),
            time=learnt,
            payload=payload,
            changes=self._changes(payload),
            timeline=Timeline(
                time, values[:, 0], stds[:, 0], values[:, 1:], stds[:, 1:], None if payload is None else payloads
            ),
            refusals=tuple(sorted((*self._refused, *log.refusals), key=lambda refusal: refusal.begin)),
            begin=log.begin,
            end=log.end,
            torque_lag=estimator.torque_lag,
            notes=(*dict.fromkeys(note for read in logs for note in read.notes), *self._uncovered()),
            evidence=estimator.evidence,
            spikes=estimator.spikes,
            impacts=estimator.impacts,
            drives=estimator.drives,
        )

    # -- inside -----------------------------------------------------------------------------------------------
    def _uncovered(self) -> Iterator[str]:
        """Says what a scale said, and, of a log without a tare, until when a load is not told from the trunk."""
        if self._request.weight is not None:
            mass, std = self._request.weight
            when = "tare" if self.tared else "beginning"
            yield f"the robot's mass on a scale, {mass:g} ± {std:.2g} kg at the {when}, is used"
        if not self.tared:
            known = self._request.settings.trunk.changes.history
            yield f"a load put on in the first {known:g} s counts as part of the trunk; a tare (--tare) tells it apart"

    def _made(self, chunk: Recording) -> TrunkEstimator | OwnEstimator:
        robot, settings, imu = self._request.robot, self._request.settings, chunk.imu
        mount = ImuMount.of(robot, self._request.imu_frame or (None if imu is None else imu.frame))
        if self._request.method != IN_MOTION:
            setup = Setup(robot, mount=mount)
            return OwnEstimator(method_of(self._request.method).make(setup), robot, mount)
        estimator = TrunkEstimator(robot, settings=settings.trunk, mount=mount)
        if self._request.weight is not None:
            estimator.know_weight(*self._request.weight)
        return estimator

    def _check_rate(self, samples: Samples) -> None:
        slowest = 1.0 / self._request.settings.least_rate
        step = float(np.median(np.diff(samples.time))) if len(samples) > 1 else 0.0
        if step > self._request.settings.jitter * slowest:
            raise RecordingError(
                f"{self.log.source.source}: {1 / step:.3g} samples a second, of which weighing in motion sees too "
                f"little; {1 / slowest:.3g} are needed"
            )

    def _take(self, samples: Samples) -> None:
        """Passes samples on in pieces that end at the timeline's entries and at the ends of the tare."""
        if self._range is not None and (before := int(np.searchsorted(samples.time, self._range[0]))):
            self._time = float(samples.time[before - 1])
            self._refuse(float(samples.time[0]), self._time, "before the tare's time")
            samples = samples[before:]
        entry = np.flatnonzero(np.diff(np.floor(samples.time / self._request.settings.entry)) > 0) + 1
        ends, table = {int(end) for end in entry} | {len(samples)}, samples.table
        table[:, 0] += self._shift or 0.0
        if self._range is not None:
            ends.add(int(np.searchsorted(samples.time, self._range[1], side="right")))
        for start, stop in pairwise(sorted(ends | {0})):
            self._add(samples, table, slice(start, stop))
            if stop in entry:
                self._enter()
            self._tare_when_due()

    def _add(self, samples: Samples, table: Array, part: slice) -> None:
        """Passes on part of some samples; the table is of all of them, on the estimator's clock."""
        begin, self._time = samples.time[[part.start, part.stop - 1]].tolist()
        self.estimator.add_table(table[part])
        if self._request.watch is not None and isinstance(self.estimator, TrunkEstimator):
            self._request.watch(samples[part], self.estimator)
        if reason := self.estimator.refusal:
            self._refuse(begin, self._time, reason)

    def _enter(self) -> None:
        """Adds an entry to the timeline, once there is an estimate."""
        estimator = self.estimator
        if np.isnan(estimator.learnt):
            return
        trunk, payload = estimator.parameters(), estimator.payload
        added = np.full(2, np.nan) if payload is None else np.array([payload.mass, payload.mass_std])
        value = np.array([trunk.inertial.mass, *trunk.inertial.com])
        std = np.sqrt(trunk.covariance.diagonal())
        self._entries.append((self._time, np.where(np.isnan(std), np.nan, value), std, added))

    def _tare_when_due(self) -> None:
        if self._range is None or self.tared or self._time < self._range[1]:
            return
        changes = [c for c in self.estimator.changes if c.kind != "shifted"]
        if changes:
            raise IdentificationError(
                f"{self.log.source.source}: the load changes within the tare's time, at "
                f"{changes[-1].time - self.log.begin:.2f} s"
            )
        self.tare(f"{self._range[0] - self.log.begin:g} to {self._range[1] - self.log.begin:g} s")

    def _refuse(self, begin: float, end: float, reason: str) -> None:
        last = self._refused[-1] if self._refused else None
        if last is not None and last.reason == reason and begin - last.end < 2.0 * self._request.settings.entry:
            self._refused[-1] = replace(last, end=end)
        else:
            self._refused.append(Refusal(begin, end, reason))

    def _changes(self, payload: Payload | None) -> tuple[LoadChange, ...]:
        """Changes of the load in this log, on its own clock."""
        shift = self._shift or 0.0
        changes = self.estimator.changes[self._changes_before :]
        return since_tare([replace(c, time=c.time - shift, noticed=c.noticed - shift) for c in changes], payload)

    def _trust(self, learnt: float, logs: list[CheckedLog]) -> Trust:
        trust = trust_now(self.estimator, learnt, self.log.begin)
        for log in logs:
            if log.event is not None:
                trust = trust.at_most(
                    "doubtful", f"as known at {log.event.begin - log.begin:.2f} s: {log.event.reason}"
                )
            for doubt in log.doubts:
                trust = trust.at_most(*doubt)
        found, payload = self.estimator.parameters(), self.estimator.payload
        if found.observed[0]:
            limits = self._request.settings.model
            for doubt in doubts(self._request.robot, found.inertial, payload, self._footprint, limits):
                trust = trust.at_most(*doubt)
        return trust
