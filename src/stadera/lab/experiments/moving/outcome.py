"""Outcome of a commanded walk, from the states of the simulation alone: walked, stuck or fell.

With v the commanded speed, and s(t) how far ahead the trunk is, a walk that ends at T without a fall is stuck if

- over its last gait cycle C it got ahead by less than a share of what was commanded, s(T) - s(T - C) < share · v C, or
  took less than that share of the commanded steps: so a robot that stops to weigh its load and walks on has walked;
- since the load came on, the trunk sagged by more than a share of its height, for longer than a stated time;
- since then, one joint was at its torque limit for longer than a stated time without a break.

The same limits hold with and without identification. The margin of the centre of mass in the support polygon is no part
of the outcome: a robot that tips onto the foot it was about to lift may still walk on.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stadera.errors import require_positive
from stadera.lab.control.crawl.run import Fall
from stadera.types import Array, Bools


class WalkOutcome(StrEnum):
    """How a walk ended."""

    WALKED = "walked"
    STUCK = "stuck"
    FELL = "fell"


@dataclass(frozen=True)
class OutcomeLimits:
    """What counts as stuck; what counts as a fall is `FallLimits`.

    Attributes:
        share: of the commanded distance and steps over the last cycle, below which the robot does not get on. Half: a
            loaded robot may be slower, one that only marks time has stopped.
        sag: share of the trunk's height above ground by which it is too low. 0.15: three times what the virtual springs
            give under 40 % of the robot's mass (m g / k = 0.05 h), and more than a swing clears the ground by.
        sagging: [s], for which it must be that low. A step's time: a landing load may push it down for a moment.
        overload: [s], that a joint may be at its torque limit; drives get hot. The controllers' own limit.

    Raises:
        StaderaError: a limit that is not positive.
    """

    share: float = 0.5
    sag: float = 0.15
    sagging: float = 0.8
    overload: float = 0.5

    def __post_init__(self) -> None:
        require_positive("limits of an outcome:", self, ("share", "sag", "sagging", "overload"))


@dataclass(frozen=True, eq=False)
class WalkTrace:
    """True states of a walk, evenly sampled, and what was commanded.

    Attributes:
        time: (k,) [s]. position: (k, 3) [m], of the trunk's origin, world; the walk leads along x.
        height: (k,) [m], of the trunk's origin over the ground.
        limited: (k, n) bool, joints whose torque is at its limit. joints: their n names.
        steps: when legs were lifted [s].
        speed: commanded [m/s]. step_time: of one step, as commanded [s].
        loaded_at: when the load came on [s]; NaN if none did.
        fall: None if it did not fall.
        fault: why the controller gave up; empty if it did not.
    """

    time: Array
    position: Array
    height: Array
    limited: Bools
    joints: tuple[str, ...]
    steps: tuple[float, ...]
    speed: float
    step_time: float
    loaded_at: float
    fall: Fall | None
    fault: str = ""

    @property
    def since(self) -> int:
        """Index of the first sample with the load."""
        return (
            0 if np.isnan(self.loaded_at) else min(int(np.searchsorted(self.time, self.loaded_at)), len(self.time) - 1)
        )

    @property
    def distance(self) -> float:
        """How far the trunk got ahead since the load came on [m]."""
        return float(self.position[-1, 0] - self.position[self.since, 0])

    @property
    def commanded(self) -> float:
        """How far it was to get in that time [m], until it fell if it did."""
        return self.speed * float(self.time[-1] - self.time[self.since])

    @property
    def steps_lost(self) -> int:
        """Steps for which there was time, as commanded, while none was taken: in pauses and at the end, from the last
        step before the load on, or else from the load; 0 without one. In a pause a step counts from half its time on.
        """
        before = [time for time in self.steps if time < self.loaded_at]
        since = before[-1] if before else self.loaded_at
        if np.isnan(since):
            return 0
        lifted = np.array([since, *self.steps[len(before) :]])
        pauses = np.round(np.diff(lifted) / self.step_time) - 1.0
        return int(np.maximum(pauses, 0.0).sum()) + int((self.time[-1] - lifted[-1]) / self.step_time)


@dataclass(frozen=True)
class Verdict:
    """How a walk ended, and why it counts as that; no reasons where it walked."""

    outcome: WalkOutcome
    reasons: tuple[str, ...] = ()


def verdict(trace: WalkTrace, limits: OutcomeLimits | None = None) -> Verdict:
    """The outcome of a walk."""
    limits, fault = limits or OutcomeLimits(), (trace.fault,) if trace.fault else ()
    if trace.fall is not None:
        return Verdict(WalkOutcome.FELL, (trace.fall.how, *fault))
    reasons = (_overload(trace, limits), _sagging(trace, limits), _progress(trace, limits), *fault)
    found = tuple(reason for reason in reasons if reason)
    return Verdict(WalkOutcome.STUCK if found else WalkOutcome.WALKED, found)


def _overload(trace: WalkTrace, limits: OutcomeLimits) -> str:
    spells = [
        longest_spell(trace.time[trace.since :], trace.limited[trace.since :, j]) for j in range(len(trace.joints))
    ]
    worst = int(np.argmax(spells))
    if spells[worst] <= limits.overload:
        return ""
    return f"joint {trace.joints[worst]} was at its torque limit for {spells[worst]:.1f} s"


def _sagging(trace: WalkTrace, limits: OutcomeLimits) -> str:
    height = trace.height[trace.since :]
    spell = longest_spell(trace.time[trace.since :], height < (1.0 - limits.sag) * height[0])
    return f"the trunk sagged by up to {100.0 * (height[0] - height.min()):.0f} cm" if spell > limits.sagging else ""


def _progress(trace: WalkTrace, limits: OutcomeLimits) -> str:
    """What is missing of the last cycle, or of the time since the load where that is shorter."""
    end, cycle = float(trace.time[-1]), 4.0 * trace.step_time
    window = min(cycle, end - float(trace.time[trace.since]))
    first = int(np.searchsorted(trace.time, end - window))
    ahead = float(trace.position[-1, 0] - trace.position[first, 0])
    taken = sum(time > end - window for time in trace.steps)
    if ahead < limits.share * trace.speed * window:
        return f"it got {100.0 * ahead:.0f} of {100.0 * trace.speed * window:.0f} cm ahead in the last {window:.1f} s"
    if taken < limits.share * np.floor(window / trace.step_time):
        return f"it took {taken} of {window / trace.step_time:.0f} steps in the last {window:.1f} s"
    return ""


def longest_spell(time: Array, true: Bools) -> float:
    """Longest time [s] for which samples (k,) at times (k,) were true without a break."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(true, dtype=int), [0]])))
    begins, ends = edges[::2], edges[1::2] - 1
    return float((time[ends] - time[begins]).max()) if len(begins) else 0.0
