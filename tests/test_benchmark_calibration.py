"""`benchmarks/calibration.py`: what it scales, and how it summarises."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stadera.errors import StaderaError
from stadera.trunk.settings import ModelErrors, TrunkSettings

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import calibration  # a script beside the package


def test_all_sizes_are_scaled_but_no_correlation_or_share() -> None:
    usual, scaled = vars(ModelErrors()), vars(calibration.settings(3.0).model)
    kept = {name for name, size in usual.items() if scaled[name] == size}
    assert kept == {"alike", "alike_loaded", "sagging", "renewed", "held", "surest"}
    assert {name: scaled[name] for name in usual.keys() - kept} == pytest.approx(
        {name: 3.0 * size for name, size in usual.items() if name not in kept}
    )


def test_one_setting_is_scaled_at_a_time() -> None:
    usual = TrunkSettings()
    assert calibration.settings(0.5, "speed") == replace(
        usual, swing=replace(usual.swing, speed=0.5 * usual.swing.speed)
    )
    assert calibration.settings(3.0, "size_spread") == replace(usual, size_spread=3.0 * usual.size_spread)
    drifts, sizes = vars(calibration.settings(3.0, "drifts").model), vars(usual.model)
    assert {name for name, size in sizes.items() if drifts[name] != size} == set(calibration.DRIFTS)


def test_summary_of_errors_that_are_normal() -> None:
    rng = np.random.default_rng(0)
    sigmas = rng.standard_normal((4000, 5))
    sigmas[::2, 3] = np.nan  # not observed
    runs = [{"errors": 2.0 * z, "sigmas": z, "nees": np.nanmean(z[:4] ** 2), "verdict": "good"} for z in sigmas]
    row = calibration.summary("trot", 1.0, runs)
    assert row["trunk z within 2 σ"] == pytest.approx(0.954, abs=0.02)
    assert row["payload mass rms error/σ"] == pytest.approx(1.0, abs=0.05)
    assert row["trunk mass 95 % [%]"] == pytest.approx(2.0 * 1.96, rel=0.06)
    assert row["nees/n"] == pytest.approx(1.0, abs=0.05)


def test_a_folder_without_logs_names_the_command_that_makes_them(tmp_path: Path) -> None:
    with pytest.raises(StaderaError, match="reproduce reality --keep"):
        calibration.kept_logs(tmp_path)
