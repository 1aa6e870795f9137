"""A torque's lag is found where there is one, and not where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from identify.leg_runs import DRIVE, cut, exact_run, hyq, leg_regressor, noisy, run
from stadera.identify.lag import estimate_lag
from stadera.identify.settings import LagSettings
from stadera.logs import Preprocessing, Recording, preprocess_stream

UP = np.array([0.0, 0.0, 1.0])


def late(recording: Recording, delay: float) -> Recording:
    """The same log with efforts that act `delay` later than their stamps say: written down that much too early."""
    effort = CubicSpline(recording.time, recording.effort)(recording.time + delay)
    return replace(recording, effort=effort)


def found(recording: Recording, cutoff: float | None = 25.0, search: LagSettings | None = None) -> float:
    settings = Preprocessing(cutoff)
    stretches = list(preprocess_stream([recording], settings, recording.joints))
    return estimate_lag(stretches, [leg_regressor(hyq(), friction=True)], UP, search)[0]


@pytest.mark.parametrize("rate", [200.0, 1000.0])
@pytest.mark.parametrize("delay", [0.0075, 0.0063, 0.021, -0.004])
def test_lag_is_recovered(rate: float, delay: float) -> None:
    recording = run(DRIVE, duration=10.0, rate=rate)
    assert found(late(recording, delay)) == pytest.approx(delay, abs=5e-4)


@pytest.mark.parametrize("rate", [200.0, 1000.0])
def test_no_lag_is_exactly_zero(rate: float) -> None:
    assert found(run(DRIVE, duration=10.0, rate=rate)) == 0.0


def test_no_lag_is_exactly_zero_without_a_filter_or_noise() -> None:
    assert found(exact_run(), cutoff=None) == 0.0


@pytest.mark.parametrize("delay", [0.0, 0.010])
def test_lag_under_noise(delay: float) -> None:
    recording = noisy(late(run(DRIVE), delay), effort=0.3, position=1e-4)
    assert found(recording) == pytest.approx(delay, abs=1e-3)


def test_a_lag_is_looked_for_as_far_as_asked_and_taken_where_it_is_large_enough() -> None:
    recording = late(run(DRIVE, duration=10.0, rate=200.0), 0.021)
    assert found(recording, search=LagSettings(latest=0.01)) == pytest.approx(0.01)
    assert found(recording, search=LagSettings(resolution=0.03)) == 0.0


def test_a_lag_worth_nothing_is_none() -> None:
    """Where noise hides it, a lag is not made up."""
    assert found(noisy(run(DRIVE), effort=50.0)) == 0.0


@pytest.mark.parametrize("samples", [9, 30])
def test_a_log_too_short_to_tell_has_none(samples: int) -> None:
    recording = cut(run(DRIVE), 1000, 1000 + samples)
    assert np.ptp(recording.time) < 3 * LagSettings().latest
    assert found(recording, cutoff=None) == 0.0
    assert estimate_lag([], [leg_regressor(hyq(), friction=True)], UP)[0] == 0.0
