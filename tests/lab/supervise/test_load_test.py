"""The test of the load: its false-alarm rate, its power, what it remembers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from stadera.errors import StaderaError
from stadera.lab.supervise import LoadCheck, LoadTest, LoadTestSettings, RestMoment
from stadera.trunk import ForceNoise

ROBOT_MASS, TRUNK_MASS = 87.0, 61.0
NOISE = ForceNoise(np.full((4, 3), 0.5), np.full((4, 3), 0.5))
CYCLE = 4  # poses that a walk comes back to


class Walk:
    """Moments drawn from the model that the test states: one draw of offsets a run, poses that come again."""

    def __init__(self, seed: int, settings: LoadTestSettings) -> None:
        self.rng, self.settings = np.random.default_rng(seed), settings
        self.mass = TRUNK_MASS + settings.prior * ROBOT_MASS * self.rng.standard_normal()
        self.offsets = 0.5 * self.rng.standard_normal(12)
        self.felt = self.rng.normal(0.0, 0.3, (CYCLE, 12))
        self.test = LoadTest(ROBOT_MASS, TRUNK_MASS, NOISE, settings)
        self.at = 0

    def moment(self, change: float = 0.0) -> RestMoment:
        self.at += 1
        felt, variance = self.felt[self.at % CYCLE] + self.rng.normal(0.0, 0.02, 12), 0.05**2
        std = np.hypot(0.05, self.settings.unexplained * ROBOT_MASS)
        mass = self.mass + change + felt @ self.offsets + std * self.rng.standard_normal()
        return RestMoment(self.at - 0.1, float(self.at), float(mass), variance, felt)

    def check(self, change: float = 0.0) -> LoadCheck:
        check = self.test.check(self.moment(change))
        assert check is not None
        if check.changed and change == 0.0:
            self.test.forget_mass()  # as whoever has weighed
        return check


def settings_of(alpha: float) -> LoadTestSettings:
    return LoadTestSettings(false_alarms=alpha * 3600.0 / 0.1)


def test_false_alarms_come_at_the_stated_rate():
    alpha, runs, checks = 0.01, 150, 40
    walks = [Walk(seed, settings_of(alpha)) for seed in range(runs)]
    alarms = sum(walk.check().changed for walk in walks for _ in range(checks))
    assert binom.ppf(1e-4, runs * checks, alpha) <= alarms <= binom.ppf(1 - 1e-4, runs * checks, alpha)


def test_false_alarms_are_independent_of_one_another_within_a_run():
    """No run is worse than others: the offsets of an unlucky one are learnt, not met again and again."""
    alpha, runs, checks = 0.05, 120, 60
    counts, products = [], []
    for seed in range(runs):
        walk = Walk(1000 + seed, settings_of(alpha))
        scaled = np.array([check.change / check.std for check in (walk.check() for _ in range(checks))])
        counts.append(np.sum(np.abs(scaled) > walk.settings.deviations))
        products.append(np.mean(scaled[1:] * scaled[:-1]))
    assert abs(np.mean(products)) < 4.0 / np.sqrt(runs * checks) + 0.01
    expected = checks * alpha * (1 - alpha)
    assert 0.5 * expected < np.var(counts) < 2.0 * expected


def test_a_change_is_missed_as_often_as_it_says():
    settings, missed, found = settings_of(1e-4), 0.1, []
    for seed in range(600):
        walk = Walk(5000 + seed, settings)
        for _ in range(8):
            walk.check()
        smallest = walk.test.detectable(walk.moment(), missed)
        found.append(walk.check(smallest * (-1) ** seed).changed)
    low, high = binom.ppf([1e-4, 1 - 1e-4], len(found), 1 - missed)
    assert low <= sum(found) <= high


def test_offsets_survive_a_change_of_the_load():
    walk = Walk(3, LoadTestSettings())
    for _ in range(40):
        walk.check()
    before, sure = walk.test.offsets, walk.test.mass_std
    assert walk.check(10.0).changed
    walk.test.forget_mass()
    assert walk.test.mass_std > 10.0
    for _ in range(10):
        assert not walk.check(10.0).changed
    assert walk.test.mass == pytest.approx(walk.mass + 10.0, abs=4 * 0.35)
    assert np.abs(walk.test.offsets - before).max() < 0.4
    assert walk.test.mass_std < 2 * sure + 0.3
    assert walk.check(0.0).changed, "taken off again"


def test_checks_keep_their_interval():
    test = LoadTest(ROBOT_MASS, TRUNK_MASS, NOISE, LoadTestSettings(interval=0.5))
    felt = np.zeros(12)
    assert test.check(RestMoment(0.0, 0.1, TRUNK_MASS, 0.01, felt)) is not None
    assert test.check(RestMoment(0.2, 0.3, TRUNK_MASS + 50.0, 0.01, felt)) is None
    late = test.check(RestMoment(0.6, 0.7, TRUNK_MASS + 50.0, 0.01, felt))
    assert late is not None
    assert late.changed


def test_threshold_follows_from_the_rate():
    settings = LoadTestSettings(false_alarms=1.0, interval=0.2)
    assert settings.alpha == pytest.approx(1.0 / 18000)
    assert settings.deviations == pytest.approx(4.03, abs=0.01)  # two-sided normal quantile, from tables


@pytest.mark.parametrize("bad", [{"false_alarms": 0.0}, {"interval": -1.0}, {"unexplained": np.nan}, {"prior": 0.0}])
def test_settings_that_make_no_sense(bad: dict[str, float]):
    with pytest.raises(StaderaError, match=next(iter(bad))):
        LoadTestSettings(**bad)


def test_a_false_alarm_in_every_check_is_refused():
    with pytest.raises(StaderaError, match="false alarms an hour"):
        LoadTestSettings(false_alarms=36000.0)
