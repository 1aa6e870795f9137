"""Walked, stuck or fell: of made-up traces whose outcome is known, and of limits that make no sense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.lab.control.monitor import Fall
from stadera.lab.experiments.loaded_walk import WalkOutcome, WalkTrace, longest_spell

TIME = np.arange(0.0, 12.0, 0.01)
JOINTS = ("lf_hfe", "lf_kfe")


def walking(speed: float = 0.1, stop: float = np.inf, again: float = np.inf) -> WalkTrace:
    """Walks evenly, a step every 0.8 s, stands between `stop` and `again` [s]; 5 s in the load comes on."""
    moving = (stop > TIME) | (again <= TIME)
    ahead = np.cumsum(np.where(moving, speed * 0.01, 0.0))
    steps = tuple(t for t in np.arange(0.4, 12.0, 0.8).tolist() if t < stop or t >= again)
    return WalkTrace(
        time=TIME,
        margin=np.full_like(TIME, 0.05),
        position=np.column_stack([ahead, np.zeros_like(ahead), np.full_like(ahead, 0.6)]),
        height=np.full_like(TIME, 0.6),
        limited=np.zeros((len(TIME), 2), dtype=bool),
        joints=JOINTS,
        steps=steps,
        speed=0.1,
        step_time=0.8,
        loaded_at=5.0,
        fall=None,
    )


def between(begin: float, end: float) -> np.ndarray:
    return (begin <= TIME) & (end > TIME)


def test_who_gets_on_has_walked():
    trace = walking()
    assert trace.outcome is WalkOutcome.WALKED
    assert trace.reasons == ()
    assert trace.distance == pytest.approx(0.7, abs=0.01)
    assert trace.commanded == pytest.approx(0.7, abs=0.01)
    assert trace.steps_lost == 0
    assert walking(speed=0.06).outcome is WalkOutcome.WALKED, "slower, but more than half"


def test_who_stops_to_weigh_and_walks_on_has_walked():
    trace = walking(stop=5.5, again=8.5)
    assert trace.outcome is WalkOutcome.WALKED
    assert trace.steps_lost == 4


@pytest.mark.parametrize("trace", [walking(stop=6.0), walking(speed=0.04), walking(stop=9.5)])
def test_who_does_not_get_on_is_stuck(trace: WalkTrace):
    found = trace
    assert found.outcome is WalkOutcome.STUCK
    assert "ahead in the last 3.2 s" in found.reasons[0]


def test_who_slides_without_steps_is_stuck():
    found = replace(walking(), steps=(0.4, 1.2))
    assert found.outcome is WalkOutcome.STUCK
    assert "0 of 4 steps" in found.reasons[0]


@pytest.mark.parametrize(("seconds", "outcome"), [(0.45, WalkOutcome.WALKED), (0.6, WalkOutcome.STUCK)])
def test_a_joint_at_its_torque_limit(seconds: float, outcome: WalkOutcome):
    limited = np.column_stack([between(7.0, 7.0 + seconds), between(6.0, 6.4) | between(6.5, 6.9)])
    found = replace(walking(), limited=limited)
    assert found.outcome is outcome
    assert (found.reasons == ()) is (outcome is WalkOutcome.WALKED)
    if found.reasons:
        assert "lf_hfe was at its torque limit for 0.6 s" in found.reasons[0]
    early = np.column_stack([between(1.0, 4.0)] * 2)
    assert replace(walking(), limited=early).outcome is WalkOutcome.WALKED, "before the load"


@pytest.mark.parametrize(
    ("drop", "seconds", "outcome"),
    [(0.08, 5.0, WalkOutcome.WALKED), (0.11, 0.7, WalkOutcome.WALKED), (0.11, 1.0, WalkOutcome.STUCK)],
)
def test_a_trunk_that_sags(drop: float, seconds: float, outcome: WalkOutcome):
    height = 0.6 - drop * between(6.0, 6.0 + seconds)
    found = replace(walking(), height=height)
    assert found.outcome is outcome
    assert all("sagged by up to 11 cm" in reason for reason in found.reasons)


def test_a_fall_is_a_fall_whatever_else():
    fallen = replace(walking(stop=6.0), fall=Fall(6.5, "the LF knee touched the ground"), fault="no plan")
    assert fallen.outcome is WalkOutcome.FELL
    assert fallen.reasons == ("the LF knee touched the ground", "no plan")


def test_a_step_that_does_not_come_is_lost():
    trace = replace(walking(), step_time=1.0, time=np.arange(0.0, 8.21, 0.1), loaded_at=2.5)
    assert replace(trace, steps=(1.0, 2.0, 3.0, 4.1, 5.1, 6.4, 7.3)).steps_lost == 0
    assert replace(trace, steps=(1.0, 2.0, 3.0, 5.1, 6.4, 7.3)).steps_lost == 1, "a pause"
    assert replace(trace, steps=(1.0, 2.0, 3.0, 4.1, 5.1)).steps_lost == 3, "it stands at the end"
    assert replace(trace, steps=(1.0, 4.1), loaded_at=np.nan).steps_lost == 0, "no load, nothing to lose by"


def test_longest_spell():
    time = np.array([0.0, 1.0, 2.0, 4.0, 5.0])
    assert longest_spell(time, np.array([True, True, False, True, True])) == 1.0
    assert longest_spell(time, np.array([False, True, True, True, False])) == 3.0
    assert longest_spell(time, np.zeros(5, dtype=bool)) == 0.0
