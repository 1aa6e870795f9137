"""Legs in the air, compiled: `SwingJoints`.

Loops go over whole rows, also where a triangle would do: these are done several columns at once.
"""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled, part, reordered
from stadera.types import Array, Bools


@reordered
def dot(a: Array, b: Array) -> float:
    """Σ a b of two rows."""
    total = 0.0
    for c in range(len(a)):
        total += a[c] * b[c]
    return total


@reordered
def without(U: Array, k: int, rows: Array, row: Array) -> None:
    """Subtracts the first k rows, times the entries of column k of U, from a row, four at a time."""
    for m in range(0, k - 3, 4):
        a, b, c, d = U[m, k], U[m + 1, k], U[m + 2, k], U[m + 3, k]
        one, two, three, four = rows[m], rows[m + 1], rows[m + 2], rows[m + 3]
        for i in range(len(row)):
            row[i] -= a * one[i] + b * two[i] + c * three[i] + d * four[i]
    for m in range(k - k % 4, k):
        a, one = U[m, k], rows[m]
        for i in range(len(row)):
            row[i] -= a * one[i]


@part
def eliminate(A: Array) -> None:
    """Upper triangular factor U of a positive definite matrix Uᵀ U, in its place, with zeros below."""
    for k in range(len(A)):
        row = A[k]
        without(A, k, A, row)
        pivot = 1.0 / sqrt(row[k])
        for c in range(len(row)):
            row[c] *= pivot
        for c in range(k):
            row[c] = 0.0


@reordered
def solved(U: Array, right: Array, work: Array, out: Array) -> None:
    """x of Uᵀ U x = right."""
    n = len(U)
    for k in range(n):
        work[k], out[k] = right[k], 0.0
    for k in range(n):
        row, value = U[k], work[k] / U[k, k]
        for c in range(n):
            work[c] -= value * row[c]
        work[k] = value
    for i in range(n - 1, -1, -1):
        out[i] = (work[i] - dot(U[i], out)) / U[i, i]


@part
def divide(U: Array, out: Array) -> None:
    """U⁻ᵀ times a matrix (n, m), in its place."""
    for k in range(len(out)):
        row, pivot = out[k], 1.0 / U[k, k]
        without(U, k, out, row)
        for c in range(len(row)):
            row[c] *= pivot


@part
def square_of(A: Array, out: Array) -> None:
    """Aᵀ A (n, n)."""
    np.dot(A.T, A, out)


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
    information, scaled, work = np.empty((n, n)), np.empty(n), np.empty(n)
    for _ in range(2):  # the second pass uses the first one's residual
        quiet, sharp = 1.0 / loud, 1.0 / (scale * scale)
        for i in range(n):
            for j in range(n):
                information[i, j] = normal[i, j] * quiet + prior[i, j] * sharp
            scaled[i] = right[i] * quiet
        eliminate(information)
        solved(information, scaled, work, mean)
        if rows > n:
            left = square
            for i in range(n):
                left -= mean[i] * (2.0 * right[i] - dot(normal[i], mean))
            loud = repeated * max(left / rows, quietest)
    turned = np.eye(n)
    divide(information, turned)
    square_of(turned, covariance)
    return loud


@part
def add_row(row: Array, places: NDArray[np.int64], weight: float, residual: float, normal: Array, right: Array) -> None:
    """Adds a row with few entries (n,), at `places` (n,), to the sums of least squares."""
    for i in range(len(row)):
        right[places[i]] -= weight * row[i] * residual
        for k in range(len(row)):
            normal[places[i], places[k]] += weight * row[i] * row[k]


@part
def fitted(row: Array, places: NDArray[np.int64], mean: Array) -> float:
    """A row with few entries (n,), at `places` (n,), times a mean."""
    value = 0.0
    for i in range(len(row)):
        value += row[i] * mean[places[i]]
    return value


@compiled(
    "int64(boolean[::1], float64[:,::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], "
    "int64[:,::1], float64[::1], float64[::1], float64[:,::1], float64[::1], float64[:,::1])"
)
def swing(
    air: Bools,
    terms: Array,
    rate: Array,
    residual: Array,
    white: Array,
    limit: Array,
    numbers: Array,
    places: NDArray[np.int64],
    last: Array,
    expected: Array,
    normal: Array,
    right: Array,
    joints: Array,
) -> int:
    """Adds one block to the sums of `SwingJoints`, as its `add`. Returns the number of rows used.

    Args:
        air, terms, rate, residual, white: as of `SwingJoints.add`. limit: (12,) [N·m], effort limits.
        numbers: `SwingDetection.residual`; squared residual beyond which a row is skipped; that of a joint which has
            departed, infinite if not known; rows over which a joint's residual is averaged; least departure as a share
            of the effort limit; sum of squares, updated.
        places: (12, 5), of rotor inertia, viscous and Coulomb friction, offset and torque lag, by joint.
        last, expected: (n,), present mean of the errors, and that of the log's beginning.
        normal, right: (n, n), (n,), updated.
        joints: (3, 12), weights of the averages, averages of the residuals, and what has departed; updated.
    """
    used, row = 0, np.empty(5)
    for j in range(12):
        for t in range(4):
            row[t] = terms[t, j]
        row[4] = -rate[j]
        weight = 1.0 / (white[j] ** 2 + (numbers[0] * limit[j]) ** 2)
        swings = air[j // 3]
        if numbers[2] < np.inf:
            if swings:
                joints[0, j] += (1.0 - joints[0, j]) / numbers[3]
                joints[1, j] += (residual[j] + fitted(row, places[j], expected) - joints[1, j]) / numbers[3]
            mean = joints[1, j] / max(joints[0, j], 1e-9)
            large = joints[0, j] > 0.5 and abs(mean) > numbers[4] * limit[j] and weight * mean**2 > numbers[2]
            if large and abs(mean) > abs(joints[2, j]):
                joints[2, j] = -mean
        if swings and weight * (residual[j] + fitted(row, places[j], last)) ** 2 <= numbers[1]:
            add_row(row, places[j], weight, residual[j], normal, right)
            numbers[5] += weight * residual[j] ** 2
            used += 1
    return used


@compiled("void(float64[:,::1], float64, float64[:,::1])")
def add_scaled(total: Array, scale: float, known: Array) -> None:
    """Adds a multiple of a matrix to another one, in one pass."""
    for i in range(len(total)):
        to, row = total[i], known[i]
        for c in range(len(to)):
            to[c] += scale * row[c]
