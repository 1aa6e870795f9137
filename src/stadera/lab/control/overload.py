"""Detects joints that stay at their torque limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stadera.types import Bools


class OverloadWatch:
    """Measures for how long each joint has been at its limit continuously.

    Args:
        joints: their names, in the order of the values.
        longest: time at its limit after which a joint is overloaded [s].
    """

    def __init__(self, joints: Sequence[str], longest: float = 0.5) -> None:
        self._longest = longest
        self._joints, self._for, self._last = tuple(joints), np.zeros(len(joints)), np.nan

    def update(self, time: float, saturated: Bools) -> str:
        """Updates with joints at their limit, (n,) bool at a time [s]; returns a sentence on an overloaded joint, else
        empty.
        """
        elapsed, self._last = 0.0 if np.isnan(self._last) else time - self._last, time
        self._for = np.where(saturated, self._for + elapsed, 0.0)
        worst = int(np.argmax(self._for))
        if self._for[worst] <= self._longest:
            return ""
        return f"joint {self._joints[worst]} has been at its torque limit for {self._longest} s"
