"""What the detector's bars, and the tare's, are made of, from both sides."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm, t

from layout import LAYOUT
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import load_robot
from stadera.trunk.changes import ChangeDetector, Deviations, Spread, Usual
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.samples import Samples
from stadera.trunk.settings import ChangeSettings

SETTINGS = ChangeSettings()
SCALE = np.array([50.0, 30.0, 30.0, 30.0])
BLOCK = 0.02
NONE = np.zeros((len(SETTINGS.windows), 4))


def detector(samples: float = 1e6, blocks: int = 10**9) -> ChangeDetector:
    """One whose averages had a standard deviation of 0.01, seen in so many of them over so many blocks."""
    made, windows = ChangeDetector(SETTINGS, SCALE, BLOCK, LAYOUT), len(SETTINGS.windows)
    made._spreads = Spread(np.full((windows, 4), 1e-4), np.zeros((windows, 4)), np.full(windows, samples))
    made._past = Usual(blocks, np.ones(4), np.zeros(4), np.ones(4))
    return made


def deviation(size: float, before: float = 0.0) -> Deviations:
    """Of the average over the second of the windows, in mass alone."""
    sizes = np.zeros((len(SETTINGS.windows), 4))
    sizes[1, 0] = size
    return Deviations(sizes, 0.0 * sizes, np.full(4, before))


def test_a_spread_of_few_averages_is_students() -> None:
    limit = SETTINGS.deviations
    for samples in (3, 10):
        ratio = detector(samples - SETTINGS.prior_averages)._largest(deviation(0.1), NONE).ratio
        assert ratio == pytest.approx(10.0 * limit / t.ppf(norm.cdf(limit), samples), rel=1e-6)
    assert detector()._largest(deviation(0.1), NONE).ratio == pytest.approx(10.0, rel=1e-3)


def test_the_earlier_estimate_has_a_spread_of_its_own() -> None:
    n = SETTINGS.windows[1]
    for blocks, share in ((n, 1.0), (4 * n, 0.25)):
        found = detector(blocks=blocks)._largest(deviation(0.1), NONE)
        assert found.variance[0] == pytest.approx(1e-4 * (1.0 + share))
    found = detector()._largest(deviation(0.1, before=6e-4), NONE)
    assert found.variance[0] == pytest.approx(1e-4 + 6e-4)


def loaded_walk() -> tuple[TrunkEstimator, Samples]:
    robot = load_robot("hyq")
    load = Load(8.0, "kg", (0.0, 0.0, 0.15))
    settings = SimulateSettings("standard", load, duration=5.0, seed=4, load_time=3.0, hold=2)
    return TrunkEstimator(robot), Samples.of_recording(simulate(robot, "trot-load", settings).recording, robot)


def test_a_tare_leaves_out_its_blocks_and_bars_say_what_errors_do() -> None:
    estimator, samples = loaded_walk()
    before = samples.time < 2.5
    estimator.add(samples[before])
    estimator.tare()
    step = round(BLOCK / float(np.median(np.diff(samples.time))))
    rest, blocks = samples[~before], 0
    while (
        estimator.payload is not None
        and estimator._history.loaded is not None
        and estimator._history.loaded.blocks == 0
    ):
        estimator.add(rest[blocks * step : (blocks + 1) * step])
        blocks += 1
        assert blocks < 10
    assert blocks in (SETTINGS.spoilt + 1, SETTINGS.spoilt + 2)  # a block may be half full at the tare
    estimator.add(rest[blocks * step :])
    payload, (change,) = estimator.payload, estimator.changes
    assert payload is not None
    assert payload.mass == pytest.approx(8.0, abs=0.6)
    assert 0.6 < change.mass_std / payload.mass_std < 1.6  # both know the models' errors
