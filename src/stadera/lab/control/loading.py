"""Limits of each foot's load during loading and unloading, and detection of joints that stay at their torque limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError
from stadera.types import Array, Bools


@dataclass(frozen=True)
class Ramp:
    """A limit of a foot's normal force that changes linearly."""

    begin: float  # [s]
    duration: float  # [s], positive
    start: float  # [N]
    goal: float  # [N]
    remains: bool  # whether the limit persists after the end; else it is removed

    def __post_init__(self) -> None:
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise ModelError(f"loading or relieving a foot takes a positive time, got {self.duration} s")

    def at(self, time: float) -> float:
        """The limit [N]; infinite after the end."""
        x = (time - self.begin) / self.duration
        if x >= 1.0 and not self.remains:
            return np.inf
        return self.start + min(max(x, 0.0), 1.0) * (self.goal - self.start)


class FootLoads:
    """Limits of the four feet."""

    def __init__(self) -> None:
        self._ramps: list[Ramp | None] = [None] * 4
        self._changed = True
        self._moving = False

    def put(self, leg: int, ramp: Ramp | None) -> None:
        """Sets the limit of a foot; None removes it."""
        self._ramps[leg] = ramp
        self._changed = True

    def changed(self) -> None:
        """Makes the next call return the limits, whether they changed or not."""
        self._changed = True

    def relieved(self, leg: int, time: float) -> bool:
        """True if a foot may carry no load."""
        ramp = self._ramps[leg]
        return ramp is not None and ramp.at(time) <= 0.0

    def over(self, leg: int, time: float) -> bool:
        """True if a foot's ramp, if any, has ended."""
        ramp = self._ramps[leg]
        return ramp is None or time >= ramp.begin + ramp.duration

    def most(self, time: float) -> Array | None:
        """Limits (4,) [N]; None if they have not changed since the last call."""
        if not (self._changed or self._moving):
            return None
        self._changed = False
        self._moving = any(not self.over(leg, time) for leg in range(4))
        return np.array([np.inf if ramp is None else ramp.at(time) for ramp in self._ramps])


class OverloadWatch:
    """Measures for how long each joint has been at its limit continuously; after `longest` [s] it is overloaded."""

    def __init__(self, joints: Sequence[str], longest: float = 0.5) -> None:
        self._longest = longest
        self._joints, self._for, self._last = tuple(joints), np.zeros(len(joints)), np.nan

    def update(self, time: float, saturated: Bools) -> str:
        """Updates with joints at their limit, (n,) bool, at a time [s]; a sentence on an overloaded joint, or empty."""
        elapsed, self._last = 0.0 if np.isnan(self._last) else time - self._last, time
        self._for = np.where(saturated, self._for + elapsed, 0.0)
        worst = int(np.argmax(self._for))
        if self._for[worst] <= self._longest:
            return ""
        return f"joint {self._joints[worst]} has been at its torque limit for {self._longest} s"
