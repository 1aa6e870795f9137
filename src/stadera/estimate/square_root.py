"""A square-root information filter: what is known of unknowns x, as `R x = z` with unit noise, R triangular.

    measure   [R z; H y]  -> its triangle                                 (rows H x = y, whitened)
    diffuse   x' = x + w, w ~ N(0, diag(s²)): [1/s, 0 | 0; -R s.., R | z], the triangle below w
    repeat    a copy of some unknowns that stays where they are now: a reference to compare with later

Every step is one QR, so the covariance R⁻¹ R⁻ᵀ is never less than positive.

What is wrong and never learnt is **considered** (Schmidt's filter): errors p of unit covariance, which enter rows as
H x + B p = y and are not sought. They go through every QR as further right-hand sides, `R x + G p = z`, so that the
estimate stays R⁻¹ z, is off by -R⁻¹ G p besides, and has the covariance

    P = R⁻¹ R⁻ᵀ + (R⁻¹ G) (R⁻¹ G)ᵀ

An error that does the same to two unknowns cancels in their difference, for both are off by the same p.
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
        G: (n, q), of the q errors that are considered.
        cost: sum of squares that no x explains [1].
    """

    R: Array
    z: Array
    G: Array
    cost: float = 0.0

    @classmethod
    def prior(cls, mean: Array, std: Array, considered: int = 0) -> SquareRoot:
        """Independent unknowns, each about its mean (n,), and so many errors that nothing has felt yet."""
        return cls(np.diag(1.0 / std), mean / std, np.zeros((len(mean), considered)))

    def __len__(self) -> int:
        return len(self.z)

    @cached_property
    def inverse(self) -> Array:
        """R⁻¹, (n, n)."""
        return np.asarray(lapack.dtrtri(np.asfortranarray(self.R))[0])

    @cached_property
    def root(self) -> Array:
        """[R⁻¹, -R⁻¹ G], (n, n + q): a square root of the covariance, of the rows' noise first."""
        if not self.G.shape[1]:
            return self.inverse
        return np.hstack([self.inverse, -self.inverse @ self.G])

    @cached_property
    def mean(self) -> Array:
        """(n,)."""
        return np.asarray(self.inverse @ self.z)

    def covariance(self, which: slice | None = None) -> Array:
        """Of all unknowns, or of some."""
        root = self.root if which is None else self.root[which]
        return np.asarray(root @ root.T)

    def measure(self, matrix: Array, target: Array, considered: Array | None = None) -> SquareRoot:
        """With rows of unit noise, (rows, n) and (rows,), and B, (rows, q); None where the errors do nothing."""
        n = len(self)
        stacked = self._stacked(n + len(target), n)
        stacked[n:, :n], stacked[n:, n] = matrix, target
        if considered is not None:
            stacked[n:, n + 1 :] = considered
        triangle = _triangle(stacked)
        return self._read(triangle[:n], triangle[n, n] ** 2)

    def diffuse(self, which: slice, std: Array) -> SquareRoot:
        """With independent changes of these unknowns, of standard deviations (k,)."""
        n, k = len(self), len(std)
        stacked = np.zeros((k + n, k + n + 1 + self.G.shape[1]))
        stacked[:k, :k] = np.eye(k)
        stacked[k:, :k] = -self.R[:, which] * std
        stacked[k:, k:] = self._stacked(n, n)
        return self._read(_triangle(stacked)[k:, k:])

    def repeat(self, which: slice) -> SquareRoot:
        """With a copy of these unknowns at the end: they are equal now, to a negligible part of what is known."""
        n, places = len(self), range(*which.indices(len(self)))
        k = len(places)
        stacked = self._stacked(n + k, n + k)
        tight = _EQUAL / np.linalg.norm(self.inverse[which], axis=1)
        for row, place in enumerate(places):
            stacked[n + row, place], stacked[n + row, n + row] = -tight[row], tight[row]
        return self._read(_triangle(stacked))

    def first(self, count: int) -> SquareRoot:
        """The first unknowns alone, nothing assumed of the others."""
        n = len(self)
        turned = np.hstack([self.R[:, count:], self.R[:, :count], self.z[:, None], self.G])
        rest = n - count
        return self._read(_triangle(turned)[rest:, rest:])

    def _stacked(self, rows: int, columns: int) -> Array:
        """[R 0 | z, G] with as many rows and columns of unknowns as asked for, the rest zero."""
        n = len(self)
        stacked = np.zeros((rows, columns + 1 + self.G.shape[1]))
        stacked[:n, :n], stacked[:n, columns], stacked[:n, columns + 1 :] = self.R, self.z, self.G
        return stacked

    def _read(self, triangle: Array, more: float = 0.0) -> SquareRoot:
        """From [R | z, G], rows below the triangle left out; `more` is what its rows added to the cost."""
        n = triangle.shape[1] - 1 - self.G.shape[1]
        return SquareRoot(triangle[:n, :n], triangle[:n, n], triangle[:n, n + 1 :], self.cost + more)


_EQUAL = 1e6  # a copy equals its original to a millionth of what the original is known to


def _triangle(matrix: Array) -> Array:
    """The triangular factor, with as many rows as columns at most."""
    factor = lapack.dgeqrf(matrix)[0]
    top = min(matrix.shape)
    return np.asarray(factor[:top] * _upper(top, matrix.shape[1]))


@lru_cache(maxsize=64)
def _upper(rows: int, columns: int) -> Array:
    return np.triu(np.ones((rows, columns)))
