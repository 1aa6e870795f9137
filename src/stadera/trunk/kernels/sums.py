"""Sums of rows, compiled: what `stadera.trunk.segment` does by LAPACK for ten unknowns, and `stadera.trunk.summing`."""

from __future__ import annotations

from math import copysign, sqrt

import numpy as np

from stadera.compiled import compiled, part
from stadera.types import Array

# as in `stadera.trunk.scatter`
OUTLIER, LEAST_USUAL, MOST_ODD = 25.0, 0.01, 3.0


@compiled("void(float64[:,::1], float64[:,::1], float64, float64[:,::1])")
def fold(triangle: Array, left: Array, root: float, out: Array) -> None:
    """Adds rows [A b C] to a triangle [R z G] that is first multiplied by `root`, by Householder reflections.

    Args:
        triangle: (10, 10 + 1 + errors). left: (n, 10 + 1 + errors), the rows, and then what they leave after the
            unknowns are eliminated. out: as `triangle`, the sum.
    """
    n, unknowns, width = len(left), len(triangle), triangle.shape[1]
    along = np.empty(width)
    for i in range(unknowns):
        for c in range(width):
            out[i, c] = root * triangle[i, c]
    for j in range(unknowns):
        square = 0.0
        for i in range(n):
            square += left[i, j] * left[i, j]
        if square == 0.0:
            continue
        first = out[j, j]
        # H = 1 - τ v vᵀ with v = (1, rest / (first - last)) takes the column to (last, 0, ...)
        last = -copysign(sqrt(first * first + square), first)
        tau, scale = (last - first) / last, 1.0 / (first - last)
        # over all columns, of which those before j are zero: loops that start at zero are done several columns at once
        above = out[j]
        for c in range(width):
            along[c] = above[c]
        for i in range(n):
            v, row = left[i, j] * scale, left[i]
            for c in range(width):
                along[c] += v * row[c]
        for c in range(width):
            along[c] *= tau
            above[c] -= along[c]
        above[j] = last
        for i in range(n):
            v, row = left[i, j] * scale, left[i]
            for c in range(width):
                row[c] -= v * along[c]
            row[j] = 0.0


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
        for c in range(width - n):
            solution[i, c] = triangle[i, n + c]
        for k in range(i + 1, n):
            factor = triangle[i, k]
            for c in range(width - n):
                solution[i, c] -= factor * solution[k, c]
        for c in range(width - n):
            solution[i, c] *= pivot


@part
def mean_of(solution: Array, errors: Array, out: Array) -> None:
    """θ̂ (10,) = R⁻¹ z - K p, of p whose first entries are `errors` and whose others are zero."""
    for i in range(len(out)):
        row, value = solution[i], solution[i, 0]
        for e in range(len(errors)):
            value -= row[1 + e] * errors[e]
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
    odd: Array,
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
    """Weights a block's rows, limits them, counts their scatter and adds them, as `Summing.add`.

    Args:
        raw: (6, 10 + 1 + errors), of A, b and C. variances: (6,), of white noise. unit: (6,), of the rows.
        triangle, solution: of the present estimate. aged: solution of an earlier one.
        errors: (k,), first entries of p; the others are zero.
        root: of the weight of what was summed before.
        limited, counted: whether outliers are limited, and the scatter is counted.
        odd: (2,), usual squared residual and number of successive odd blocks, updated, as in `OddBlocks`.
        total, normal: (4,), (4, 4), updated, as in `Scatter`.
        columns: as `raw`, the weighted rows. summed: as `triangle`, inverse, solved, mean: of the new estimate.
        residue: (6, 1 + errors), what the rows leave. earlier, moments: sums of `RowMoments`, and those with the rows.
        stiction: first column of static friction.

    Returns:
        The rows' white variance.
    """
    n, width = raw.shape
    reduced, left, estimate = np.empty(n), np.empty(n), np.empty(10)
    white = 0.0
    for i in range(n):
        white += variances[i] / unit[i] ** 2
        before, row = raw[i], columns[i]
        for c in range(width):
            row[c] = before[c] / unit[i]
        reduced[i] = row[10]
        for e in range(len(errors)):
            reduced[i] -= row[11 + e] * errors[e]
    if limited:
        mean_of(solution, errors, estimate)
        square = residual(columns, reduced, estimate, left)
        if np.isnan(odd[0]):
            odd[0] = square
        limit = OUTLIER * max(odd[0], LEAST_USUAL)
        odd[0] += 0.01 * (min(square, 4.0 * odd[0]) - odd[0])
        odd[1] = odd[1] + 1.0 if square > limit else 0.0
        if 0.0 < odd[1] <= MOST_ODD:
            weight = sqrt(limit / square)
            columns *= weight
            reduced *= weight
            white *= weight * weight
    if counted:
        mean_of(aged, errors, estimate)
        residual(columns, reduced, estimate, left)
        for j in range(4):
            for i in range(n):
                total[j] += columns[i, j] * left[i]
                for k in range(4):
                    normal[j, k] += columns[i, j] * columns[i, k]
    rest = columns.copy()
    fold(triangle, rest, root, summed)
    residue[:] = rest[:, 10:]
    solve(summed, inverse, solved)
    mean_of(solved, errors, mean)
    for k in range(len(moments)):
        moments[k] = root * root * earlier[k]
    moments[0] += 1.0
    for i in range(3):
        moments[1 + i] += columns[i, 0]
        for j in range(3):
            moments[4 + 3 * i + j] += columns[i, 0] * columns[j, 0]
    for i in range(n):
        for j in range(12):
            moments[13 + 12 * i + j] += columns[i, stiction + j]
    return white
