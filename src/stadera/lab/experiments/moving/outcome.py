"""Outcome of a commanded walk, from the states of the simulation: walked, stuck or fell.

With v the commanded speed, and s(t) the forward position of the trunk, a walk that ends at T without a fall is stuck if

- over its last gait cycle C it advanced by less than a share of the command, s(T) - s(T - C) < share · v C, or took
  fewer than that share of the commanded steps: so a robot that stops to weigh its load and walks on has walked;
- since the load, the trunk sagged by more than a share of its height for longer than a limit;
- since the load, one joint was continuously at its torque limit for longer than a limit.

The same limits hold with and without identification. The margin of the centre of mass in the support polygon is not
part of the outcome: a robot that tips onto the foot it was about to lift may still walk on.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stadera.errors import require_positive
from stadera.lab.control.crawl.run import Fall
from stadera.types import Array, Bools


class WalkOutcome(StrEnum):
    """Outcome of a walk."""

    WALKED = "walked"
    STUCK = "stuck"
    FELL = "fell"


@dataclass(frozen=True)
class OutcomeLimits:
    """Limits for being stuck; those for a fall are `FallLimits`."""

    # of the commanded distance and steps over the last cycle below which the robot is stuck. Half: a loaded robot may
    # be slower, while one that only steps in place has stopped.
    share: float = 0.5
    # decrease of the trunk's height above ground, as a share. 0.15: three times the deflection of the virtual springs
    # under 40 % of the robot's mass (m g / k = 0.05 h), and more than a swing's ground clearance.
    sag: float = 0.15
    # [s], time for which it must be that low. A step's time, since a landing load may push it down briefly.
    sagging: float = 0.8
    # [s], time for which a joint may be at its torque limit, since drives heat up. The controllers' own limit.
    overload: float = 0.5

    def __post_init__(self) -> None:
        require_positive("limits of an outcome:", self, ("share", "sag", "sagging", "overload"))


@dataclass(frozen=True, eq=False)
class WalkTrace:
    """True states of a walk, evenly sampled, and the command."""

    time: Array  # (k,) [s]
    position: Array  # (k, 3) [m], of the trunk's origin, world; the walk leads along x
    height: Array  # (k,) [m], of the trunk's origin above the ground
    limited: Bools  # (k, n) bool, joints whose torque is at its limit
    joints: tuple[str, ...]  # their n names
    steps: tuple[float, ...]  # when legs were lifted [s]
    speed: float  # commanded [m/s]
    step_time: float  # of one step, as commanded [s]
    loaded_at: float  # time of the load [s]; NaN if there is none
    fall: Fall | None  # None if it did not fall
    fault: str = ""  # why the controller failed; empty otherwise

    @property
    def since(self) -> int:
        """Index of the first sample with the load."""
        return (
            0 if np.isnan(self.loaded_at) else min(int(np.searchsorted(self.time, self.loaded_at)), len(self.time) - 1)
        )

    @property
    def distance(self) -> float:
        """Forward distance of the trunk since the load [m]."""
        return float(self.position[-1, 0] - self.position[self.since, 0])

    @property
    def commanded(self) -> float:
        """Commanded distance in that time [m], until the fall if there was one."""
        return self.speed * float(self.time[-1] - self.time[self.since])

    @property
    def steps_lost(self) -> int:
        """Number of commanded steps that were not taken, in pauses and at the end, counted from the last step before
        the load, or else from the load; 0 without one. In a pause a step counts from half its time on.
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
    """Outcome of a walk with its reasons; none if it walked."""

    outcome: WalkOutcome
    reasons: tuple[str, ...] = ()


def verdict(trace: WalkTrace, limits: OutcomeLimits | None = None) -> Verdict:
    """Evaluates the outcome of a walk."""
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
    """The shortfall over the last cycle, or over the time since the load if that is shorter."""
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
    """Longest time [s] for which samples (k,) at times (k,) were continuously true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(true, dtype=int), [0]])))
    begins, ends = edges[::2], edges[1::2] - 1
    return float((time[ends] - time[begins]).max()) if len(begins) else 0.0
