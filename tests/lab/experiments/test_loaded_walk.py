"""Table V: what is made of its runs. The runs themselves: `tests/demo`, `tests/supervise`."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.lab.experiments import ReproduceSettings, table5
from stadera.lab.experiments.loaded_walk import (
    CORNERS,
    LoadedWalk,
    LoadedWalkCase,
    WalkOutcome,
    box_at,
    corner_of,
    weight_at,
)
from stadera.lab.experiments.runner import ExperimentResult
from stadera.lab.plant.payload import Tray
from stadera.robot import load_robot

HYQ = load_robot("hyq")


def value(result: ExperimentResult, metric: str, **case: object) -> float:
    (record,) = [
        r for r in result.records if r.metric.startswith(metric) and all(r.case[k] == v for k, v in case.items())
    ]
    return record.value


@pytest.mark.parametrize("corner", CORNERS)
def test_loads_lie_on_their_corner(corner: str):
    tray, (sx, sy) = Tray.of(HYQ), CORNERS[corner]
    x, y, z = corner_of(HYQ, corner)
    assert (x - tray.centre[0]) * sx == pytest.approx(tray.half_size[0])
    assert (y - tray.centre[1]) * sy == pytest.approx(tray.half_size[1])
    box = box_at(HYQ, corner, 10.0, (0.1, 0.2, 0.1))
    assert np.abs(np.subtract(box.position, [x, y])) == pytest.approx([0.05, 0.1])
    weight = weight_at(HYQ, corner, 98.1).parameters
    assert weight.mass == pytest.approx(10.0)
    assert weight.com == pytest.approx([x, y, z + 0.05])


def test_the_load_comes_when_it_should():
    payload = weight_at(HYQ, "LH", 50.0)
    outcome = LoadedWalk(LoadedWalkCase(payload=payload, load_at=0.3, seconds=1.6, supervisor=None)).run()
    assert outcome.trace.loaded_at == pytest.approx(0.3)
    assert np.isfinite(outcome.trace.least_margin)
    assert outcome.truth.mass - outcome.bare.mass == pytest.approx(50.0 / 9.81)
    assert outcome.trace.fall is None
    assert (outcome.trace.height > 0.5).all()


def test_a_controller_that_gives_up_leaves_the_drives_braking_until_the_robot_lies():
    walk = LoadedWalk(LoadedWalkCase(seconds=3.0, supervisor=None))
    walk.give_up("no plan")
    outcome = walk.run()
    assert outcome.trace.outcome is WalkOutcome.FELL
    assert outcome.trace.reasons[-1] == "no plan"
    assert 0.1 < outcome.trace.time[-1] < 3.0


def test_table5_holds_c_against_the_truth():
    cases = table5.cases(ReproduceSettings())
    outcomes = [
        {
            "contact": [0.003 * c.seed, 0.0],
            "contact_as_measured": [0.0, 0.01],
            "poses": [0.0, 0.001],
            "truth": [0.0, 0.0],
            "mass": 61.0 + c.load / 9.81,
            "true_mass": 61.5 + c.load / 9.81,
        }
        for c in cases
    ]
    result = table5.summary(cases, outcomes)
    for load in (0.0, 50.0, 100.0):
        case = {"load [N]": load}
        assert value(result, "(c) to the truth, ‖δ‖, median", **case) == pytest.approx(0.6)
        assert value(result, "(c) to the truth, ‖δ‖, largest", **case) == pytest.approx(1.2)
        assert value(result, "(c) on torques as measured to the truth, ‖δ‖, median", **case) == pytest.approx(1.0)
        assert value(result, "mass", **case) == pytest.approx(0.5)
    assert len(result.missed) == 6, "no seed is picked to meet the bound"
    papers = [r.paper for r in result.records if r.metric.startswith("(c) to (a)")]
    assert papers == [0.45, 0.20, 0.32]
