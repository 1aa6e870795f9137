"""The study of false alarms: its grid, what its summary says of runs, and short runs."""

from __future__ import annotations

from typing import Any

import pytest
from scipy.stats import poisson

from stadera.lab.experiments.alarms import ROBOTS, SCENARIOS, SEEDS, AlarmCase, cases, highest_rate, summary, watch
from stadera.lab.experiments.runner import ReproduceSettings


def test_the_grid_watches_for_long_enough() -> None:
    grid = cases(ReproduceSettings())
    assert len(grid) == len(set(grid)) == len(ROBOTS) * len(SCENARIOS) * sum(SEEDS.values())
    watched = {errors: sum(c.seconds for c in grid if c.errors == errors) / 60.0 for errors in SEEDS}
    assert watched["standard"] >= 30.0
    assert {c.seed for c in cases(ReproduceSettings(seed=7))} == {7 + k for k in range(max(SEEDS.values()))}
    assert {c.scenario for c in cases(ReproduceSettings(quick=True))} == set(SCENARIOS)


@pytest.mark.parametrize(("alarms", "minutes"), [(0, 60.0), (0, 30.0), (3, 60.0)])
def test_the_rate_s_bound_is_exact(alarms: int, minutes: float) -> None:
    rate = highest_rate(alarms, minutes)
    assert poisson.cdf(alarms, rate * minutes / 60.0) == pytest.approx(0.05)


def test_no_alarm_in_an_hour_leaves_three_an_hour_possible() -> None:
    assert highest_rate(0, 60.0) == pytest.approx(3.0, abs=0.01)


def outcome(*alarms: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"fell": None, "seconds": 60.0, "alarms": list(alarms)} | more


def test_summary_counts() -> None:
    alarm = {"time": 12.3, "noticed": 12.4, "mass": -0.02}
    grid = [AlarmCase("hyq", scenario, errors, 0) for errors in SEEDS for scenario in ("errands", "crawl")]
    fallen = outcome(seconds=6.0, fell="the trunk touched the ground")
    result = summary(grid, [outcome(), fallen, outcome(alarm, alarm), outcome()])
    found = {(r.case["errors"], r.case["motion"], r.metric): r for r in result.records}
    assert found["standard", "all", "false alarms"].value == 0
    assert found["standard", "all", "false alarms"].met
    assert found["standard", "all", "falls"].value == 1
    assert found["standard", "all", "false alarms"].case["watched [min]"] == pytest.approx(1.1)
    assert found["harsh", "errands", "false alarms"].value == 2
    assert found["harsh", "errands", "false alarms"].met is None
    (counts,) = result.tables
    assert [row[0].text for row in counts.groups[0][1]] == ["all", "errands", "crawl"]
    assert counts.groups[1][1][0][1].text == "2"
    assert counts.groups[0][1][0][2].text == f"{highest_rate(0, 1.1):.0f}"


def test_an_alarm_with_standard_errors_misses_the_bound() -> None:
    alarm = {"time": 1.0, "noticed": 1.1, "mass": 0.05}
    result = summary([AlarmCase("go2", "errands", "standard", 0)], [outcome(alarm)])
    assert {r.metric for r in result.missed} == {"false alarms"}


def test_a_short_run() -> None:
    found = watch(AlarmCase("go2", "errands", "standard", 0, 4.0))
    assert found == {"fell": None, "seconds": pytest.approx(4.0, abs=0.01), "alarms": []}
