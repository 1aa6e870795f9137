"""The supervisor against a walker that does as scripted, fed with Pinocchio's statics of the raw model file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from lab.supervise.scripted import ScriptedWalker
from stadera.errors import StaderaError
from stadera.lab.supervise.supervisor import Mode, StoppingSupervisor, Transition
from stadera.lab.supervise.weighing import WeighingSettings
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import Measurement
from standing import StandingRobot

HYQ = load_robot("hyq")
PLACE = (-0.3, 0.15, 0.2)
PERIOD = 0.02
BEFORE = 1.2  # s without a load
ROUND = [
    Mode.WALKING,
    Mode.STOPPING,
    Mode.WEIGHING_MASS,
    Mode.WEIGHING_COM,
    Mode.CONVERGED,
    Mode.WALKING,
]


@cache
def standing(load: float) -> Measurement:
    return StandingRobot(HYQ, load, PLACE).measurement(0.0, standing_configuration(HYQ))


class Day:
    """A supervisor, and the loads it meets one after the other."""

    def __init__(self, walker: ScriptedWalker | None = None, weighing: WeighingSettings | None = None) -> None:
        self.walker = walker or ScriptedWalker()
        self.supervisor = StoppingSupervisor(HYQ, self.walker, weighing=weighing)
        self.time = 0.0

    def meets(self, load: float, seconds: float) -> Day:
        return self.sees(replace(standing(load)) for _ in range(round(seconds / PERIOD)))

    def sees(self, samples: Iterable[Measurement]) -> Day:
        for m in samples:
            self.time += PERIOD
            self.supervisor.update(replace(m, time=self.time))
        return self

    @property
    def states(self) -> list[Mode]:
        return [Mode.WALKING, *(t.after for t in self.supervisor.transitions)]

    @property
    def last(self) -> Transition:
        return self.supervisor.transitions[-1]


def test_nothing_happens_while_nothing_changes():
    day = Day().meets(0.0, 6.0)
    assert day.states == [Mode.WALKING]
    assert day.walker.walking
    assert not day.walker.models


def test_a_load_put_on_is_noticed_weighed_and_walked_on_with():
    load = 3.0  # 10 kg in the next test
    day = Day().meets(0.0, BEFORE).meets(load, 5.0)
    assert day.states == ROUND
    noticed = day.supervisor.transitions[0]
    assert noticed.time < BEFORE + 0.6
    assert f"changed by +{load:.1f}" in noticed.reason
    (found,) = day.walker.models
    expected = StandingRobot(HYQ, load, PLACE)
    assert found.mass == pytest.approx(expected.trunk_mass, abs=0.02)
    assert found.com_trunk[:2] == pytest.approx(expected.trunk_com[:2], abs=1e-3)
    assert day.supervisor.trunk is found
    payload = day.supervisor.payload  # told by difference
    assert payload is not None
    assert payload.mass == pytest.approx(load, abs=0.02)
    assert payload.com[:2] == pytest.approx(PLACE[:2], abs=0.01)
    assert np.isnan(payload.com[2]), "one level pose shows no height"
    assert day.walker.walking
    assert all(a.after is b.before and a.time <= b.time for a, b in pairwise(day.supervisor.transitions))


def test_a_load_taken_off_is_noticed_too():
    day = Day().meets(0.0, BEFORE).meets(10.0, 5.0).meets(0.0, 5.0)
    assert day.states == [*ROUND, *ROUND[1:]]
    assert "changed by −10.0" in day.supervisor.transitions[5].reason
    assert day.walker.models[-1].mass == pytest.approx(HYQ.inertias[HYQ.trunk].mass, abs=0.02)


def test_a_weighing_that_does_not_converge_leaves_the_old_trunk_and_stands():
    wobbling = [replace(standing(10.0), joint_velocity=np.full(12, 0.3 * (-1) ** (k // 25))) for k in range(300)]
    day = Day(weighing=WeighingSettings(mass_within=2.0)).meets(0.0, BEFORE).meets(10.0, 0.5).sees(wobbling)
    assert day.states[-2:] == [Mode.WEIGHING_MASS, Mode.STANDING]
    assert "did not converge within 2 s" in day.last.reason
    assert "joint" in day.last.reason
    assert not day.walker.models
    assert not day.walker.walking
    assert day.supervisor.trunk.mass == HYQ.inertias[HYQ.trunk].mass
    assert day.meets(10.0, 2.0).states[-1] is Mode.STANDING, "it stays until told otherwise"
    day.supervisor.weigh("the operator asks for it")
    assert day.meets(10.0, 5.4).states[-1] is Mode.WALKING
    assert len(day.walker.models) == 1


def test_a_load_that_changes_while_it_is_weighed_begins_the_weighing_anew():
    day = Day().meets(0.0, BEFORE).meets(10.0, 1.5).meets(20.0, 5.6)
    assert Mode.CONVERGED in day.states
    assert "anew" in " ".join(t.reason for t in day.supervisor.transitions)
    assert [round(b.mass - HYQ.inertias[HYQ.trunk].mass, 1) for b in day.walker.models] == [20.0]


def test_a_load_that_keeps_changing_is_given_up():
    day = Day().meets(0.0, BEFORE)
    for k in range(12):
        if day.states[-1] is not Mode.STANDING:
            day.meets(10.0 * (k % 2 + 1), 1.0)
    assert day.states[-1] is Mode.STANDING
    assert "keeps changing" in day.last.reason
    assert not day.walker.models


def test_a_walker_that_does_not_stop_is_given_up():
    day = Day(ScriptedWalker(stops=False)).meets(0.0, BEFORE).meets(10.0, 7.0)
    assert day.states[-2:] == [Mode.STOPPING, Mode.STANDING]
    assert "does not come to stand within 5 s" in day.last.reason


def test_a_trunk_that_is_refused_is_not_half_taken():
    day = Day(ScriptedWalker(takes=False)).meets(0.0, BEFORE).meets(10.0, 5.4)
    assert day.states[-2:] == [Mode.CONVERGED, Mode.STANDING]
    assert day.supervisor.trunk.mass == HYQ.inertias[HYQ.trunk].mass


def test_a_foot_that_finds_no_ground_stops_the_walk():
    day = Day().meets(0.0, 1.0)
    day.walker.fault = "foot LH finds no ground"
    day.meets(0.0, 0.1)
    assert day.states == [Mode.WALKING, Mode.STANDING]
    assert "LH finds no ground" in day.last.reason
    assert not day.walker.walking


def test_a_load_too_heavy_for_three_legs_is_not_walked_with():
    weak = {joint: replace(limits, effort=0.5 * limits.effort) for joint, limits in HYQ.limits.items()}
    day = Day()
    day.supervisor = StoppingSupervisor(replace(HYQ, limits=weak), day.walker)
    day.meets(0.0, BEFORE).meets(10.0, 5.4)
    assert day.states[-1] is Mode.STANDING
    assert "too heavy" in day.last.reason
    assert not day.walker.models


def test_a_weighing_does_not_begin_twice():
    day = Day().meets(0.0, BEFORE).meets(10.0, 1.0)
    with pytest.raises(StaderaError, match="begins from walking or standing"):
        day.supervisor.weigh("again")
