"""What a robot did in the latest blocks: how loud its velocities are, which joints stand, and where gravity is."""

from __future__ import annotations

from math import exp, inf

import numpy as np

from stadera.constants import GRAVITY
from stadera.trunk.noise import lower_quartile
from stadera.types import Array, Bools

_BLOCKS = 25  # over which noise and motion of joints are taken: a joint that turns back is not one that stands


class Lately:
    """Averages over the latest blocks, of J joints in the legs and l others."""

    def __init__(self) -> None:
        self._squares = self._speeds = np.zeros((0, 0))
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
        if self._speeds.shape[1] != velocity.shape[1]:
            self._speeds = np.zeros((0, velocity.shape[1]))
        known = np.concatenate([self._speeds, (velocity**2 / least)[follows]])
        total = np.zeros((len(known) + 1, known.shape[1]))
        known.cumsum(axis=0, out=total[1:])
        end = len(self._speeds) + np.cumsum(follows)
        begin = np.maximum(end - _BLOCKS, 0)
        self._speeds = known[-(_BLOCKS - 1) :]
        return np.asarray(total[end] - total[begin] < (end - begin)[:, None])

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
