"""The supervisor that does not stop, fed with Pinocchio's statics: what it hands on, and what makes it give up."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lab.supervise.scripted import ScriptedWalker
from stadera.lab.supervise.supervisor import Mode, NonstopSupervisor
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import Measurement, TrunkModel
from stadera.trunk.protocol import Status, TrunkEstimate
from standing import StandingRobot

HYQ = load_robot("hyq")
PLACE = (-0.2, 0.1, 0.2)
PERIOD = 0.004


@cache
def under(load: float) -> Measurement:
    return StandingRobot(HYQ, load, PLACE).measurement(0.0, standing_configuration(HYQ))


class Day:
    """A supervisor, and the loads it meets one after the other."""

    def __init__(self, walker: ScriptedWalker | None = None) -> None:
        self.walker, self.time = walker or ScriptedWalker(), 0.0
        self.supervisor = NonstopSupervisor(HYQ, self.walker)

    def go_on(self, load: float, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD)):
            self.time += PERIOD
            self.supervisor.update(replace(under(load), time=self.time))


@pytest.fixture(scope="module")
def day() -> Day:
    day = Day()
    day.go_on(0.0, 3.0)
    day.go_on(8.0, 1.0)
    return day


def test_a_load_is_taken_over_and_nobody_is_asked_to_stop(day: Day) -> None:
    assert [t.after for t in day.supervisor.transitions] == [Mode.WEIGHING, Mode.WALKING]
    assert day.supervisor.state is Mode.WALKING
    assert day.walker.walking
    (noticed,) = day.supervisor.noticed
    assert 3.0 < noticed < 3.4
    truth = StandingRobot(HYQ, 8.0, PLACE)
    believed = day.walker.models[-1]
    assert day.supervisor.trunk is believed
    assert believed.mass == pytest.approx(truth.trunk_mass, abs=0.1)
    assert believed.com_trunk[:2] == pytest.approx(truth.trunk_com[:2], abs=2e-3)


def test_what_is_not_known_well_enough_is_not_handed_on(day: Day) -> None:
    weighing, walking = day.supervisor.transitions
    assert weighing.time <= walking.time
    prior, loaded = TrunkModel.prior(HYQ).mass, TrunkModel.prior(HYQ).mass + 8.0
    masses = np.array([trunk.mass for trunk in day.walker.models])
    assert (np.minimum(abs(masses - prior), abs(masses - loaded)) < 1.0).all(), (
        "nothing on the way from one to the other"
    )


@pytest.mark.parametrize(
    ("mass", "std", "x", "reason", "accurate"),
    [
        (70.0, 0.1, 0.0, "", True),
        (75.0, 12.0, 0.0, "", False),
        (70.0, np.nan, 0.0, "", False),
        (70.0, 0.1, 2.0, "", False),
        (1e3, 0.1, 0.0, "", False),
        (70.0, 0.1, 0.0, "a foot slips", False),
    ],
)
def test_wide_and_implausible_estimates_are_not_accurate(
    mass: float, std: float, x: float, reason: str, accurate: bool
) -> None:
    trunk = TrunkModel(mass, TrunkModel.prior(HYQ).com_trunk + np.array([x, 0.0, 0.0]))
    status = Status.REFUSED if reason else Status.MOVING
    found = TrunkEstimate(1.0, trunk, np.diag([std, 1e-3, 1e-3, 1e-3]) ** 2, status, reason)
    assert NonstopSupervisor(HYQ, ScriptedWalker()).is_accurate(found) is accurate


def test_the_payload_is_the_difference_to_the_tare(day: Day) -> None:
    payload = day.supervisor.payload
    assert payload is not None
    assert payload.mass == pytest.approx(8.0, abs=0.05)
    assert payload.parameters is not None
    assert payload.parameters.com[:2] == pytest.approx(PLACE[:2], abs=0.005)
    assert np.isnan(payload.com[2]), "a level robot at rest does not show heights"
    assert np.isnan(payload.com_covariance[2]).all()
    assert NonstopSupervisor(HYQ, ScriptedWalker()).payload is None


def test_a_walker_that_cannot_walk_on_is_left_standing() -> None:
    day = Day()
    day.go_on(0.0, 0.3)
    day.walker.fault = "LH found no ground"
    day.go_on(0.0, 0.1)
    assert day.supervisor.state is Mode.STANDING
    assert day.supervisor.transitions[-1].reason == "LH found no ground"
    assert not day.walker.walking
    day.go_on(8.0, 0.3)
    assert len(day.supervisor.transitions) == 1


def test_a_load_too_heavy_to_walk_with_is_refused() -> None:
    day = Day()
    day.go_on(0.0, 3.0)
    day.go_on(90.0, 0.6)
    assert day.supervisor.state is Mode.STANDING
    assert "too heavy" in day.supervisor.transitions[-1].reason
    assert not day.walker.walking


def test_it_comes_to_stand_once_even_if_the_walker_gives_up_as_well() -> None:
    class GivesUp(ScriptedWalker):
        def request_stop(self) -> None:
            super().request_stop()
            self.fault = "fell while stopping"

    day = Day(GivesUp())
    day.go_on(0.0, 3.0)
    day.go_on(90.0, 0.6)
    weighing, standing = day.supervisor.transitions
    assert (weighing.after, standing.after) == (Mode.WEIGHING, Mode.STANDING)
    assert "too heavy" in standing.reason
