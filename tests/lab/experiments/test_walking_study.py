"""The study of robots in motion: what its summary says of runs, and one run."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stadera.inertia import InertialParameters
from stadera.lab.experiments.runner import ReproduceSettings
from stadera.lab.experiments.walking import (
    PLACES,
    WALKING,
    WalkingCase,
    cases,
    compared,
    normalised,
    payload_of,
    summary,
    weigh_in_motion,
)
from stadera.lab.plant.payload import Tray
from stadera.robot import load_robot


def test_the_grid_is_whole() -> None:
    grid = cases(ReproduceSettings())
    assert len(grid) == len(set(grid)) == 4 * 3 * 3 * 5 * 2 * 5
    assert {case.place for case in grid} == set(PLACES)
    assert len(cases(ReproduceSettings(quick=True))) == 2
    once = cases(ReproduceSettings(seeds=1))
    assert once == grid[: len(once)]
    assert len(once) == len(grid) // 5


@pytest.mark.parametrize("place", PLACES)
def test_loads_lie_on_the_back(place: str) -> None:
    robot = load_robot("hyq")
    body = payload_of(WalkingCase("hyq", "trot", 0.1, place, "ideal", 0), robot).parameters
    tray = Tray.of(robot)
    assert body.mass == pytest.approx(0.1 * robot.mass)
    assert (np.abs(body.com - tray.centre)[:2] < tray.half_size[:2]).all()
    assert body.com[2] > tray.top
    front, left = np.sign((body.com - tray.centre)[:2].round(9))
    assert (front, left) == (("front" in place) - ("hind" in place), ("left" in place) - ("right" in place))


def test_errors_are_differences_to_the_tare() -> None:
    bare = InertialParameters.from_com(10.0, [0.0, 0.0, 0.0], np.eye(3))
    load = InertialParameters.from_com(2.0, [0.3, -0.1, 0.2], 0.01 * np.eye(3))
    off = InertialParameters.from_com(0.5, [0.0, 0.2, 0.0], np.zeros((3, 3)))  # alike before and after
    exact = compared(bare, bare + load, bare, bare + load, "soon")
    assert exact == {key: pytest.approx(0.0, abs=1e-12) for key in exact}
    assert len(exact) == 4
    figures = compared(bare + off, bare + off + load, bare, bare + load, "soon")
    assert figures["soon.payload_mass"] == pytest.approx(0.0, abs=1e-12)
    assert figures["soon.payload_xy"] == pytest.approx(0.0, abs=1e-12)
    assert figures["soon.shift_xy"] > 1e-3


def test_errors_have_their_size() -> None:
    bare = InertialParameters.from_com(10.0, [0.0, 0.0, 0.0], np.eye(3))
    load = InertialParameters.from_com(2.0, [0.3, -0.1, 0.2], 0.01 * np.eye(3))
    found = InertialParameters.from_com(2.5, [0.33, -0.14, 0.3], 0.01 * np.eye(3))
    figures = compared(bare, bare + found, bare, bare + load, "soon")
    assert figures["soon.payload_mass"] == pytest.approx(0.5)
    assert figures["soon.payload_xy"] == pytest.approx(0.05)
    assert figures["soon.com_z"] == pytest.approx(0.75 / 12.5 - 0.4 / 12.0)
    np.testing.assert_allclose(
        figures["soon.shift_xy"], np.hypot(0.825 / 12.5 - 0.6 / 12.0, 0.35 / 12.5 - 0.2 / 12.0), rtol=1e-9
    )


def test_normalised_errors_are_those_of_what_is_observed() -> None:
    truth = InertialParameters.from_com(10.0, [0.1, 0.0, 0.0], np.eye(3))
    off = InertialParameters.from_com(10.4, [0.13, 0.0, 5.0], np.eye(3))
    found = SimpleNamespace(
        inertial=off, observed=np.array([True, True, True, False]), covariance=np.diag([0.04, 1e-4, 1.0, 1.0])
    )
    figures = normalised(SimpleNamespace(parameters=lambda: found), truth)  # type: ignore[arg-type]
    assert figures["loaded.nees"] == pytest.approx(2.0**2 + 3.0**2)
    assert figures["loaded.observed"] == 3


def outcome(error: float, **more: Any) -> dict[str, Any]:
    figures = {
        "soon.payload_mass": error,
        "soon.shift_xy": 1e-3,
        "soon.payload_xy": 2e-3,
        "late.com_z": -5e-3,
        "loaded.nees": 4.0,
        "loaded.observed": 4,
    }
    run = {"fell": None, "robot_mass": 50.0, "noticed": 0.04, "false_alarms": 0, "share_of_time": 0.1}
    return run | {"methods": {WALKING: figures, "contact": {}}} | more


def test_summary_judges_by_median_and_percentile() -> None:
    grid = [WalkingCase("hyq", "trot", 0.1, "middle", "standard", seed) for seed in range(3)]
    result = summary(grid, [outcome(0.05), outcome(-0.1), outcome(0.9, noticed=None, false_alarms=2)])
    found = {record.metric: record for record in result.records}
    assert found["payload mass, median"].value == pytest.approx(0.2)
    assert found["payload mass, median"].met
    assert found["payload mass, 95th percentile"].met is False
    assert found["trunk's CoM, z, after 3 s, 95th percentile"].value == pytest.approx(5.0)
    assert found["loads not noticed"].value == 1
    assert found["false alarms"].met is False
    assert found["NEES / n, not less"].value == pytest.approx(1.0)
    assert len(result.tables) == 3


def test_a_fallen_robot_counts_as_one() -> None:
    grid = [WalkingCase("hyq", "trot", 0.1, "middle", "harsh", seed) for seed in range(2)]
    fallen = outcome(0.0, fell="the trunk touched the ground", noticed=None)
    fallen["methods"] = {WALKING: {}}
    found = {record.metric: record for record in summary(grid, [outcome(0.3), fallen]).records}
    assert found["falls"].value == 1
    assert found["loads not noticed"].value == 0
    assert found["payload mass, median"].bound == pytest.approx(0.6)


@cache
def trotting_go2() -> dict[str, Any]:
    return weigh_in_motion(WalkingCase("go2", "trot", 0.25, "left hind", "standard", 1))


def test_a_trotting_robot_is_weighed() -> None:
    result = trotting_go2()
    figures = result["methods"][WALKING]
    assert result["fell"] is None
    assert result["noticed"] < 0.3
    assert result["false_alarms"] == 0
    assert abs(figures["soon.payload_mass"]) < 0.006 * result["robot_mass"]
    assert figures["late.com_z"] == pytest.approx(0.0, abs=0.02)


def test_the_shift_of_a_trotting_robot_is_soon_known_to_4_mm() -> None:
    assert trotting_go2()["methods"][WALKING]["soon.shift_xy"] < 4e-3
