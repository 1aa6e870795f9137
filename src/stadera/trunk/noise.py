"""White noise of each channel, estimated from the log; and what a robot did in the latest blocks beyond it.

The third difference of a signal that is smooth over four samples consists of noise alone, with 1 + 9 + 9 + 1 = 20 times
its variance. Steps of the gait are not smooth, so the estimate is the lower quartile over the blocks so far instead of
their mean, divided by that quartile of white noise. The mean square of m third differences, which are correlated with
ρ = -3/4, 3/10, -1/20 over one, two and three samples, is distributed as χ²/ν with (Satterthwaite)

    ν = m² / Σ_ij ρ²_ij = m² / (m + 2 Σ_k (m - k) ρ_k²)

degrees of freedom: 1.7 in a block of 20 ms at 200 Hz, 4.2 at 500 Hz, 8.5 at 1000 Hz. The noise affects the rows'
weights and decides what counts as motion; error bars are scaled by the rows' scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import exp, inf, sqrt
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from stadera.body.friction import STICTION_VELOCITY
from stadera.constants import GRAVITY
from stadera.robot.model import Robot
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.settings import ModelErrors
from stadera.trunk.window import Window
from stadera.types import Array, Bools

_LEAST, _MOST = 0.05, 20.0  # times the prior
_STEPS = np.exp([0.03, -0.09])  # of a variance, up and down: stationary if a quarter of the blocks lie below
_CORRELATED = (9.0 / 16.0, 9.0 / 100.0, 1.0 / 400.0)  # squared correlations of third differences


def mean_third_differences_squared(signals: Array, window: Window) -> Array:
    """Mean square of third differences over their gain of 20, (B, channels), in each of B blocks of two and more
    samples, from signals (samples, channels) with one sample more before and after them.
    """
    steps = signals[1:] - signals[:-1]
    third = steps[2:] - 2.0 * steps[1:-1] + steps[:-2]
    return np.asarray(window.sums(window.inside, third * third)[:, 0] / 20.0)


class Variances(NamedTuple):
    """Of white noise in B blocks: of torques and velocities, (B, joints), of gyro and accelerometer, (B,)."""

    torque: Array
    velocity: Array
    gyro: Array
    accelerometer: Array


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
        self.variance = self.prior_variance
        self._least, self._most = _LEAST**2 * self.prior_variance, _MOST**2 * self.prior_variance

    @classmethod
    def prior(cls, robot: Robot, joints: int) -> WhiteNoise:
        """Prior: torques 0.5 % of the torque that carries the robot on one leg; IMU and encoders as in data sheets
        (gyro 0.005 rad/s, accelerometer 0.05 m/s², velocities 0.02 rad/s).
        """
        weight = 0.005 * GRAVITY * robot.mass * 0.25
        return cls(np.full(joints, weight), 0.02, 0.005, 0.05)

    def learn(self, squares: Array, samples: int) -> None:
        """Updates the estimate from mean squares of third differences (2 joints + 6,) over some samples."""
        above = squares > lower_quartile(samples - 3) * self.variance
        self.variance = self.variance * np.where(above, *_STEPS)
        np.maximum(self.variance, self._least, out=self.variance)
        np.minimum(self.variance, self._most, out=self.variance)

    def learnt(self, squares: Array | None, sizes: Sequence[int], used: Bools) -> Variances:
        """The variances after each of some blocks.

        Args:
            squares: (B, 2 joints + 6), of each block; None if they tell nothing. sizes: of the blocks, without the
                samples before and after. used: (B,), blocks that count.
        """
        found = []
        for k, size in enumerate(sizes):
            if squares is not None and used[k]:
                self.learn(squares[k], size + 2)
            found.append(self.variance)
        values, J = np.array(found), self._joints
        imu = values[:, -6:].reshape(-1, 2, 3).mean(axis=2)
        return Variances(values[:, :J].copy(), values[:, J:-6].copy(), imu[:, 0], imu[:, 1])


@lru_cache(maxsize=64)
def lower_quartile(differences: int) -> float:
    """Of the mean square of so many successive third differences of white noise, over what is expected of it."""
    pairs = sum((differences - k) * square for k, square in enumerate(_CORRELATED, 1) if k < differences)
    freedom = differences**2 / (differences + 2.0 * pairs)
    return float(2.0 * gammaincinv(0.5 * freedom, 0.25) / freedom)


# blocks over which noise and motion of joints are taken, so that a joint that turns back is not one that stands, and
# those that a joint pauses for at least, 40 ms: a knee that turns round in each stance is at rest for less. With one
# payloads of 25 simulated trots are 0.61 standard deviations off (rms), with two 0.69, without pauses 1.06
_BLOCKS, _PAUSE = 25, 2


class RunningSums:
    """Sums over the latest blocks, `length` of them at most."""

    def __init__(self, length: int) -> None:
        self._length, self._known = length, np.zeros((0, 0))

    def sums(self, values: Array, follows: Bools) -> tuple[Array, Array]:
        """Of values (B, n) of blocks that count, `follows` (B,), at the end of each block: the sums (B, n), and the
        number of blocks in them (B, 1).
        """
        known = self._known if self._known.shape[1] == values.shape[1] else np.zeros((0, values.shape[1]))
        end, known = len(known) + np.cumsum(follows), np.concatenate([known, values[follows]])
        total = np.zeros((len(known) + 1, known.shape[1]))
        known.cumsum(axis=0, out=total[1:])
        begin = np.maximum(end - self._length, 0)
        self._known = known[-self._length :]
        return total[end] - total[begin], (end - begin)[:, None]


class Lately:
    """Averages over the latest blocks, of J joints in the legs and l others: how loud velocities are, which joints
    stand, where gravity is.
    """

    def __init__(self) -> None:
        self._squares, self._speeds, self._motions = np.zeros((0, 0)), RunningSums(_BLOCKS), RunningSums(_PAUSE)
        self.forget()

    def forget(self) -> None:
        """Announces that the trunk's rotation until the next block is unknown."""
        self._gravity, self._known = np.zeros(3), 0.0  # the average, and the sum of its weights

    def noise(self, variance: Array, squares: Array, sizes: tuple[int, ...]) -> Array:
        """Variance (B, J) of the velocities' noise, at least that of the latest blocks by their mean squares (B, J): it
        is known slowly, and noise that is louder than expected would pass for motion for a second or two.
        """
        usual, B = np.array([[lower_quartile(size - 1)] for size in sizes]), len(sizes)
        known = np.concatenate([self._squares, squares / usual]) if self._squares.size else squares / usual
        ends = range(len(known) - B + 1, len(known) + 1)
        lately = [np.quantile(known[max(end - _BLOCKS, 0) : end], 0.25, axis=0) for end in ends]
        self._squares = known[-(_BLOCKS - 1) :]
        return np.maximum(variance, lately)

    def still(self, velocity: Array, least: Array, follows: Bools) -> Bools:
        """Joints (B, J + l) that have not moved lately beyond their noise: a joint that sticks, not one that turns
        back; those of the legs, then of the limbs.

        Args:
            velocity: (B, J + l), averages over windows. least: likewise, square of what is motion. follows: (B,),
                blocks with rows.
        """
        squares, count = self._speeds.sums(velocity**2 / least, follows)
        return np.asarray(squares < count)

    def pauses(self, velocity: Array, least: Array, follows: Bools) -> Bools:
        """The same that have been at rest for some blocks, as a knee may be in a stance, or creep: a gear that sticks
        gives way, and the direction of so slow a motion tells no friction.
        """
        moves = velocity**2 > np.maximum(least, STICTION_VELOCITY**2)
        return np.asarray(self._motions.sums(moves.astype(float), follows)[0] == 0.0)

    def gravity(self, force: Array, turn: Array, elapsed: Array, follows: Bools) -> Array:
        """Mean specific force (B, 3) over the last second before the end of each block that `follows` another, turned
        with the trunk. Impacts count for half of gravity at most.

        Args:
            force: (B, 3), of each window. turn: (B, 3, 3), of the trunk in each. elapsed: (B,) [s].
        """
        out = np.zeros_like(force)
        for b in np.flatnonzero(follows):
            keep = exp(-elapsed[b])
            self._known = keep * self._known + 1.0 - keep
            share, carried = (1.0 - keep) / self._known, turn[b] @ self._gravity
            struck = inf if share == 1.0 else 0.5 * GRAVITY  # the first block is all that is known
            out[b] = self._gravity = carried + share * np.clip(force[b] - carried, -struck, struck)
        return out


class AtRest:
    """Mean specific force of a robot at rest, which is gravity: it tells the accelerometer's error along it.

    Over a time T the trunk's velocity changes by what it has left at both ends, so the mean is off by √2 `settles` / T.
    """

    def __init__(self) -> None:
        self._time, self._beyond, self._along = 0.0, 0.0, np.zeros(3)

    def add(self, force: Array, elapsed: Array) -> None:
        """Takes in blocks at rest: specific force (B, 3), and their durations (B,) [s]."""
        size = np.linalg.norm(force, axis=1)
        self._time += float(elapsed.sum())
        self._beyond += float(elapsed @ (size - GRAVITY))
        self._along += (elapsed / np.maximum(size, 1e-300)) @ force

    def known(self, layout: ErrorLayout, sizes: ModelErrors) -> Array | None:
        """y and h (1 + errors,) of y = h p + ε, all over the standard deviation of ε; None before any rest."""
        if not self._time:
            return None
        out = np.zeros(1 + layout.count)
        out[0], out[1:][layout.places["accelerometer"]] = self._beyond, self._along
        return np.asarray(out / np.hypot(sizes.gravity * self._time, sqrt(2.0) * sizes.settles))
