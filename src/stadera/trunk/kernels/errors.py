"""Mean and covariance of the model errors, compiled: `RowSums.update` and `SwingJoints.posterior`."""

from __future__ import annotations

from math import sqrt

import numpy as np

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


@compiled(
    "void(float64[::1], float64[:,::1], float64[:,::1], float64[::1], float64[:,::1], float64[:,::1], int64, float64, "
    "float64, int64)"
)
def update(
    mean: Array,
    joints: Array,
    sticking: Array,
    variance: Array,
    shown: Array,
    remainder: Array,
    blocks: int,
    repeated: float,
    quietest: float,
    begin: int,
) -> None:
    """Updates mean (n,) and covariance of the errors, line by line as `RowSums.update`.

    Args:
        joints, sticking, variance: see `Covariance`; the first and the last are updated. shown: see there, written.
        remainder: (1 + n, 1 + n), of so many blocks. repeated, quietest: see `RowSums`.
        begin: first place of static friction.
    """
    n, k, known, held = len(mean), len(shown), len(joints), len(sticking)
    along, squared = remainder[0, 1:].copy(), remainder[0, 0]
    for e in range(known):
        for i in range(n):
            along[i] -= remainder[1 + e, 1 + i] * mean[e]
    for i in range(known):
        squared -= (remainder[0, 1 + i] + along[i]) * mean[i]
    loud = repeated * max(squared / (6.0 * blocks), quietest)
    normal, spread = np.empty((k, n)), np.empty((k, n))  # N, and N Σ
    N, P, size = np.empty((k, k)), np.empty((k, k)), np.empty(k)
    for i in range(k):
        for e in range(n):
            normal[i, e] = remainder[1 + i, 1 + e] / loud
            spread[i, e] = normal[i, e] * variance[e]
        size[i] = sqrt(joints[i, i])
    scaled = np.empty((k, k))
    for i in range(k):
        for j in range(k):
            unit = size[i] * size[j]
            scaled[i, j] = joints[i, j] / unit if unit > 0.0 else 0.0
            N[i, j] = normal[i, j]
            P[i, j] = normal[i, j] * unit
    system = np.dot(scaled, P)
    for i in range(k):
        system[i, i] += 1.0
    found = np.linalg.solve(system, scaled)
    S = np.empty((k, k))
    for i in range(k):
        for j in range(k):
            S[i, j] = 0.5 * (found[i, j] + found[j, i]) * size[i] * size[j]
    spread[:, :known] = np.dot(normal[:, :known].copy(), joints)
    spread[:, begin : begin + held] = np.dot(normal[:, begin : begin + held].copy(), sticking)
    for i in range(k):
        for j in range(k):
            mean[i] += S[i, j] * along[j] / loud
    moved = np.dot(S, spread)
    for i in range(k):
        for e in range(n):
            shown[i, e] = (joints[i, e] if e < known else 0.0) - moved[i, e]
    own = np.dot(np.dot(S, N) - np.dot(shown, normal.T), S)
    for i in range(k):
        for j in range(k):
            own[i, j] += shown[i, j]
    for i in range(k):
        for j in range(k):
            shown[i, j] = 0.5 * (own[i, j] + own[j, i])
        for e in range(known):
            joints[i, e] = joints[e, i] = shown[i, e]
        variance[i] = shown[i, i]
