"""What the detector's bars, the tare's and those of changes at rest are made of, from both sides."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from reference_changes import Deviations, ReferenceDetector
from scipy.stats import norm, t

from layout import LAYOUT
from stadera.lab.scenarios.run import simulate
from stadera.lab.scenarios.settings import Load, SimulateSettings
from stadera.robot import load_robot
from stadera.trunk.changes import Spread
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.samples import Samples
from stadera.trunk.settings import ChangeSettings
from stadera.trunk.standing.equilibrium import ConstantErrors
from stadera.weigh.at_rest import RestBlock, change_variance

SETTINGS = ChangeSettings()
SCALE = np.array([50.0, 30.0, 30.0, 30.0])
BLOCK = 0.02
AT = SETTINGS.windows.index(50)


def detector(samples: float = 1e6, blocks: int = 10**9) -> ReferenceDetector:
    """One whose averages had a standard deviation of 0.01, seen in so many of them over so many blocks."""
    made, windows = ReferenceDetector(SETTINGS, SCALE, BLOCK, LAYOUT), len(SETTINGS.windows)
    made._set(Spread(np.full((windows, 4), 1e-4), np.zeros((windows, 4)), np.full(windows, samples)))
    made._past_blocks = blocks
    return made


def deviation(size: float, before: float = 0.0) -> Deviations:
    """Of the average over fifty blocks, in mass alone."""
    sizes = np.array([[size, 0.0, 0.0, 0.0]])
    return Deviations(np.array([50]), sizes, 0.0 * sizes, 0.0 * sizes, np.full((1, 4), before))


def test_a_spread_of_few_averages_is_students() -> None:
    limit = SETTINGS.deviations
    for samples in (3, 10):
        ratio = detector(samples - SETTINGS.prior_averages)._largest(deviation(0.1), 1.0).ratio
        assert ratio == pytest.approx(10.0 * limit / t.ppf(norm.cdf(limit), samples), rel=1e-6)
    assert detector()._largest(deviation(0.1), 1.0).ratio == pytest.approx(10.0, rel=1e-3)


def test_the_earlier_estimate_has_a_spread_of_its_own() -> None:
    for blocks, share in ((50, 1.0), (200, 0.25)):
        found = detector(blocks=blocks)._largest(deviation(0.1), 1.0)
        assert found.variance[0] == pytest.approx(1e-4 * (1.0 + share))
    found = detector()._largest(deviation(0.1, before=2e-4), 3.0)
    assert found.variance[0] == pytest.approx(1e-4 + 6e-4)


def test_a_suspected_change_fades() -> None:
    made = detector()
    made._likely = SETTINGS.confirmed
    made._carry(np.array([0.02, 0.0, 0.0, 0.0]), persists=True)
    assert made.suspected[0] == pytest.approx(1.0)
    made._likely = 0
    for _ in range(round(SETTINGS.memory / BLOCK)):
        made._carry(np.zeros(4), persists=False)
    assert made.suspected[0] == pytest.approx(np.exp(-1.0), rel=1e-3)


def loaded_walk() -> tuple[TrunkEstimator, Samples]:
    robot = load_robot("hyq")
    load = Load(8.0, "kg", (0.0, 0.0, 0.15))
    settings = SimulateSettings("standard", load, duration=5.0, seed=4, load_time=3.0)
    return TrunkEstimator(robot), Samples.of_recording(simulate(robot, "trot-load", settings).recording, robot)


def test_a_tare_leaves_out_its_blocks_and_bars_say_what_is_suspected_and_what_errors_do() -> None:
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
    estimator._changes.detector = SimpleNamespace(suspected=np.array([0.5, 0.0, 0.0, 0.0]))
    more = estimator.payload
    assert more is not None
    assert more.mass_std == pytest.approx(np.hypot(payload.mass_std, 0.5), rel=1e-6)


def test_at_rest_both_loads_of_a_change_have_noise_and_pose() -> None:
    errors = ConstantErrors.of_robot(load_robot("hyq"))
    plain = np.zeros(39)
    first = RestBlock(0.0, 1.0, 100, 50.0, 0.04, plain, np.zeros(4))
    second = replace(first, begin=1.0, end=2.0, count=300, mass=52.0, variance=0.01)
    both = first.joined(second)
    assert both.mass == pytest.approx(51.5)
    assert both.variance == pytest.approx(0.25**2 * 0.04 + 0.75**2 * 0.01)
    alone, noisy = (change_variance(before, second, errors) for before in (first, replace(first, variance=0.2)))
    assert noisy - alone == pytest.approx(0.16, rel=1e-6)
