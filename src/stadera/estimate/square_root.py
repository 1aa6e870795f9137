"""A square-root information filter: what is known of unknowns x, as `R x = z` with unit noise, R triangular.

    measure   [R z; H y]  -> its triangle                                 (rows H x = y, whitened)
    diffuse   x' = x + w, w ~ N(0, diag(s²)): [1/s, 0 | 0; -R s.., R | z], the triangle below w
    repeat    a copy of some unknowns that stays where they are now: a reference to compare with later

Every step is one QR, so the covariance R⁻¹ R⁻ᵀ is never less than positive.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SquareRoot:
    """What is known of n unknowns.

    Attributes:
        R: (n, n), upper triangular, not singular.
        z: (n,).
        cost: sum of squares that no x explains [1].
    """

    R: Array
    z: Array
    cost: float = 0.0

    @classmethod
    def prior(cls, mean: Array, std: Array) -> SquareRoot:
        """Independent unknowns, each about its mean (n,)."""
        return cls(np.diag(1.0 / std), mean / std)

    def __len__(self) -> int:
        return len(self.z)

    @cached_property
    def inverse(self) -> Array:
        """R⁻¹, (n, n): a square root of the covariance, P = R⁻¹ R⁻ᵀ."""
        return np.asarray(lapack.dtrtri(np.asfortranarray(self.R))[0])

    @cached_property
    def mean(self) -> Array:
        """(n,)."""
        return np.asarray(self.inverse @ self.z)

    def covariance(self, which: slice | None = None) -> Array:
        """Of all unknowns, or of some."""
        root = self.inverse if which is None else self.inverse[which]
        return np.asarray(root @ root.T)

    def measure(self, matrix: Array, target: Array) -> SquareRoot:
        """With rows of unit noise, (rows, n) and (rows,)."""
        n = len(self)
        stacked = np.empty((n + len(target), n + 1))
        stacked[:n, :n], stacked[:n, n] = self.R, self.z
        stacked[n:, :n], stacked[n:, n] = matrix, target
        triangle = _triangle(stacked)
        return SquareRoot(triangle[:n, :n], triangle[:n, n], self.cost + triangle[n, n] ** 2)

    def diffuse(self, which: slice, std: Array) -> SquareRoot:
        """With independent changes of these unknowns, of standard deviations (k,)."""
        n, k = len(self), len(std)
        stacked = np.zeros((k + n, k + n + 1))
        stacked[:k, :k] = np.eye(k)
        stacked[k:, :k] = -self.R[:, which] * std
        stacked[k:, k:-1], stacked[k:, -1] = self.R, self.z
        triangle = _triangle(stacked)
        return SquareRoot(triangle[k : k + n, k:-1], triangle[k : k + n, -1], self.cost)

    def repeat(self, which: slice) -> SquareRoot:
        """With a copy of these unknowns at the end: they are equal now, to a negligible part of what is known."""
        n, places = len(self), range(*which.indices(len(self)))
        k = len(places)
        stacked = np.zeros((n + k, n + k + 1))
        stacked[:n, :n], stacked[:n, -1] = self.R, self.z
        tight = _EQUAL / np.linalg.norm(self.inverse[which], axis=1)
        for row, place in enumerate(places):
            stacked[n + row, place], stacked[n + row, n + row] = -tight[row], tight[row]
        triangle = _triangle(stacked)
        return SquareRoot(triangle[:, :-1], triangle[:, -1], self.cost)

    def first(self, count: int) -> SquareRoot:
        """The first unknowns alone, nothing assumed of the others."""
        n = len(self)
        turned = np.hstack([self.R[:, count:], self.R[:, :count], self.z[:, None]])
        triangle = _triangle(turned)
        rest = n - count
        return SquareRoot(triangle[rest:n, rest:n], triangle[rest:n, n], self.cost)


_EQUAL = 1e6  # a copy equals its original to a millionth of what the original is known to


def _triangle(matrix: Array) -> Array:
    """The triangular factor, with as many rows as columns at most."""
    factor = lapack.dgeqrf(matrix)[0]
    top = min(matrix.shape)
    return np.asarray(factor[:top] * _upper(top, matrix.shape[1]))


@lru_cache(maxsize=64)
def _upper(rows: int, columns: int) -> Array:
    return np.triu(np.ones((rows, columns)))
