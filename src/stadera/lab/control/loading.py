"""How much each foot may carry while its load comes or goes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError
from stadera.types import Array


@dataclass(frozen=True)
class Ramp:
    """A cap on a foot's normal force that changes linearly.

    Attributes:
        begin: [s]. duration: [s], positive.
        start, goal: [N].
        remains: whether the cap stays after the end; else there is none any more.
    """

    begin: float
    duration: float
    start: float
    goal: float
    remains: bool

    def __post_init__(self) -> None:
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise ModelError(f"loading or relieving a foot takes a positive time, got {self.duration} s")

    def at(self, time: float) -> float:
        """The cap [N]; infinite when it is over."""
        x = (time - self.begin) / self.duration
        if x >= 1.0 and not self.remains:
            return np.inf
        return self.start + min(max(x, 0.0), 1.0) * (self.goal - self.start)


class FootLoads:
    """Caps of the four feet."""

    def __init__(self) -> None:
        self._ramps: list[Ramp | None] = [None] * 4
        self._changed = True
        self._moving = False

    def put(self, leg: int, ramp: Ramp | None) -> None:
        """Caps a foot; None frees it."""
        self._ramps[leg] = ramp
        self._changed = True

    def changed(self) -> None:
        """The next call returns the caps, whether they changed or not."""
        self._changed = True

    def relieved(self, leg: int, time: float) -> bool:
        """Whether a foot may carry nothing."""
        ramp = self._ramps[leg]
        return ramp is not None and ramp.at(time) <= 0.0

    def over(self, leg: int, time: float) -> bool:
        """Whether a foot's ramp, if any, has come to its end."""
        ramp = self._ramps[leg]
        return ramp is None or time >= ramp.begin + ramp.duration

    def most(self, time: float) -> Array | None:
        """Caps (4,) [N]; None if they are what they were at the last call."""
        if not (self._changed or self._moving):
            return None
        self._changed = False
        self._moving = any(not self.over(leg, time) for leg in range(4))
        return np.array([np.inf if ramp is None else ramp.at(time) for ramp in self._ramps])
