"""Changes of the load: detected, reported once they exceed their error bars, and withdrawn if they were a push."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from stadera.robot.model import Robot
from stadera.trunk.changes import ChangeDetector, Jump
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.history import History, Known
from stadera.trunk.joint_errors import Errors
from stadera.trunk.load import SIGNIFICANT, ChangeKind, LoadChange, without_scale
from stadera.trunk.segment import Segment, WeightedRows
from stadera.trunk.settings import TrunkSettings
from stadera.types import Array


class Found(Enum):
    """What a block shows: the same load, another one, or the load before the last change, which was a push."""

    SAME, OTHER, BACK = range(3)


@dataclass(frozen=True, eq=False)
class _Change:
    """A change whose new load is still being estimated, with the estimate before it; `shown` as in `Jump`."""

    time: float
    noticed: float
    before: Segment
    shown: Array


@dataclass(frozen=True, eq=False)
class _Rival:
    """What was known before the last change, the estimate right `since` it, and what had been reported then."""

    time: float
    known: Known
    since: Segment
    changes: tuple[LoadChange, ...]
    changing: _Change | None


class LoadChanges:
    """Changes of one robot's load.

    A detected change is a `candidate` until it exceeds its error bars, model errors included; then it is the one that
    is `changing`, and its mass is that of the present estimate until the next change is reported.

    Args:
        robot: the model. layout: places of the model errors.

    Attributes:
        detector: of changes.
    """

    def __init__(self, robot: Robot, layout: ErrorLayout, settings: TrunkSettings) -> None:
        self._settings, self._mass, le = settings, robot.mass, robot.leg_length
        scale = robot.mass * np.array([1.0, le, le, le])
        self.detector = ChangeDetector(settings.changes, scale, settings.block, layout)
        self._ended: tuple[LoadChange, ...] = ()
        self._changing: _Change | None = None
        self._candidate: _Change | None = None
        self._rival: _Rival | None = None

    def all(self, history: History, errors: Errors) -> tuple[LoadChange, ...]:
        """All changes so far; the last one's mass is that of the present estimate."""
        if self._changing is None:
            return self._ended
        return (*self._ended, self._weighed(self._changing, history.current, errors, history.scatter.value))

    def keep(self) -> None:
        """Keeps the last change for good: its load was made the tare."""
        self._rival = None

    def look(self, rows: WeightedRows, history: History, errors: Errors, held: bool) -> Found:
        """Looks for a change in the last block, and divides the history there; `held`: reports none."""
        now, scatter = rows.time, history.scatter.value
        if self._withdrawn(history, errors, now):
            return Found.BACK
        jump = self.detector.look(rows, history.aged, history.oldest, errors, scatter, held)
        if jump is not None:
            self._divide(jump, history, errors, now)
            return Found.OTHER
        if history.blocks % self._settings.checked == 0:
            self._report(history, errors, now)
        return Found.SAME

    def _divide(self, jump: Jump, history: History, errors: Errors, now: float) -> None:
        """Begins another load with the rows since a change."""
        blocks = min(jump.blocks, len(history.recent))
        begun = history.recent[-blocks].time - self._settings.block
        known = history.begin_load(blocks, errors.mean)
        rival = self._rival or _Rival(now, known, known.before, self._ended, self._changing)
        self._rival = replace(rival, since=history.current)
        self._candidate = _Change(begun, now, known.before, jump.shown) if jump.reported else None
        self._report(history, errors, now)
        self.detector.restart(len(history.recent))

    def _withdrawn(self, history: History, errors: Errors, now: float) -> bool:
        """Returns to the load before the last change if it is that again; forgets that load once the change is old."""
        rival = self._rival
        if rival is None:
            return False
        if now - rival.time > self._settings.changes.transient:
            self._rival = None
        elif self.detector.returned(rival.known.before, rival.since, errors):
            self._rival = self._candidate = None
            self._ended, self._changing = rival.changes, rival.changing
            history.return_to(rival.known)
            self.detector.restart(len(history.recent))
            return True
        return False

    def _report(self, history: History, errors: Errors, now: float) -> None:
        """Reports the detected change once it exceeds its error bars; a change that never does is not reported."""
        candidate = self._candidate
        if candidate is None:
            return
        if self._exceeds_errors(candidate, history, errors):
            if self._changing is not None:
                ended = self._weighed(self._changing, candidate.before, errors, history.scatter.value)
                self._ended = (*self._ended, ended)
            self._changing, self._candidate = replace(candidate, noticed=now), None
        elif now - candidate.noticed > self._settings.reported_within:
            self._candidate = None

    def _exceeds_errors(self, change: _Change, history: History, errors: Errors) -> bool:
        """True if mass or first moment differ from the earlier ones by more than their errors, while no joint sticks.

        Model errors count as far as averages under a constant load show them.
        """
        p, now, scatter = errors.mean, history.current, history.scatter.value
        difference = (now.mean(p) - change.before.mean(p))[:4]
        rows = errors.rows_covariance(change.before, now, scatter, stiction=False)
        total = errors.difference_covariance(change.before, now, scatter, stiction=False)
        own, both = np.diag(rows)[:4], np.diag(total)[:4]
        return bool((np.abs(difference) > SIGNIFICANT * np.sqrt(own + change.shown * (both - own))).any())

    def _weighed(self, change: _Change, now: Segment, errors: Errors, scatter: float) -> LoadChange:
        mass = float(now.mean(errors.mean)[0] - change.before.mean(errors.mean)[0])
        variance = float(errors.difference_covariance(change.before, now, scatter)[0, 0])
        std = float(np.sqrt(variance))
        kind: ChangeKind = "on" if mass > 0 else "off"
        if abs(mass) < max(SIGNIFICANT * std, self._settings.changes.shifted * self._mass):
            kind = "shifted"
        by_scale = errors.by_scale(now.sensitivity - change.before.sensitivity)
        return LoadChange(change.time, change.noticed, mass, std, kind, without_scale(variance, by_scale[0]))
