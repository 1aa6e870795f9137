"""Changes of the load: detected, weighed, and withdrawn if they were a push."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from math import inf, isfinite

import numpy as np

from stadera.robot.model import Robot
from stadera.trunk.block_rows import WeightedRows
from stadera.trunk.changes import ChangeDetector, Jump
from stadera.trunk.history import History, Known, wide_prior
from stadera.trunk.joint_errors import Errors
from stadera.trunk.load import SIGNIFICANT, ChangeKind, LoadChange, without_scale
from stadera.trunk.segment import Segment
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.where import Whereabouts


class Found(Enum):
    """What a block shows: the same load, another one, or the load before the last change, which was a push."""

    SAME, OTHER, BACK = range(3)


@dataclass(frozen=True, eq=False)
class _Change:
    """A change whose new load is still being estimated, with the estimate before it."""

    time: float
    noticed: float
    before: Segment


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

    The last one's mass is that of the present estimate, until the next one is detected.

    Args:
        robot: the model. where: the load may be.

    Attributes:
        detector: of changes.
        ended: estimates of loads that have ended: after a change, of the one before it; after a push, of all since
            then, which are the present load.
    """

    def __init__(self, robot: Robot, settings: TrunkSettings, where: Whereabouts) -> None:
        self._where = where
        self._settings, self._mass, le = settings, robot.mass, robot.leg_length
        scale = robot.mass * np.array([1.0, le, le, le])
        self.detector = ChangeDetector(settings.changes, scale, settings.after_change * wide_prior(robot))
        self.ended: tuple[Segment, ...] = ()
        self._ended: tuple[LoadChange, ...] = ()
        self._changing: _Change | None = None
        self._rival: _Rival | None = None
        self._placed = 0  # number of blocks when places were compared

    def all(self, history: History, errors: Errors) -> tuple[LoadChange, ...]:
        """All changes so far; the last one's mass is that of the present estimate."""
        if self._changing is None:
            return self._ended
        return (*self._ended, self._weighed(self._changing, history.current, errors))

    def keep(self) -> None:
        """Keeps the last change for good: its load was made the tare."""
        self._rival = None
        self._where.forget()

    def look(self, rows: WeightedRows, history: History, errors: Errors, misfit: float) -> Found:
        """Looks for a change in the last block, and divides the history there; `misfit`: see `ChangeDetector.look`."""
        if self._withdrawn(rows, history, errors):
            return Found.BACK
        jump = self.detector.look(history, errors, inf if self._unlike(rows, history.aged) else misfit)
        if isfinite(misfit):  # what joints of legs that stop hide does not matter to an arm
            jump = self.detector.felt(history, errors) or jump
        if jump is None or (not jump.felt and self.place(history, errors)):
            return Found.SAME
        self._divide(jump, history, errors, rows.time)
        return Found.OTHER

    def _unlike(self, rows: WeightedRows, before: Segment) -> bool:
        """True if friction may pass for a load, or hide one: of joints that stop, against an estimate from joints that
        slide, or reversely. A robot that has stood begins to move joint by joint, each that had rested for most of the
        time.
        """
        if 2.0 * before.moved > before.weight:
            return rows.sliding < self._settings.changes.sliding
        rested = 2.0 * before.slid.sum(axis=0) <= before.weight
        return bool((rows.slides.any(axis=0) & rested).any())

    def place(self, history: History, errors: Errors, wait: float = 0.0) -> bool:
        """Looks where the load is, unless that was done less than a time `wait` [s] ago; True if it is elsewhere than
        was taken, which may have looked like a change.
        """
        settings = self._settings
        if (history.blocks - self._placed) * settings.block < wait:
            return False
        self._placed = history.blocks
        if not self._where.look(history, errors, settings.swing.repeated, settings.placed):
            return False
        self.detector.dismiss()
        return True

    def _divide(self, jump: Jump, history: History, errors: Errors, now: float) -> None:
        """Begins another load with the rows since a change."""
        blocks = min(jump.blocks, len(history.recent))
        begun = history.recent[-blocks].time - self._settings.block
        empty = history.before
        known = history.begin_load(blocks, errors.mean)
        rival = self._rival or _Rival(now, known, known.before, self._ended, self._changing)
        since = history.oldest
        for rows in history.recent:  # as the robot seems to be: what friction holds is part of a push
            since = since.add(replace(rows, hidden=None))
        self._rival = replace(rival, since=since)
        self.ended = (known.loaded or known.before,)
        if empty is not None:
            load = self._weighed(_Change(begun, now, empty), self.ended[0], errors)
            if abs(load.mass) > SIGNIFICANT * load.mass_std:
                self._where.end(self.ended[0], empty, errors, self._settings.swing.repeated)
        if jump.reported:
            if self._changing is not None:
                self._ended = (*self._ended, self._weighed(self._changing, known.before, errors))
            self._changing = _Change(begun, now, known.before)
        self.detector.restart(len(history.recent))

    def _withdrawn(self, rows: WeightedRows, history: History, errors: Errors) -> bool:
        """Returns to the load before the last change if it is that again; forgets that load once the change is old."""
        rival = self._rival
        if rival is None:
            return False
        before = rival.known.before
        if rows.time - rival.time > self._settings.changes.transient:
            self._rival = None
        elif not self._unlike(rows, before) and self.detector.returned(before, rival.since, history, errors):
            self._rival = None
            self._ended, self._changing = rival.changes, rival.changing
            later = (load for load in history.finished if load not in rival.known.finished)
            self.ended = (*later, *filter(None, [rival.known.loaded]))
            history.return_to(rival.known)
            self.detector.restart(len(history.recent))
            return True
        return False

    def _weighed(self, change: _Change, now: Segment, errors: Errors) -> LoadChange:
        before, after = change.before.whole, now.whole
        mass = float(after.mean(errors.mean)[0] - before.mean(errors.mean)[0])
        moved = after.sensitivity - before.sensitivity
        by_law, by_scale = errors.by_law(moved), errors.by_scale(moved)
        covariance = errors.difference_covariance(before, after, errors.alike(change.before, now))
        variance = float(covariance[0, 0] + by_law[0] ** 2)
        std = float(np.sqrt(variance))
        kind: ChangeKind = "on" if mass > 0 else "off"
        if abs(mass) < max(SIGNIFICANT * std, self._settings.changes.shifted * self._mass):
            kind = "shifted"
        held = now.held if mass > 0 else change.before.held
        at = "" if held is None else self._where.name(held.at)
        return LoadChange(change.time, change.noticed, mass, std, kind, without_scale(variance, by_scale[0]), at)
