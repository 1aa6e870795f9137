"""The study of robots with real errors: its grid, what its summary says of runs, and one run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stadera.lab.experiments import reality
from stadera.lab.experiments.reality import LEGS, OURS, SHARES, RealityCase, cases, summary, weigh_real
from stadera.lab.experiments.runner import ReproduceSettings
from stadera.lab.scenarios import run

CASE = RealityCase("go2", "trot", 0.10, "real-unit-gain", 0)


def outcome(error: float, std: float = 0.05, **more: Any) -> dict[str, Any]:
    """A run in which the payload's mass is off by `error` [kg] of a robot of 50 kg."""
    figures = {"payload mass": [error, std], "payload x": [3e-3, 1e-2], "payload y": [4e-3, 1e-2]}
    figures |= {"trunk mass": [0.5, 0.3], "verdict": "good", "verdict_before": "good"}  # type: ignore[dict-item]
    ours = {**figures, "noticed": 0.1, "false_changes": 0, **more}
    return {"fell": None, "robot_mass": 50.0, "methods": {OURS: ours, "ls": {"payload mass": [0.2, 0.1]}}}


def records(*outcomes: dict[str, Any], case: RealityCase = CASE) -> dict[str, float]:
    found = summary([case] * len(outcomes), outcomes).records
    return {record.metric: record.value for record in found if record.case["method"] == OURS}


def test_the_grid_is_whole() -> None:
    grid = cases(ReproduceSettings())
    assert len(grid) == len(set(grid)) == 2 * 5 * 6 * 4
    assert {case.share for case in grid} == set(SHARES)
    assert len(cases(ReproduceSettings(quick=True))) == 4
    assert len(cases(ReproduceSettings(seeds=1))) == 48


def test_errors_are_shares_of_the_robot_and_lengths() -> None:
    found = records(outcome(0.05), outcome(-0.1), outcome(0.4))
    assert found["payload mass, median"] == pytest.approx(0.2)
    assert found["payload mass, median over plain least squares'"] == pytest.approx(0.5)
    assert found["payload x-y, median"] == pytest.approx(5.0)
    light = RealityCase("go2", "trot", 0.05, "real-unit-gain", 0)
    assert "payload x-y, median" not in records(outcome(0.05), case=light)


def test_bars_count_what_is_within_two_and_beyond_four_sigmas() -> None:
    found = records(outcome(0.05), outcome(-0.09), outcome(0.15), outcome(0.3), outcome(0.3, verdict="doubtful"))
    assert found["payload mass, within 2 σ"] == pytest.approx(2 / 5)
    assert found["payload mass, beyond 4 σ with verdict good"] == 1
    assert found["verdict good"] == pytest.approx(4 / 5)
    assert "payload mass, within 2 σ" not in records(outcome(0.3, verdict="bad"))


def test_changes_that_never_were_and_loads_not_noticed() -> None:
    found = records(outcome(0.05), outcome(0.05, noticed=None, false_changes=2), outcome(0.05, noticed=0.7))
    assert found["load noticed within 0.5 s"] == pytest.approx(1 / 3)
    assert found["false changes in 10 minutes"] == pytest.approx(2 * 600 / 30)
    unloaded = RealityCase("go2", "trot", 0.0, "real-unit-gain", 0)
    assert "load noticed within 0.5 s" not in records(outcome(0.05, noticed=None), case=unloaded)


def test_the_first_change_after_the_load_is_the_loads() -> None:
    changes = tuple(SimpleNamespace(noticed=at, mass=2.0, mass_std=0.1) for at in (3.0, 5.1, 8.0))
    found = reality._changes(changes, 1.5)
    assert found["noticed"] == pytest.approx(0.1)
    assert found["false_changes"] == 2
    assert found["change mass"] == pytest.approx([0.5, 0.1])
    assert reality._changes(changes, 0.0) == {"noticed": None, "false_changes": 3}


def test_a_fall_is_counted_and_weighs_nothing() -> None:
    fell = {"fell": "tilted by more than 45°", "robot_mass": 50.0, "methods": {}}
    result = summary([CASE, CASE], [fell, outcome(0.05)])
    assert (result.facts["Runs"], result.facts["Falls"]) == ("2", "1")
    assert [table.groups[0][0] for table in result.tables] == ["trot, mean torque gain one", "mean torque gain one"]


def test_a_run_is_weighed_from_its_log_by_every_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reality, "HOW", replace(reality.HOW, loaded_at=1.5, duration=3.0))
    monkeypatch.setattr(run, "DEFAULTS", replace(run.DEFAULTS, swing=10.0))
    first = weigh_real(RealityCase("go2", "shake", 0.10, "real-unit-gain", 0), tmp_path)
    assert first["fell"] is None
    assert set(first["methods"]) == {OURS, LEGS, "ls", "rls", "kalman"}
    for figures in first["methods"].values():
        error, std = figures["trunk mass"]
        assert abs(error) < 0.3 * first["robot_mass"]
        assert std > 0
    assert len(list(tmp_path.iterdir())) == 3
    again = weigh_real(RealityCase("go2", "shake", 0.10, "real-unit-gain", 0), tmp_path)
    for name, figures in first["methods"].items():
        for key, value in figures.items():
            if isinstance(value, list):
                np.testing.assert_allclose(again["methods"][name][key], value, rtol=1e-9, err_msg=key)
