"""White noise from the log: signals whose noise is known, at the rates at which robots log."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.trunk.noise import Variances, WhiteNoise, mean_third_differences_squared
from stadera.trunk.samples import Samples
from stadera.trunk.window import half_differences, half_window, window_of

TORQUE, VELOCITY, GYRO, ACCELEROMETER = 0.4, 0.03, 0.004, 0.1
BLOCK, SECONDS = 0.02, 16.0


def learnt(rate: float, touchdowns: bool = False) -> Variances:
    """Fed with noise on a slow motion, one sample more before and after each block, as the estimator feeds it."""
    rng, found = np.random.default_rng(0), WhiteNoise(np.full(12, 1.0), 0.02, 0.005, 0.05)
    n = round(rate * BLOCK)
    time = np.arange(round(SECONDS * rate)) / rate
    wave = np.sin(2.0 * np.pi * 1.5 * time)[:, None]
    torque = 20.0 * wave + TORQUE * rng.standard_normal((len(time), 12))
    if touchdowns:
        torque[(time % 0.25) < 1.5 / rate] += 30.0
    velocity = 3.0 * wave + VELOCITY * rng.standard_normal((len(time), 12))
    gyro, force = (std * rng.standard_normal((len(time), 3)) for std in (GYRO, ACCELEROMETER))
    log = Samples(time, np.zeros((len(time), 12)), velocity, torque, gyro, force)
    channels = np.hstack([log.effort, log.velocity, log.angular_velocity, log.specific_force])
    for k in range(1, len(time) - n, n):
        square = mean_third_differences_squared(channels[k - 1 : k + n + 1], window_of((n,)))
        variances = found.learnt(square, (n,), np.array([True]))
    return Variances(*(np.sqrt(variance[0]) for variance in variances))


@pytest.mark.parametrize("rate", [200.0, 500.0, 1000.0])
def test_noise_is_found_at_every_rate(rate: float) -> None:
    """A block at 200 Hz holds three third differences, at 1000 Hz nineteen: the quartile is another."""
    found = learnt(rate)
    np.testing.assert_allclose(found.torque.mean(), TORQUE, rtol=0.15)
    np.testing.assert_allclose(found.velocity.mean(), VELOCITY, rtol=0.15)
    np.testing.assert_allclose([found.gyro, found.accelerometer], [GYRO, ACCELEROMETER], rtol=0.2)


@pytest.mark.parametrize("rate", [200.0, 500.0, 1000.0])
def test_touchdowns_are_not_noise(rate: float) -> None:
    """Blows of 30 N·m four times a second, in each twelfth block, against noise of 0.4."""
    np.testing.assert_allclose(learnt(rate, touchdowns=True).torque.mean(), TORQUE, rtol=0.25)


@pytest.mark.parametrize("n", [2, 3, 4, 10])
def test_noise_of_windowed_accelerations_is_that_of_drawn_ones(n: int) -> None:
    """A continuous window would overstate it by a fifth with four samples in a block."""
    x = np.random.default_rng(n).standard_normal((200_000, 2 * n + 2))
    window = np.concatenate([half_window(n), half_window(n)[::-1]])
    drawn = 0.5 * (x[:, 2:] - x[:, :-2]) @ window
    assert 2.0 * half_differences(n) == pytest.approx(drawn.var(), rel=0.015)


def test_noise_of_long_mean_accelerations_is_the_same_with_uneven_stamps() -> None:
    """Velocities of noise at 500 Hz, of stamps that jitter by most of a step, over 20 blocks; plain means of each
    sample's own acceleration would be ten times as loud.
    """
    rng, n, blocks, step = np.random.default_rng(0), 10, 20, 2e-3
    plain, rising = window_of((n,) * (blocks + 1)), half_window(blocks // 2)
    slow = np.concatenate([rising, rising[::-1]])
    even, drawn = step * np.arange(n * (blocks + 1) + 2), {"even": [], "uneven": []}
    for _ in range(200):
        v, uneven = rng.standard_normal((len(even), 1)), np.sort(even + rng.uniform(0.0, 0.9 * step, len(even)))
        for name, time in {"even": even, "uneven": uneven}.items():
            window = plain.at(time)
            mean = window.sums(window.halves, (v[2:] - v[:-2]) / (time[2:] - time[:-2])[:, None])
            drawn[name].append(slow @ (mean[:-1, 0] + mean[1:, 1]))
    assert np.std(drawn["uneven"]) < 1.4 * np.std(drawn["even"])


def test_halves_at_even_stamps_are_a_raised_cosine_and_at_any_sum_to_one_half() -> None:
    """The rising one is that of the samples' numbers; both share a block's time."""
    rng, sizes = np.random.default_rng(1), (4, 10, 2)
    even, plain = np.arange(sum(sizes) + 2.0), window_of(sizes)
    np.testing.assert_allclose(plain.at(even).halves[0], np.concatenate([half_window(n) for n in sizes]), atol=1e-12)
    uneven = plain.at(even + rng.uniform(0.0, 0.9, len(even)))
    np.testing.assert_allclose(uneven.sums(uneven.halves, np.ones((len(even) - 2, 1))).sum(axis=1), 1.0, atol=1e-12)
