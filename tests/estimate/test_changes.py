"""The change detector: its Bayes factor against densities worked out by SciPy, and how often it is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from stadera.estimate.changes import ChangeDetector, ChangeLimits, Step
from stadera.estimate.square_root import SquareRoot

JUMPING = slice(0, 2)
SIZE = np.array([3.0, 3.0])
WRONG = np.array([0.8, -1.2])
"""Errors that are considered and not sought."""


def blocks(count: int, jump_at: int, jump: np.ndarray, seed: int) -> list[Step]:
    """Blocks of three rows on three unknowns, the first two of which jump."""
    rng = np.random.default_rng(seed)
    x, known = np.array([1.0, -1.0, 0.5]), SquareRoot.prior(np.zeros(3), 10.0 * np.ones(3), considered=2)
    steps = []
    for k in range(count):
        H = rng.standard_normal((3, 3))
        B = 0.3 * rng.standard_normal((3, 2))
        y = H @ (x + (k >= jump_at) * np.array([*jump, 0.0])) + B @ WRONG + rng.standard_normal(3)
        T, nu = H @ known.root, y - H @ known.mean
        T[:, 3:] += B
        squared = float(nu @ np.linalg.solve(np.eye(3) + T @ T.T, nu))
        steps.append(Step(0.02 * (k + 1), known, H, y, B, squared))
        known = known.measure(H, y, B)
    return steps


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_the_bayes_factor_is_the_ratio_of_the_densities(scale: float) -> None:
    detector = ChangeDetector(JUMPING, SIZE, ChangeLimits(bayes_factor=1e300))
    steps = blocks(10, 7, np.array([1.0, 0.5]), 0)
    for step in steps:
        assert detector.look(step, scale) is None
    last = steps[-3:]
    H, y = np.vstack([s.matrix for s in last]), np.concatenate([s.target for s in last])
    known, M = last[0].before, np.vstack([s.matrix for s in last])[:, JUMPING] * SIZE
    felt = H @ known.root
    felt[:, 3:] += np.vstack([s.considered for s in last])
    S = scale * np.eye(9) + felt @ felt.T
    densities = [multivariate_normal(H @ known.mean, C).logpdf(y) for C in (S + M @ M.T, S)]
    assert detector.log_bayes_factor(3, scale) == pytest.approx(densities[0] - densities[1], abs=1e-9)


def test_a_jump_is_noticed_placed_and_its_first_blocks_left_out() -> None:
    detector = ChangeDetector(JUMPING, SIZE, ChangeLimits(bayes_factor=1e6))
    steps = blocks(60, 40, np.array([6.0, -4.0]), 1)
    looks = [(k, jump) for k, step in enumerate(steps) if (jump := detector.look(step)) is not None]
    k, found = looks[0]
    assert 40 <= k <= 43
    assert found.time == pytest.approx(steps[40].time)
    assert found.before is steps[40].before
    assert len(found.after) == max(k + 1 - 42, 0)
    assert found.log_bayes_factor > np.log(1e6)


def test_wrong_alarms_are_as_rare_as_stated() -> None:
    """With a threshold that is exceeded by chance in one look of a hundred at most."""
    limits = ChangeLimits(bayes_factor=100.0, lengths=(4,))
    alarms = looks = 0
    for seed in range(30):
        detector = ChangeDetector(JUMPING, SIZE, limits)
        for step in blocks(40, 99, np.zeros(2), 10 + seed):
            alarms += detector.look(step) is not None
            looks += 1
    assert alarms / looks < 0.01
