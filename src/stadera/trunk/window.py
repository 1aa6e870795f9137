"""Windows over blocks of samples: weighted sums, and lines fitted block by block.

The window of two neighbouring blocks is a raised cosine: one block's falling half is the next one's rising half.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled
from stadera.types import Array

Ints = NDArray[np.int64]


class Window(NamedTuple):
    """Weights of the samples of B blocks of a window's halves, N samples in all.

    Attributes:
        edges: (B + 1,), of the blocks. counts: (B,), of their samples. block: (N,), of each sample.
        halves: (2, N), rising and falling. both: (4, N), these, and the same with alternating signs, + at a block's
            end, - where the next one begins.
        fit: (2, N), of a block's mean, and of the slope of a line through its samples, over the sample's number `along`
            (N,) from the middle. mean: (1, N), the first of these.
        inside: (1, N), of the mean over all samples of a block but the last, of which third differences are.
        averaged: (B,), Σ w². differences: (B,), see `half_differences`.
    """

    edges: Ints
    counts: Ints
    block: Ints
    halves: Array
    both: Array
    mean: Array
    fit: Array
    inside: Array
    along: Array
    averaged: Array
    differences: Array

    def at(self, time: Array) -> Window:
        """The same with its halves at stamps (N + 2,), those of the samples before and after included.

        By the trapezoidal rule each sample counts for half the time between its neighbours, the time over which
        derivatives are differences of these. So in their sum the values' noise cancels, however uneven the stamps are.
        """
        between = 0.5 * (time[1:] + time[:-1])
        begin, end = (between[edges][self.block] for edges in (self.edges[:-1], self.edges[1:]))
        share = np.diff(between) / (end - begin)
        rising = (0.5 - 0.5 * np.cos(np.pi * (time[1:-1] - begin) / (end - begin))) * share
        return self._replace(halves=np.stack([rising, share - rising]))

    def sums(self, weights: Array, values: Array) -> Array:
        """Weighted sums (B, H, ...) of values (N, ...) over each block, weights (H, N)."""
        out = np.zeros((len(self.edges) - 1, len(weights), values[0].size))
        block_sums(weights, self.block, np.ascontiguousarray(values).reshape(len(values), -1), out)
        return out.reshape(*out.shape[:2], *values.shape[1:])

    def line(self, values: Array) -> Array:
        """A line fitted to values (N, J) in each block."""
        found = self.sums(self.fit, values)[self.block]
        return np.asarray(found[:, 0] + self.along[:, None] * found[:, 1])


@lru_cache(maxsize=64)
def window_of(sizes: tuple[int, ...]) -> Window:
    """The window of blocks of so many samples."""
    rising = [half_window(n) for n in sizes]
    falling = [w[::-1] for w in rising]
    signs = [1.0 - 2.0 * (np.arange(n) % 2) for n in sizes]
    along = [np.arange(n) - 0.5 * (n - 1) for n in sizes]
    mean = np.concatenate([np.full(n, 1.0 / n) for n in sizes])
    both = np.stack(
        [
            np.concatenate(rising),
            np.concatenate(falling),
            np.concatenate([w * sign[::-1] for w, sign in zip(rising, signs, strict=True)]),
            np.concatenate([-w * sign for w, sign in zip(falling, signs, strict=True)]),
        ]
    )
    return Window(
        np.concatenate([[0], np.cumsum(sizes)]),
        np.array(sizes),
        np.repeat(np.arange(len(sizes)), sizes),
        both[:2],
        both,
        mean[None],
        np.stack([mean, np.concatenate([x / max(float(x @ x), 1.0) for x in along])]),
        np.concatenate([np.append(np.full(n - 1, 1.0 / max(n - 1, 1)), 0.0) for n in sizes])[None],
        np.concatenate(along),
        np.array([float(w @ w) for w in rising]),
        np.array([half_differences(n) for n in sizes]),
    )


@compiled("void(float64[:,::1], int64[::1], float64[:,::1], float64[:,:,::1])")
def block_sums(weights: Array, block: Ints, values: Array, out: Array) -> None:
    """Adds weighted sums of values (N, M) over each sample's block to `out` (B, H, M); weights (H, N)."""
    for k in range(len(values)):
        for h in range(len(weights)):
            weight = weights[h, k]
            for c in range(values.shape[1]):
                out[block[k], h, c] += weight * values[k, c]


@lru_cache(maxsize=64)
def half_window(n: int) -> Array:
    """The rising half of a raised cosine over 2 n samples, its sum one half."""
    window: Array = (1.0 - np.cos(np.pi * (np.arange(n) + 0.5) / n)) / (2.0 * n)
    return window


@lru_cache(maxsize=64)
def half_differences(n: int) -> float:
    """Half the variance of Σ w_k (x_k+1 - x_k-1) / 2 over 2 n samples for white noise x of unit variance: the sum of
    squares of (w_k-1 - w_k+1) / 2 over the rising half, w zero outside.
    """
    w = np.concatenate([np.zeros(2), half_window(n), half_window(n)[-1:]])
    return float((0.25 * (w[2:] - w[:-2]) ** 2).sum())
