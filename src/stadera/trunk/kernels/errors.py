"""Mean and covariance of the model errors, compiled: `RowSums.update` and `SwingJoints.posterior`."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled, part
from stadera.types import Array


@part
def cholesky(A: Array) -> None:
    """Lower triangular factor of a positive definite matrix, in its place, with zeros above."""
    n = len(A)
    for i in range(n):
        row = A[i]
        for j in range(i):
            other, total = A[j], row[j]
            for k in range(j):
                total -= row[k] * other[k]
            row[j] = total / other[j]
        total = row[i]
        for k in range(i):
            total -= row[k] * row[k]
        row[i] = sqrt(total)
        row[i + 1 :] = 0.0


@part
def solved(L: Array, right: Array, out: Array) -> None:
    """x of L Lᵀ x = right."""
    n = len(L)
    for i in range(n):
        total = right[i]
        for k in range(i):
            total -= L[i, k] * out[k]
        out[i] = total / L[i, i]
    for i in range(n - 1, -1, -1):
        out[i] /= L[i, i]
        for k in range(i):
            out[k] -= L[i, k] * out[i]


@part
def inverse_of(L: Array, out: Array) -> None:
    """Inverse of L Lᵀ."""
    n = len(L)
    X = np.zeros((n, n))  # L⁻¹, by rows
    for i in range(n):
        row = X[i]
        row[i] = 1.0
        for k in range(i):
            other, factor = X[k], L[i, k]
            for c in range(n):
                row[c] -= factor * other[c]
        pivot = 1.0 / L[i, i]
        for c in range(n):
            row[c] *= pivot
    out[:] = 0.0
    for i in range(n):
        row = X[i]
        for a in range(i + 1):
            target, factor = out[a], row[a]
            for c in range(n):
                target[c] += factor * row[c]


@compiled(
    "float64(float64[:,::1], float64[::1], float64, int64, float64[:,::1], float64, float64, float64, float64[::1], "
    "float64[:,::1])"
)
def posterior(
    normal: Array,
    right: Array,
    square: float,
    rows: int,
    prior: Array,
    scale: float,
    repeated: float,
    quietest: float,
    mean: Array,
    covariance: Array,
) -> float:
    """Mean (n,) and covariance (n, n) of least squares around a prior, `SwingJoints.posterior`. Returns the noise's
    variance that it used last.

    Args:
        normal, right, square, rows: sums of the rows. prior: inverse covariance, of a scale of one.
        repeated: rows with the same error. quietest: least variance.
    """
    n, loud = len(right), repeated
    information, scaled = np.empty((n, n)), np.empty(n)
    for _ in range(2):  # the second pass uses the first one's residual
        for i in range(n):
            for j in range(n):
                information[i, j] = normal[i, j] / loud + prior[i, j] / (scale * scale)
            scaled[i] = right[i] / loud
        cholesky(information)
        solved(information, scaled, mean)
        if rows > n:
            left = square
            for i in range(n):
                total = 2.0 * right[i]
                for j in range(n):
                    total -= normal[i, j] * mean[j]
                left -= mean[i] * total
            loud = repeated * max(left / rows, quietest)
    inverse_of(information, covariance)
    return loud


@compiled("void(float64[::1], float64[:,::1], float64[:,::1], int64, float64, float64, int64[::1])")
def update(
    mean: Array,
    covariance: Array,
    remainder: Array,
    blocks: int,
    repeated: float,
    quietest: float,
    edges: NDArray[np.int64],
) -> None:
    """Updates mean (n,) and covariance (n, n) of the errors, line by line as `RowSums.update`.

    Args:
        remainder: (1 + n, 1 + n), of so many blocks. repeated, quietest: see `RowSums`.
        edges: ends of the errors that are updated and of those of swinging legs, begin and end of the other block of Σ.
    """
    n, k, joints, begin, end = len(mean), edges[0], edges[1], edges[2], edges[3]
    target, products = remainder[1:, 0].copy(), remainder[1:, 1:].copy()
    along = target - np.dot(products, mean)
    square = remainder[0, 0] - np.dot(target + along, mean)
    loud = repeated * max(square / (6.0 * blocks), quietest)
    normal = products[:k] / loud
    N, P, size = normal[:, :k].copy(), covariance[:k, :k].copy(), np.empty(k)
    for i in range(k):
        size[i] = sqrt(P[i, i])
    scaled = np.empty((k, k))
    for i in range(k):
        for j in range(k):
            unit = size[i] * size[j]
            scaled[i, j] = P[i, j] / unit if unit > 0.0 else 0.0
            P[i, j] = N[i, j] * unit
    system = np.dot(scaled, P)
    for i in range(k):
        system[i, i] += 1.0
    found = np.linalg.solve(system, scaled)
    S = np.empty((k, k))
    for i in range(k):
        for j in range(k):
            S[i, j] = 0.5 * (found[i, j] + found[j, i]) * size[i] * size[j]
    mean[:k] += np.dot(S, along[:k]) / loud
    spread = np.empty((k, n))  # N Σ
    for i in range(k):
        for e in range(n):
            spread[i, e] = normal[i, e] * covariance[e, e]
    spread[:, :joints] = np.dot(normal[:, :joints].copy(), covariance[:joints, :joints].copy())
    spread[:, begin:end] = np.dot(normal[:, begin:end].copy(), covariance[begin:end, begin:end].copy())
    moved = covariance[:k] - np.dot(S, spread)
    own = moved[:, :k] + np.dot(np.dot(S, N) - np.dot(moved, normal.T), S)
    for i in range(k):
        for e in range(n):
            covariance[i, e] = covariance[e, i] = moved[i, e]
    for i in range(k):
        for j in range(k):
            covariance[i, j] = 0.5 * (own[i, j] + own[j, i])
