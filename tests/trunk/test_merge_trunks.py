"""Trunks of several logs merged: each as by its log alone, their differences better, the same as one batch of rows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from layout import ERRORS, LAYOUT, PLACES
from stadera.errors import IdentificationError, UnknownNameError
from stadera.inertia import InertialParameters
from stadera.information import Information, Unknowns
from stadera.lab.plant import STANDARD
from stadera.robot import load_robot
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.merge import SHARED, TrunkEvidence, merge_trunks
from stadera.trunk.samples import Samples
from walking import Walk, recorded, walked

LOAD = InertialParameters.from_com(6.0, [0.12, 0.05, 0.2], 0.1 * np.eye(3))
GAIN = 1.03  # of all torques alike


@cache
def estimator(load: bool) -> TrunkEstimator:
    """Of a HyQ without a payload, or with one; every torque is reported 3 % too large."""
    robot = load_robot("hyq")
    walk = Walk(seconds=4.0, rate_hz=250.0, load=LOAD, loaded_at=0.0 if load else np.inf, seed=int(load))
    log = recorded(robot, walked(robot, walk), STANDARD, seed=3)
    assert log.effort is not None
    found = TrunkEstimator(robot)
    found.add(Samples.of_recording(replace(log, effort=GAIN * log.effort), robot))
    return found


def synthetic(seed: int, covariance: np.ndarray) -> tuple[TrunkEvidence, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(seed)
    A, C, b = rng.normal(size=(60, 10)), rng.normal(size=(60, ERRORS)), rng.normal(size=60)
    known = Information.empty(Unknowns.of(theta=10), ERRORS).add(A, b, C)
    return TrunkEvidence(known, 0.01 * rng.normal(size=ERRORS), covariance, covariance, covariance, 0.7, LAYOUT), (
        A,
        C,
        b,
    )


def test_merged_is_the_batch_of_all_rows() -> None:
    """Independent: generalised least squares would weigh by the errors; the batch takes them for p̂, and adds K Σ Kᵀ."""
    rng = np.random.default_rng(0)
    covariance = np.diag(rng.uniform(0.01, 0.1, ERRORS) ** 2)
    made = {name: synthetic(k, covariance) for k, name in enumerate("abc")}
    merged = merge_trunks({name: evidence for name, (evidence, _) in made.items()})
    shared = np.zeros(ERRORS, dtype=bool)
    for name in SHARED:
        shared[PLACES[name]] = True
    A = np.zeros((180, 30))
    together = np.zeros((180, 180))
    b = np.zeros(180)
    blocks = [(slice(60 * k, 60 * k + 60), slice(10 * k, 10 * k + 10)) for k in range(3)]
    for (rows, columns), (evidence, (matrix, errors, target)) in zip(blocks, made.values(), strict=True):
        A[rows, columns], b[rows] = matrix, target - errors @ evidence.mean
    for i, (rows, _) in enumerate(blocks):
        for j, (others, _) in enumerate(blocks):
            first, second = (list(made.values())[k][1][1] for k in (i, j))
            both = covariance if i == j else covariance * np.outer(shared, shared)
            together[rows, others] = first @ both @ second.T
    pinv = np.linalg.pinv(A)
    np.testing.assert_allclose(merged.known.mean, pinv @ b, rtol=1e-9)
    np.testing.assert_allclose(
        merged.known.covariance(), pinv @ (together + np.eye(180)) @ pinv.T, rtol=1e-8, atol=1e-12
    )


def test_each_trunk_is_as_by_its_log_alone() -> None:
    merged = merge_trunks({"one": estimator(False).evidence})
    value, covariance = merged.trunk("one")
    alone = estimator(False)
    assert value == pytest.approx(alone._history.current.mean(alone._fit.errors.mean), rel=1e-9)
    expected = alone._fit.errors.trunk_covariance(alone._history.current)
    np.testing.assert_allclose(covariance, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


def test_the_difference_of_two_logs_is_better_than_each_alone() -> None:
    """The common gain puts both trunks off by 3 % of the robot, 2.6 kg, and the payload between them by 0.2 kg."""
    merged = merge_trunks({"empty": estimator(False).evidence, "loaded": estimator(True).evidence})
    payload, robot = merged.difference("loaded", since="empty"), load_robot("hyq")
    off = merged.trunk("empty")[0][0] - robot.inertias[robot.trunk].mass
    assert off == pytest.approx(0.03 * robot.mass, rel=0.5), "alone it is off by what no log can tell"
    alone = [np.sqrt(merged.trunk(name)[1][0, 0]) for name in ("empty", "loaded")]
    assert payload.mass == pytest.approx(6.0, abs=3 * payload.mass_std)
    assert payload.com[:2] == pytest.approx(LOAD.com[:2], abs=0.03)
    assert payload.mass_std < 0.5 * min(alone)
    assert payload.mass_std < 0.5 * np.hypot(*alone)
    assert merged.difference("empty", since="loaded").mass == pytest.approx(-payload.mass)


def test_nothing_to_merge_and_logs_that_are_not_there() -> None:
    with pytest.raises(IdentificationError, match="nothing to merge"):
        merge_trunks({})
    with pytest.raises(UnknownNameError, match="nowhere"):
        merge_trunks({"one": estimator(False).evidence}).trunk("nowhere")


def test_errors_that_each_log_has_estimated_are_common_only_as_far_as_they_remain() -> None:
    """Two logs that measure the same error: by its posterior, and by draws of the error and of both logs' noise."""
    rng, at = np.random.default_rng(7), PLACES["encoder"].start
    prior, noise = np.diag(np.full(ERRORS, 1e-12)), (0.5, 2.0)
    prior[at, at] = 1.0
    G = np.zeros((10, ERRORS))
    G[0, at] = 3.0
    made = {}
    for name, sigma in zip("ab", noise, strict=True):
        posterior = prior.copy()
        posterior[at, at] = 1.0 / (1.0 + 1.0 / sigma**2)
        known = Information(Unknowns.of(theta=10), np.eye(10), np.zeros(10), G, 0.0, 10)
        made[name] = TrunkEvidence(known, np.zeros(ERRORS), posterior, prior, posterior, 0.7, LAYOUT)
    covariance = merge_trunks(made).known.covariance()
    error = rng.standard_normal(200_000)
    left = [(error + sigma * rng.standard_normal(len(error))) / (1.0 + sigma**2) - error for sigma in noise]
    expected = 9.0 * np.cov(left) + np.eye(2)
    assert covariance[np.ix_([0, 10], [0, 10])] == pytest.approx(expected, rel=0.03)
