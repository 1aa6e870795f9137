"""Estimates the white noise of each channel from the log.

The third difference of a signal that is smooth over four samples consists of noise alone, with 1 + 9 + 9 + 1 = 20 times
its variance. Steps of the gait are not smooth, so the estimate is the lower quartile over the blocks so far instead of
their mean, divided by that quartile of white noise. The mean square of m third differences, which are correlated with
ρ = -3/4, 3/10, -1/20 over one, two and three samples, is distributed as χ²/ν with (Satterthwaite)

    ν = m² / Σ_ij ρ²_ij = m² / (m + 2 Σ_k (m - k) ρ_k²)

degrees of freedom: 1.7 in a block of 20 ms at 200 Hz, 4.2 at 500 Hz, 8.5 at 1000 Hz. The noise affects the rows'
weights and decides what counts as motion; error bars are scaled by the rows' scatter.
"""

from __future__ import annotations

from functools import lru_cache
from math import sqrt

import numpy as np
from scipy.special import gammaincinv

from stadera.constants import GRAVITY
from stadera.robot.model import Robot
from stadera.types import Array

_LEAST, _MOST = 0.05, 20.0  # times the prior
_CORRELATED = (9.0 / 16.0, 9.0 / 100.0, 1.0 / 400.0)  # squared correlations of third differences


def third_differences_squared(signals: Array) -> Array:
    """Mean square of third differences over its gain of 20, of each column of (samples, columns); at least four
    samples.
    """
    steps = signals[1:] - signals[:-1]
    third = steps[2:] - 2.0 * steps[1:-1] + steps[:-2]
    return np.asarray(np.einsum("nc,nc->c", third, third) / (20.0 * len(third)))


class WhiteNoise:
    """Running estimate of the standard deviations of white noise.

    Args:
        torque, velocity: prior (joints,) and for all joints [N·m, rad/s]. gyro, accelerometer: [rad/s, m/s²].

    Attributes:
        variance, prior_variance: (2 joints + 6,), of torques, velocities, gyro and accelerometer.
    """

    def __init__(self, torque: Array, velocity: float, gyro: float, accelerometer: float) -> None:
        self._joints = len(torque)
        stds = [torque, np.full(len(torque), velocity), np.full(3, gyro), np.full(3, accelerometer)]
        self.prior_variance = np.concatenate(stds) ** 2
        self.variance = self.prior_variance.copy()

    @classmethod
    def prior(cls, robot: Robot, joints: int) -> WhiteNoise:
        """Prior: torques 0.5 % of the torque that carries the robot on one leg; IMU and encoders as in data sheets
        (gyro 0.005 rad/s, accelerometer 0.05 m/s², velocities 0.02 rad/s).
        """
        weight = 0.005 * GRAVITY * robot.mass * 0.25
        return cls(np.full(joints, weight), 0.02, 0.005, 0.05)

    def learn(self, squares: Array, samples: int, gain: float = 0.03) -> None:
        """Updates the estimate from mean squares of third differences (2 joints + 6,) over some samples; `gain` is the
        step of the variance's logarithm in each block.
        """
        above = squares > lower_quartile(samples - 3) * self.variance
        self.variance *= np.exp(gain * np.where(above, 1.0, -3.0))  # stationary if a quarter of the blocks lie below
        np.clip(self.variance, _LEAST**2 * self.prior_variance, _MOST**2 * self.prior_variance, out=self.variance)

    @property
    def torque(self) -> Array:
        """Standard deviation of the torques, (joints,) [N·m]."""
        return np.asarray(np.sqrt(self.variance[: self._joints]))

    @property
    def velocity(self) -> Array:
        """Standard deviation of the joint velocities, (joints,) [rad/s]."""
        return np.asarray(np.sqrt(self.variance[self._joints : -6]))

    @property
    def gyro(self) -> float:
        """Standard deviation of the gyro [rad/s]."""
        return sqrt(sum(self.variance[-6:-3].tolist()) / 3.0)

    @property
    def accelerometer(self) -> float:
        """Standard deviation of the accelerometer [m/s²]."""
        return sqrt(sum(self.variance[-3:].tolist()) / 3.0)


@lru_cache(maxsize=64)
def lower_quartile(differences: int) -> float:
    """Of the mean square of so many successive third differences of white noise, over what is expected of it."""
    pairs = sum((differences - k) * square for k, square in enumerate(_CORRELATED, 1) if k < differences)
    freedom = differences**2 / (differences + 2.0 * pairs)
    return float(2.0 * gammaincinv(0.5 * freedom, 0.25) / freedom)
