"""Sums of rows, compiled: what `stadera.trunk.segment` does by LAPACK for ten unknowns, and `stadera.trunk.summing`."""

from __future__ import annotations

from math import copysign, sqrt

import numpy as np

from stadera.compiled import compiled, part, reordered
from stadera.types import Array

ROOM = 176  # at least the columns of a triangle, and known to the compiler


@reordered
def reflect(work: Array, above: Array, j: int) -> None:
    """Householder reflection of row j and the last six of `work` (16, ROOM), which makes column j of these zero."""
    a, b, c, d, e, f = work[10, j], work[11, j], work[12, j], work[13, j], work[14, j], work[15, j]
    square = a * a + b * b + c * c + d * d + e * e + f * f
    if square == 0.0:
        return
    first = work[j, j]
    # H = 1 - τ v vᵀ with v = (1, rest / (first - last)) takes the column to (last, 0, ...)
    last = -copysign(sqrt(first * first + square), first)
    tau, scale = (last - first) / last, 1.0 / (first - last)
    a, b, c, d, e, f = a * scale, b * scale, c * scale, d * scale, e * scale, f * scale
    # over all columns, of which those before j are zero: loops that start at zero are done several columns at once
    for k in range(ROOM):
        above[k] = work[j, k]
    for k in range(ROOM):
        along = above[k] + a * work[10, k] + b * work[11, k] + c * work[12, k]
        along = tau * (along + d * work[13, k] + e * work[14, k] + f * work[15, k])
        above[k] -= along
        work[10, k] -= a * along
        work[11, k] -= b * along
        work[12, k] -= c * along
        work[13, k] -= d * along
        work[14, k] -= e * along
        work[15, k] -= f * along
    above[j] = last
    for i in range(10, 16):
        work[i, j] = 0.0
    for k in range(ROOM):
        work[j, k] = above[k]


@compiled("void(float64[:,::1], float64[:,::1], float64, float64[:,::1])")
def fold(triangle: Array, left: Array, root: float, out: Array) -> None:
    """Adds rows [A b C] to a triangle [R z G] that is first multiplied by `root`, by Householder reflections.

    Args:
        triangle: (10, 10 + 1 + errors). left: (6, 10 + 1 + errors), the rows, and then what they leave after the
            unknowns are eliminated. out: as `triangle`, the sum.
    """
    width, work, above = triangle.shape[1], np.empty((16, ROOM)), np.empty(ROOM)
    for i in range(10):
        for c in range(width):
            work[i, c] = root * triangle[i, c]
    for i in range(6):
        for c in range(width):
            work[10 + i, c] = left[i, c]
    for i in range(16):
        for c in range(width, ROOM):
            work[i, c] = 0.0
    for j in range(10):
        reflect(work, above, j)
    for i in range(10):
        for c in range(width):
            out[i, c] = work[i, c]
    for i in range(6):
        for c in range(width):
            left[i, c] = work[10 + i, c]


@compiled("void(float64[:,::1], float64[:,::1], float64[:,::1])")
def solve(triangle: Array, inverse: Array, solution: Array) -> None:
    """R⁻¹ (10, 10) and R⁻¹ [z G] (10, 1 + errors) of a triangle [R z G]."""
    n, width = len(triangle), triangle.shape[1]
    inverse[:] = 0.0
    for i in range(n - 1, -1, -1):
        pivot = 1.0 / triangle[i, i]
        inverse[i, i] = pivot
        for j in range(i + 1, n):
            total = 0.0
            for k in range(i + 1, j + 1):
                total += triangle[i, k] * inverse[k, j]
            inverse[i, j] = -pivot * total
        row, right = solution[i], triangle[i, n:]
        for c in range(width - n):
            row[c] = right[c]
        for k in range(i + 1, n):
            other, factor = solution[k], triangle[i, k]
            for c in range(width - n):
                row[c] -= factor * other[c]
        for c in range(width - n):
            row[c] *= pivot


@reordered
def mean_of(solution: Array, errors: Array, out: Array) -> None:
    """θ̂ (10,) = R⁻¹ z - K p, of p whose first entries are `errors` and whose others are zero."""
    for i in range(len(out)):
        value, row = solution[i, 0], solution[i, 1:]
        for e in range(len(errors)):
            value -= row[e] * errors[e]
        out[i] = value


@part
def residual(columns: Array, reduced: Array, mean: Array, out: Array) -> float:
    """b - C p - A θ̂ of rows, from b - C p (n,); returns its square."""
    square = 0.0
    for i in range(len(out)):
        out[i] = reduced[i]
        for c in range(10):
            out[i] -= columns[i, c] * mean[c]
        square += out[i] ** 2
    return square


@reordered
def weigh(raw: Array, variances: Array, unit: Array, errors: Array, columns: Array, reduced: Array) -> float:
    """Writes rows in their unit, and b - C p. Returns their white variance."""
    white = 0.0
    for i in range(len(raw)):
        white += variances[i] / unit[i] ** 2
        before, row, factor = raw[i], columns[i], 1.0 / unit[i]
        for c in range(raw.shape[1]):
            row[c] = before[c] * factor
        left, known = row[10], row[11:]
        for e in range(len(errors)):
            left -= known[e] * errors[e]
        reduced[i] = left
    return white


@part
def weight_of(square: float, usual: Array) -> float:
    """Weight of a block of six rows by its squared residual, as `RobustWeights`; `usual` as of `digest`."""
    square /= 6.0
    if np.isnan(usual[0]):
        usual[0] = square
    weight: float = (usual[4] + 6.0) / (usual[4] + 6.0 * square / max(usual[0], usual[3]))
    usual[1] = min(usual[1] + 1.0, usual[2])
    usual[0] += weight * (square - usual[0]) / usual[1]
    usual[7] += 1.0
    usual[8] += min(square, usual[6] * usual[0])
    usual[9] += weight
    usual[10] += weight * square
    return weight


@part
def multiply(columns: Array, factor: float, out: Array) -> None:
    """Writes rows times a factor."""
    for i in range(len(columns)):
        for c in range(columns.shape[1]):
            out[i, c] = factor * columns[i, c]


@part
def count(columns: Array, left: Array, weight: float, total: Array, normal: Array) -> None:
    """Adds rows and their residuals to the sums of `Scatter`."""
    for j in range(4):
        for i in range(len(left)):
            total[j] += weight * columns[i, j] * left[i]
            for k in range(4):
                normal[j, k] += weight * columns[i, j] * columns[i, k]


@part
def add_moments(columns: Array, weight: float, keep: float, earlier: Array, stiction: int, moments: Array) -> None:
    """`RowMoments.add`."""
    for k in range(len(moments)):
        moments[k] = keep * earlier[k]
    moments[0] += weight
    for i in range(3):
        moments[1 + i] += weight * columns[i, 0]
        for j in range(3):
            moments[4 + 3 * i + j] += weight * columns[i, 0] * columns[j, 0]
    for i in range(len(columns)):
        for j in range(12):
            moments[13 + 12 * i + j] += weight * columns[i, stiction + j]


@compiled(
    "float64(float64[:,::1], float64[::1], float64[::1], float64[:,::1], float64[:,::1], float64[:,::1], float64[::1], "
    "float64, boolean, boolean, float64[::1], float64[::1], float64[:,::1], float64[:,::1], float64[:,::1], "
    "float64[:,::1], float64[:,::1], float64[::1], float64[:,::1], float64[::1], float64[::1], int64)"
)
def digest(
    raw: Array,
    variances: Array,
    unit: Array,
    triangle: Array,
    solution: Array,
    aged: Array,
    errors: Array,
    root: float,
    limited: bool,
    counted: bool,
    usual: Array,
    total: Array,
    normal: Array,
    columns: Array,
    summed: Array,
    inverse: Array,
    solved: Array,
    mean: Array,
    residue: Array,
    earlier: Array,
    moments: Array,
    stiction: int,
) -> float:
    """Weights a block's rows, counts their scatter and adds them, as `Summing.add`.

    Args:
        raw: (6, 10 + 1 + errors), of A, b and C. variances: (6,), of white noise. unit: (6,), of the rows.
        triangle, solution: of the present estimate. aged: solution of an earlier one.
        errors: (k,), first entries of p; the others are zero.
        root: of the weight of what was summed before.
        limited, counted: whether the block is weighted by its residual, and the scatter is counted.
        usual: (11,), mean square of usual residuals and its number of blocks, updated, as in `RobustWeights`;
            `remembered`, `least_usual` and `freedom` of `OutlierSettings`; the block's weight, written; `outlier`;
            `sums`, updated.
        total, normal: (4,), (4, 4), updated, as in `Scatter`.
        columns: as `raw`, the rows in their unit. summed: as `triangle`, inverse, solved, mean: of the new estimate.
        residue: (6, 1 + errors), what the rows leave. earlier, moments: sums of `RowMoments`, and those with the rows.
        stiction: first column of static friction.

    Returns:
        The rows' white variance.
    """
    n = len(raw)
    reduced, left, estimate = np.empty(n), np.empty(n), np.empty(10)
    white = weigh(raw, variances, unit, errors, columns, reduced)
    usual[5] = 1.0
    if limited:
        mean_of(solution, errors, estimate)
        usual[5] = weight_of(residual(columns, reduced, estimate, left), usual)
    if counted:
        mean_of(aged, errors, estimate)
        residual(columns, reduced, estimate, left)
        count(columns, left, usual[5], total, normal)
    rest = np.empty(columns.shape)
    multiply(columns, sqrt(usual[5]), rest)
    fold(triangle, rest, root, summed)
    for i in range(n):
        for c in range(residue.shape[1]):
            residue[i, c] = rest[i, 10 + c]
    solve(summed, inverse, solved)
    mean_of(solved, errors, mean)
    add_moments(columns, usual[5], root * root, earlier, stiction, moments)
    return white
