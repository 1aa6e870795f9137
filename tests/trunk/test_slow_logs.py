"""Samples at other rates and times than blocks expect, and in other units."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from functools import cache

import numpy as np
import pytest

from stadera.constants import GRAVITY
from stadera.errors import RecordingError
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import load_robot
from stadera.trunk import TrunkEstimator
from stadera.trunk.samples import Samples


@cache
def made() -> Samples:
    robot = load_robot("go2")
    run = simulate(robot, "shake", SimulateSettings("standard", duration=3.0, seed=1, rate=250.0, hold=2))
    return Samples.of_recording(run.recording, robot)


@pytest.mark.parametrize("every", [3, 6])
def test_slow_logs_are_weighed(every: int) -> None:
    robot, samples = load_robot("go2"), made()
    estimator = TrunkEstimator(robot)
    estimator.add(samples[np.arange(len(samples)) % every == 0])
    assert estimator.trunk.inertial.mass == pytest.approx(robot.inertias[robot.trunk].mass, abs=0.1 * robot.mass)


def test_a_specific_force_in_g_makes_no_trunk() -> None:
    """Its mass has so wide a bar that it would count as not observed."""
    samples, estimator = made(), TrunkEstimator("go2")
    estimator.add(replace(samples, specific_force=samples.specific_force / GRAVITY))
    assert estimator.trust.verdict == "bad"
    assert "runs away: trunk mass" in estimator.refusal


@pytest.mark.parametrize("pause", [0.3, 3.0])
def test_a_pause_after_the_first_sample_is_not_its_rate(pause: float) -> None:
    samples, late, steady = made()[:500], TrunkEstimator("go2"), TrunkEstimator("go2")
    time = samples.time.copy()
    time[0] -= pause
    for estimator, each in ((late, replace(samples, time=time)), (steady, samples)):
        for measurement in each:
            estimator.update(measurement)
    assert late.trunk.mass_std == pytest.approx(steady.trunk.mass_std, rel=0.05)
    assert late.trunk.inertial.mass == pytest.approx(steady.trunk.inertial.mass, abs=0.2 * steady.trunk.mass_std)


@pytest.mark.parametrize("factor", [1e3, 1e9])
def test_a_time_that_is_not_in_seconds_is_named(factor: float) -> None:
    samples, estimator = made()[:100], TrunkEstimator("go2")
    estimator.add(replace(samples, time=factor * samples.time))
    assert "time is needed in seconds" in estimator.refusal
    assert not estimator.trunk.observed.any()


@pytest.mark.parametrize(
    ("t", "q", "said"),
    [
        (np.datetime64("2026-01-01", "ns"), 0.0, r"t in numbers \[s\]"),
        (datetime(2026, 1, 1), 0.0, r"t in numbers \[s\]"),
        (np.zeros(1), 0.0, r"t as one number \[s\], got an array of shape \(1,\)"),
        (0.0, "x", "q in numbers"),
    ],
)
def test_what_is_no_number_is_named(t: object, q: object, said: str) -> None:
    with pytest.raises(RecordingError, match=said):
        TrunkEstimator("go2").update(t, [q] * 12, np.zeros(12), np.zeros(12), np.zeros(3), np.zeros(3))  # type: ignore[arg-type]
