"""What of noisy accelerations counts as motion: against Gaussian signals whose best guess is known."""

from __future__ import annotations

import numpy as np

from stadera.trunk.calibration import SignalCalibration

NOISE = np.array([0.04, 0.04, 0.04, 0.01, 0.01, 0.01])
GRAVITY = np.array([0.0, 0.0, 9.81])


def fed(motion: float, blocks: int = 400, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Accelerations (blocks, 3) as they were, as measured, as guessed, and what is doubtful; blocks of 20 ms."""
    rng, excitation = np.random.default_rng(seed), SignalCalibration()
    true = motion * rng.standard_normal((blocks, 3))
    measured = true + np.sqrt(NOISE[3:]) * rng.standard_normal((blocks, 3))
    guessed, doubtful = np.empty((blocks, 3)), np.empty((blocks, 3))
    for k in range(blocks):
        force = GRAVITY + np.sqrt(NOISE[:3]) * rng.standard_normal(3)
        signals = np.concatenate([force, measured[k], np.zeros(6)])
        out, doubtful[k] = excitation.calibrated(signals, NOISE, np.eye(3), 0.02)
        guessed[k] = out[3:6]
    return true[100:], measured[100:], guessed[100:], doubtful[100:]


def test_noise_alone_is_no_motion() -> None:
    _, measured, guessed, doubtful = fed(0.0)
    assert np.mean(guessed == 0.0) > 0.95
    np.testing.assert_allclose(doubtful, measured - guessed, atol=1e-12)


def test_motion_far_beyond_the_noise_stays_as_it_is() -> None:
    _, measured, guessed, doubtful = fed(5.0)
    np.testing.assert_allclose(guessed, measured, rtol=2e-3)
    assert np.abs(doubtful).max() < 2e-3 * np.abs(measured).max()


def test_between_it_is_nearer_to_the_truth_and_regression_on_it_is_not_biased() -> None:
    true, measured, guessed, _ = fed(0.2, 4000)
    assert np.mean((guessed - true) ** 2) < 0.9 * np.mean((measured - true) ** 2)
    slope = np.sum(guessed * true) / np.sum(guessed**2)
    plain = np.sum(measured * true) / np.sum(measured**2)
    assert abs(slope - 1.0) < 0.05 < abs(plain - 1.0)
