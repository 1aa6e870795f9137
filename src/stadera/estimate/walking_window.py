"""The window that rows are filtered by, a raised cosine over two blocks, block by block."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Half:
    """One block's samples, half a window: what rows need of them, see `RowMaker.block`.

    Attributes:
        rising, falling: weights of the samples where the block comes first, and where it comes second.
        differentiated: Σ ẇ² over it [1/s²].
    """

    time: Array
    columns: Array
    to_wrench: Array
    noise: tuple[Array, Array]
    probes: Array
    angular_velocity: Array
    by_links: Array | None
    rising: Array
    falling: Array
    differentiated: float

    @classmethod
    def of(
        cls,
        time: Array,
        columns: Array,
        E: Array,
        noise: tuple[Array, Array],
        probes: Array,
        omega: Array,
        by_links: Array | None,
    ) -> Half:
        n = len(time)
        rising = _half_window(n)
        step = (time[-1] - time[0]) / (n - 1) if n > 1 else 0.02
        # Σ ẇ² over a half: the window of length 2nT has ẇ = (π / n²T) sin(...) / 2, squared and summed n/2 times
        differentiated = (np.pi / (2.0 * n * n * step)) ** 2 * n / 2.0
        return cls(time, columns, E, noise, probes, omega, by_links, rising, rising[::-1], float(differentiated))


def fitted(velocity: Array, n: int) -> Array:
    """The first n velocities (samples, 4, 3) by a line over them each; the rest as they are."""
    out = velocity.copy()
    along = np.arange(n) - 0.5 * (n - 1)
    slope = np.tensordot(along, velocity[:n], 1) / max(along @ along, 1.0)
    out[:n] = velocity[:n].mean(axis=0) + along[:, None, None] * slope
    return out


@lru_cache(maxsize=64)
def _half_window(n: int) -> Array:
    """The rising half of a raised cosine over 2 n samples, its sum one half."""
    window: Array = (1.0 - np.cos(np.pi * (np.arange(n) + 0.5) / n)) / (2.0 * n)
    return window


def spread(E: Array, weights: Array, std: Array) -> Array:
    """Σ_k w_k² E_k Σ E_kᵀ, (6, 6)."""
    M = (E * weights[:, None, None] * std).reshape(6, -1)
    return np.asarray(M @ M.T)
