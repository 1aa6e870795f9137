"""The study of false alarms: what its summary says of runs, the schedules, and short runs."""

from __future__ import annotations

from itertools import takewhile
from typing import Any

import numpy as np
import pytest
from scipy.stats import poisson

from stadera.lab.experiments.alarms import (
    DOING,
    GAITS,
    ROBOTS,
    SEEDS,
    Activity,
    AlarmCase,
    Gait,
    cases,
    highest_rate,
    schedule,
    summary,
    watch,
)
from stadera.lab.experiments.runner import ReproduceSettings


def stages(gait: Gait, seed: int, seconds: float) -> list[Activity]:
    """The commands of so many seconds."""
    left = [seconds]

    def fits(stage: Activity) -> bool:
        left[0] -= stage.seconds
        return left[0] > 0

    return list(takewhile(fits, schedule(gait, np.random.default_rng(seed))))


def test_the_grid_watches_for_long_enough() -> None:
    grid = cases(ReproduceSettings())
    assert len(grid) == len(set(grid)) == len(ROBOTS) * len(GAITS) * sum(SEEDS.values())
    watched = {errors: sum(c.seconds for c in grid if c.errors == errors) / 60.0 for errors in SEEDS}
    assert watched["standard"] >= 30.0
    assert {c.seed for c in cases(ReproduceSettings(seed=7))} == {7 + k for k in range(max(SEEDS.values()))}
    assert {c.gait for c in cases(ReproduceSettings(quick=True))} == set(GAITS)


@pytest.mark.parametrize("gait", GAITS)
def test_schedules_do_everything(gait: Gait) -> None:
    drawn = [stage for seed in range(5) for stage in stages(gait, seed, 60.0)]
    expected = {"crawl": set(DOING) - {"shaking"}, "trot": set(DOING), "shake": {"standing", "shaking", "stop"}}
    assert {stage.doing for stage in drawn} == expected[gait]
    assert all(0 <= stage.ahead <= 1 and -1 <= stage.turn <= 1 and stage.seconds > 0 for stage in drawn)
    assert max(stage.ahead for stage in drawn) > 0.9 or gait == "shake"
    turns = {np.sign(stage.turn) for stage in drawn if stage.doing == "turning"}
    assert turns == (set() if gait == "shake" else {-1.0, 1.0})
    assert stages(gait, 0, 10.0) == stages(gait, 0, 60.0)[: len(stages(gait, 0, 10.0))]


@pytest.mark.parametrize(("alarms", "minutes"), [(0, 60.0), (0, 30.0), (3, 60.0)])
def test_the_rate_s_bound_is_exact(alarms: int, minutes: float) -> None:
    rate = highest_rate(alarms, minutes)
    assert poisson.cdf(alarms, rate * minutes / 60.0) == pytest.approx(0.05)


def test_no_alarm_in_an_hour_leaves_three_an_hour_possible() -> None:
    assert highest_rate(0, 60.0) == pytest.approx(3.0, abs=0.01)


def outcome(*alarms: dict[str, Any], **more: Any) -> dict[str, Any]:
    seconds = {"standing": 10.0, "steady": 40.0, "stop": 10.0}
    return {"fell": None, "seconds": seconds, "stepped": 48.0, "alarms": list(alarms), "halts": []} | more


def test_summary_counts() -> None:
    alarm = {"time": 12.3, "noticed": 12.4, "doing": "stop", "mass": -0.02}
    grid = [AlarmCase("hyq", gait, errors, 0) for errors in SEEDS for gait in ("trot", "crawl")]
    fallen = outcome(seconds={"standing": 1.0, "start": 5.0}, stepped=5.0, fell="the trunk touched the ground")
    halted = outcome(halts=[{"time": 3.0, "reason": "the centre of mass does not get over the triangle"}])
    result = summary(grid, [outcome(), fallen, outcome(alarm, alarm), halted])
    found = {(r.case["errors"], r.case["gait"], r.metric): r for r in result.records}
    assert found["standard", "all", "false alarms"].value == 0
    assert found["standard", "all", "false alarms"].met
    assert found["standard", "all", "falls"].value == 1
    assert found["standard", "all", "time in which feet stepped"].value == pytest.approx(53.0 / 60.0)
    assert found["standard", "all", "false alarms"].case["watched [min]"] == pytest.approx(1.1)
    assert found["harsh", "trot", "false alarms"].value == 2
    assert found["harsh", "trot", "false alarms"].met is None
    assert found["harsh", "crawl", "crawls that stopped by themselves"].value == 1
    by_robot, by_doing, each = result.tables
    assert [row[0].text for row in by_robot.groups[0][1]] == ["hyq", "all"]
    assert by_robot.groups[1][1][0][1].text == "2 in 1.0 min"
    assert by_robot.groups[0][1][1][5].text == f"{highest_rate(0, 1.1):.1f}"
    assert {row[0].text: row[2].text for row in by_doing.groups[1][1]}["stop"] == "2"
    assert [row[1].text for row in each.groups[0][1]] == ["12.30", "12.30"]


def test_an_alarm_with_standard_errors_misses_the_bound() -> None:
    alarm = {"time": 1.0, "noticed": 1.1, "doing": "start", "mass": 0.05}
    result = summary([AlarmCase("go2", "trot", "standard", 0)], [outcome(alarm)])
    assert {r.metric for r in result.missed} == {"false alarms"}


@pytest.mark.parametrize(("gait", "seconds"), [("trot", 3.0), ("crawl", 3.5), ("shake", 3.0)])
def test_a_short_run(gait: Gait, seconds: float) -> None:
    found = watch(AlarmCase("go2", gait, "standard", 0, seconds))
    assert found["fell"] is None
    assert found["alarms"] == []
    assert found["halts"] == []
    assert sum(found["seconds"].values()) == pytest.approx(seconds)
    assert (found["stepped"] > 0.5) is (gait != "shake")
    assert found["seconds"]["standing"] < seconds
