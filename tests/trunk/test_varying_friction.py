"""Static friction that varies while a robot sways."""

from __future__ import annotations

import numpy as np

from layout import ERRORS, PLACES
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import load_robot
from stadera.trunk import Samples, TrunkEstimator
from stadera.trunk.segment import RowMoments, WeightedRows
from stadera.trunk.wrench import trunk_matrix

LENGTH = 0.6
KEEP = 0.99


def _swaying(rng: np.random.Generator, blocks: int) -> list[WeightedRows]:
    """Rows of a robot that sways a little about a slope."""
    unit = np.array([1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH])
    mixed = rng.normal(size=(3, 3)) * [0.3, 0.1, 0.05]
    stiction = rng.normal(size=(6, 12))
    rows = []
    for k in range(blocks):
        columns = np.zeros((6, 11 + ERRORS))
        a = np.array([0.5, -0.2, 9.8]) + mixed @ rng.normal(size=3)
        columns[:, :10] = trunk_matrix(np.concatenate([a, np.zeros(9)])) / unit[:, None]
        columns[:, 11 + PLACES["stiction"].start : 11 + PLACES["stiction"].stop] = stiction
        rows.append(WeightedRows(0.02 * k, columns, 0.0))
    return rows


def test_the_variance_is_that_of_errors_drawn_along_any_direction_of_the_sway() -> None:
    rng = np.random.default_rng(3)
    rows = _swaying(rng, 200)
    root = rng.normal(size=(12, 12))
    sums, weights = RowMoments.none(slice(0, 12)), np.zeros(0)
    for row in rows:
        sums, weights = sums.add(row, row.errors[:, PLACES["stiction"]], KEEP), np.append(KEEP * weights, 1.0)
    stated = sums.follows_motion(root @ root.T, LENGTH)

    A = np.array([row.matrix for row in rows])
    a = A[:, :3, 0]
    centred = a - weights @ a / weights.sum()
    cov = (weights[:, None] * centred).T @ centred / weights.sum()
    whitened = centred @ np.linalg.inv(np.linalg.cholesky(cov)).T  # components of unit variance, not correlated
    draws = 20_000
    along = rng.normal(size=(draws, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    errors = rows[0].errors[:, PLACES["stiction"]] @ root @ rng.normal(size=(12, draws))  # (6, draws)
    effect = np.einsum("t,trp,tu->pru", weights, A, whitened)  # Σ w Aᵀ of each component
    found = np.einsum("pru,rd,du->dp", effect, errors, along)
    np.testing.assert_allclose(found.T @ found / draws, stated, atol=0.05 * np.abs(stated).max())


def test_a_robot_at_rest_on_joints_that_stick_shows_no_height() -> None:
    robot = load_robot("hyq")
    for seed in (501, 502):
        log = simulate(robot, "stand", SimulateSettings("real-unit-gain", duration=4.0, seed=seed, hold=2)).recording
        estimator = TrunkEstimator(robot)
        estimator.add(Samples.of_recording(log, robot))
        assert estimator.trunk.observed[:3].all()
        assert not estimator.trunk.observed[3]
