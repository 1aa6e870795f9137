"""Support phases over the coming steps, through which the centre of mass is planned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stadera.lab.control.crawl.settings import StepTiming
from stadera.lab.control.planner.com import SupportPhase, plan_com
from stadera.lab.control.planner.feet import SupportPolygon
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class PlannedStep:
    """A coming step: index of the leg, its foothold (2,) [m], and the time before it lifts [s]."""

    leg: int
    target: Array
    body: float


@dataclass(frozen=True, eq=False)
class Airborne:
    """A leg that swings or has just landed: its index, its foothold (2,) [m], and its remaining time [s]."""

    leg: int
    target: Array
    remaining: float


def support_phases(
    feet: Array,
    steps: Sequence[PlannedStep],
    timing: StepTiming,
    margin: float,
    stand: float,
    airborne: Airborne | None = None,
) -> list[SupportPhase]:
    """The phases from now on, ending with a stand of `stand` [s] on four feet.

    While a foot is being unloaded or loaded, only the other three count as support. `feet`: (4, 2) [m]; that of an
    airborne one is ignored. `margin` [m]: of the goals within the triangles.
    """
    feet, phases = np.array(feet[:, :2]), []
    landed = 0.0
    if airborne is not None:
        phases.append(_on_three(feet, airborne.leg, airborne.target, max(airborne.remaining, timing.least), margin))
        feet[airborne.leg] = airborne.target
        landed = timing.transfer
    for step in steps:
        duration = max(2.0 * timing.transfer + timing.swing, timing.least)
        swing = _on_three(feet, step.leg, step.target, duration, margin)
        before = max(step.body - timing.transfer - landed, timing.least)
        phases += [SupportPhase(before, SupportPolygon.of(feet), swing.goal, rests=False), swing]
        feet[step.leg] = step.target
        landed = timing.transfer
    phases.append(SupportPhase(stand, SupportPolygon.of(feet), feet.mean(axis=0), rests=False))
    return phases


def body_times(
    offsets: Array, sequence: Sequence[int], stride: float, timing: StepTiming, height: float, margin: float
) -> Array:
    """Time for the body before each step of the sequence, (4,) [s]: more if it has farther to go.

    Two cycles straight ahead are planned with equal times, and the distances between swings are evaluated: distances d
    in times T with equal peak accelerations have T ∝ √d. The mean of the times is the timing's; none is shorter than
    the transfers of load. Nominal positions of the feet (4, 2), stride of a cycle, height of the centre of mass over
    the feet and margin in [m].
    """
    least = min(2.0 * timing.transfer + timing.least, timing.body)
    feet, steps = np.array(offsets), []
    for k, leg in enumerate(sequence):  # as if the robot had been walking: the last to land is the farthest ahead
        feet[leg, 0] += (k - 1.5) * 0.25 * stride
    for k, leg in enumerate(2 * tuple(sequence)):
        steps.append(PlannedStep(leg, feet[leg] + np.array([(k // 4 + 1) * stride, 0.0]), timing.body))
    start = np.zeros((3, 2))
    start[0] = feet.mean(axis=0)
    phases = support_phases(feet, steps, timing, margin, timing.step)
    plan = plan_com(0.0, start, phases, height, margin, timing.rest)
    swings = timing.body + 0.5 * timing.swing + timing.step * np.arange(3, 8)
    ways = np.diff([plan.at(time)[0] for time in swings], axis=0)  # to the swings 4, 5, 6, 7: a whole cycle
    weights = np.sqrt(np.linalg.norm(ways, axis=1))
    return np.asarray(least + 4.0 * (timing.body - least) * weights / weights.sum())


def _on_three(feet: Array, leg: int, target: Array, duration: float, margin: float) -> SupportPhase:
    """The phase on the other three feet; the goal is the point in their triangle nearest to the middle of all four."""
    triangle = SupportPolygon.of(np.delete(feet, leg, axis=0))
    middle = feet.mean(axis=0) + 0.125 * (target - feet[leg])  # half-way through the swing
    return SupportPhase(duration, triangle, triangle.goal(middle, margin), rests=True)
