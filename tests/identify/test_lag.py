"""A torque's lag is found where there is one, and not where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from identify.leg_runs import DRIVE, cut, exact_run, hyq, leg_regressor, noisy, run
from stadera.body import JointTorqueRegressor
from stadera.identify.lag import estimate_lag
from stadera.identify.legs import identify
from stadera.identify.prior import Prior, robot_prior
from stadera.identify.settings import IdentifySettings, LagSettings, SignalSettings
from stadera.logs import Preprocessing, Recording, preprocess_stream

UP = np.array([0.0, 0.0, 1.0])


def late(recording: Recording, delay: float) -> Recording:
    """The same log with efforts that act `delay` later than their stamps say: written down that much too early."""
    effort = CubicSpline(recording.time, recording.effort)(recording.time + delay)
    return replace(recording, effort=effort)


def leg() -> tuple[JointTorqueRegressor, Prior]:
    regressor = leg_regressor(hyq(), friction=True)
    return regressor, robot_prior(hyq(), regressor.columns)


def estimated(
    recording: Recording, cutoff: float | None = 25.0, search: LagSettings | None = None
) -> tuple[float, float, float]:
    stretches = list(preprocess_stream([recording], Preprocessing(cutoff), recording.joints))
    return estimate_lag(stretches, [leg()], UP, search)


def found(recording: Recording, cutoff: float | None = 25.0, search: LagSettings | None = None) -> float:
    return estimated(recording, cutoff, search)[0]


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
    assert estimated(recording, search=LagSettings(latest=0.01))[1] == LagSettings().usual
    assert found(recording, search=LagSettings(resolution=0.03)) == 0.0


def test_a_lag_worth_nothing_is_none() -> None:
    """Where noise hides it, a lag is not made up."""
    assert found(noisy(run(DRIVE), effort=50.0)) == 0.0


def test_a_lag_that_is_not_significant_is_none_and_in_the_deviation() -> None:
    """As if the truth were as far from zero as the estimate."""
    log = noisy(late(run(DRIVE, duration=4.0), 0.003), effort=1.0, position=1e-4, seed=1)
    lag, std, ratio = estimated(log, search=LagSettings(significant=1e-9))
    assert LagSettings().resolution < abs(lag) < LagSettings().significant * std
    assert std < LagSettings().usual
    assert ratio < 1.0
    assert estimated(log) == (0.0, pytest.approx(np.hypot(std, lag)), 1.0)


@pytest.mark.parametrize("cutoff", [6.0, 12.0])
def test_a_reversal_that_the_filter_moves_is_no_lag(cutoff: float) -> None:
    """Friction makes the velocity's slope steeper before a reversal than after; a filter that averages them is late."""
    log = late(run(replace(DRIVE, coulomb=2.0), duration=10.0), -0.005)
    assert found(log, cutoff) == pytest.approx(-0.005, abs=5e-4)


def test_noise_of_the_encoders_does_not_pull_the_lag() -> None:
    """That of q̈ makes a smaller inertia look better, and a lag turns viscous friction into one."""
    logs = [noisy(late(run(DRIVE, duration=8.0), -0.005), effort=0.3, position=5e-4, seed=seed) for seed in range(4)]
    lags = [identify(hyq(), log, IdentifySettings(legs=("RH",), split=1.0)).torque_lag for log in logs]
    assert np.mean(lags) == pytest.approx(-0.005, abs=1e-3)


@pytest.mark.parametrize("samples", [9, 30])
def test_a_log_too_short_to_tell_has_none(samples: int) -> None:
    recording = cut(run(DRIVE), 1000, 1000 + samples)
    assert np.ptp(recording.time) < 3 * LagSettings().latest
    assert found(recording, cutoff=None) == 0.0
    assert estimate_lag([], [leg()], UP)[0] == 0.0


@pytest.mark.parametrize(("seed", "effort"), [(0, 1.0), (0, 2.0), (4, 0.5), (4, 2.0)])
def test_a_few_seconds_of_noisy_torques_tell_no_lag(seed: int, effort: float) -> None:
    """A hip has 27 columns, which without their prior explain what a wrong lag leaves."""
    recording = noisy(run(DRIVE, duration=3.0, rate=200.0, seed=seed), effort, position=3e-4, seed=seed)
    assert found(recording) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_the_lags_bar_holds_where_friction_is_not_the_models(seed: int) -> None:
    """Friction that varies with position by a third moves each joint's minimum by milliseconds; noise does not."""
    recording = run(DRIVE, duration=10.0, rate=200.0, seed=seed)
    rate = np.gradient(recording.position, recording.time, axis=0)
    more = 0.4 * np.sin(3.0 * recording.position + np.arange(3)) * np.tanh(rate / 0.02)
    log = noisy(late(replace(recording, effort=recording.effort + more), 0.004), 0.2, position=1e-4)
    lag, std, _ = estimated(log)
    assert abs(lag - 0.004) < 3.0 * std
    assert std < LagSettings().usual


def test_bars_hold_with_torques_of_another_scale_and_a_lag_too_small_to_be_taken() -> None:
    """Neither shows in a log: 5 % of all torques, and 2 ms below a resolution of 3."""
    ignored = SignalSettings(lag=LagSettings(resolution=0.003))
    settings = IdentifySettings(legs=("RH",), signals=ignored, varying=None)
    log = late(run(DRIVE), 0.002)
    result = identify(hyq(), noisy(replace(log, effort=1.05 * log.effort), 0.1), settings)
    assert result.torque_lag == 0.0
    for joint in hyq().leg("RH").joints:
        for term, truth in (("viscous", DRIVE.viscous), ("coulomb", DRIVE.coulomb)):
            found = result.legs[0].parameters[f"{joint}.{term}"]
            assert found.std is not None
            assert abs(found.value - truth) < 2.5 * found.std
            assert found.std < 0.3 * truth
