"""Averages over the latest blocks, compiled: what `ChangeDetector` of `stadera.trunk.changes` does at each block."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled, part, reordered
from stadera.types import Array

WILD, MEDIAN = 3.0, 0.455  # as in `stadera.trunk.changes`


@part
def mean_of(solution: Array, errors: Array, out: Array) -> None:
    """θ̂ (10,) = R⁻¹ z - K p, of p whose first entries are `errors` and whose others are zero."""
    for i in range(len(out)):
        row, value = solution[i], solution[i, 0]
        for e in range(len(errors)):
            value -= row[1 + e] * errors[e]
        out[i] = value


@reordered
def by_errors(before: Array, after: Array, first: int, solution: Array, std: Array) -> float:
    """Variance of the difference of two summed rows (10 + 1 + errors + 1) due to model errors, Σ_e (C - A K)²_e σ_e².

    K follows the first column of `solution` (10, 1 + errors). The products are written out, so that they fit the
    processor's vectors: four of the row of mass (`first` 0), whose others are zero, and nine of the others (`first` 1).
    """
    K, variance = solution, 0.0
    if first == 0:
        a0, a1, a2, a3 = after[0] - before[0], after[1] - before[1], after[2] - before[2], after[3] - before[3]
        for e in range(len(std)):
            moved = a0 * K[0, 1 + e] + a1 * K[1, 1 + e] + a2 * K[2, 1 + e] + a3 * K[3, 1 + e]
            moved = (after[11 + e] - before[11 + e] - moved) * std[e]
            variance += moved * moved
        return variance
    a1, a2, a3 = after[1] - before[1], after[2] - before[2], after[3] - before[3]
    a4, a5, a6 = after[4] - before[4], after[5] - before[5], after[6] - before[6]
    a7, a8, a9 = after[7] - before[7], after[8] - before[8], after[9] - before[9]
    for e in range(len(std)):
        moved = a1 * K[1, 1 + e] + a2 * K[2, 1 + e] + a3 * K[3, 1 + e] + a4 * K[4, 1 + e] + a5 * K[5, 1 + e]
        moved += a6 * K[6, 1 + e] + a7 * K[7, 1 + e] + a8 * K[8, 1 + e] + a9 * K[9, 1 + e]
        moved = (after[11 + e] - before[11 + e] - moved) * std[e]
        variance += moved * moved
    return variance


@reordered
def product(row: Array, errors: Array) -> float:
    """Sum of the products with the first entries of a row."""
    total = 0.0
    for e in range(len(errors)):
        total += row[e] * errors[e]
    return total


@part
def moved_down(values: Array, begin: int, end: int, limit: float, equal: bool) -> int:
    """Moves values below a limit, or equal to it too, to the beginning of a range, without a branch on the values.
    Returns where the others begin.
    """
    to = begin
    for i in range(begin, end):
        value = values[i]
        values[i], values[to] = values[to], value
        to += int(value <= limit) if equal else int(value < limit)
    return to


@part
def smallest(values: Array, n: int, k: int) -> float:
    """The k-th smallest of the first n values, counted from 0; sorts them partly (quickselect)."""
    low, high = 0, n
    while high - low > 1:
        a, b, c = values[low], values[(low + high) // 2], values[high - 1]
        pivot = max(min(a, b), min(max(a, b), c))
        others = moved_down(values, low, high, pivot, False)
        if k < others:
            high = others
            continue
        low = moved_down(values, others, high, pivot, True)
        if k < low or low == others:  # the latter for what is not a number
            return float(pivot)
    return float(values[low])


@part
def middle(values: Array, n: int) -> float:
    """The median of the first n values, which are sorted partly."""
    upper = smallest(values, n, n // 2)
    return upper if n % 2 else 0.5 * (upper + smallest(values, n, n // 2 - 1))


@part
def single(reduced: Array, i: int, mean: Array, scale: Array) -> float:
    """One block's own difference in component i, in units of `scale`."""
    left: float = reduced[i, 10]
    for c in range(10):
        left -= reduced[i, c] * mean[c]
    return float(left / (max(reduced[i, 11], 1e-12) * scale[i]))


@part
def since(
    reduced: Array,
    old: Array,
    new: Array,
    n: int,
    mean: Array,
    inverse: Array,
    solution: Array,
    std: Array,
    scale: Array,
    near: Array,
    spread: Array,
    usual: Array,
    scatter: float,
    size: Array,
    variance: Array,
    work: Array,
) -> None:
    """δ (4,) and its variance (4,) of the average over the last n of the reduced rows, before which the running
    sums are `old`, and after which `new`.

    Args:
        mean, inverse, solution: of the estimate before. std: of the model errors.
        near: (4,), Huber's limit. spread, usual: (4,), of this window. scatter: κ.
        work: (2, n) or longer.
    """
    weight_at, last = new.shape[1] - 1, len(reduced)
    for i in range(4):
        for k in range(n):
            work[0, k] = single(reduced[last - n + k], i, mean, scale)
            work[1, k] = work[0, k]
        centre = smallest(work[1], n, n // 2)
        sum_near = 0.0
        for k in range(n):
            value = min(max(work[0, k], centre - near[i]), centre + near[i])
            sum_near += value * reduced[last - n + k, i, 11]
        weight = max(new[i, weight_at] - old[i, weight_at], 1e-12)
        size[i] = sum_near / weight
        by_model = by_errors(old[i], new[i], min(i, 1), solution, std) / (weight * scale[i]) ** 2
        before = 0.0
        for c in range(10):
            before += inverse[i, c] ** 2
        own = 1.0 / (weight * scale[i] ** 2)
        variance[i] = max(spread[i] + max(by_model - usual[i], 0.0), own) + scatter * before / scale[i] ** 2


@compiled("void(float64[:,:,::1], float64[:,:,::1], float64[::1], int64, int64)")
def reduce(rows: Array, reduced: Array, errors: Array, begin: int, end: int) -> None:
    """A, b - C p and the weight of projected rows (..., 4, 10 + 1 + k + 1), into (..., 4, 12), of a range of blocks.

    Args:
        errors: (k,), p, as far as it is estimated.
    """
    k = len(errors)
    for n in range(begin, end):
        for i in range(4):
            row, out = rows[n, i], reduced[n, i]
            for c in range(11):
                out[c] = row[c]
            out[10] -= product(row[11:], errors)
            out[11] = row[11 + k]


@compiled("void(float64[:,::1], float64[::1], float64[:,:,::1], float64[:,:,::1], float64[:,:,::1], int64)")
def push(columns: Array, errors: Array, rows: Array, reduced: Array, sums: Array, at: int) -> None:
    """Adds a block's rows (6, 10 + 1 + errors), projected as `WeightedRows.projected`, to the running sums, writes
    those of A, b, the first errors and the weight into `rows` (..., 4, 10 + 1 + k + 1), and reduces them.
    """
    a, b, c = columns[0, 0], columns[1, 0], columns[2, 0]
    x, y, z = columns[4, 3], columns[5, 1], columns[3, 2]
    width, kept = columns.shape[1], rows.shape[2] - 1
    projected = np.empty((4, width + 1))
    for k in range(width):
        projected[0, k] = a * columns[0, k] + b * columns[1, k] + c * columns[2, k]
        projected[1, k] = y * columns[5, k] - z * columns[4, k]
        projected[2, k] = z * columns[3, k] - x * columns[5, k]
        projected[3, k] = x * columns[4, k] - y * columns[3, k]
    projected[0, width] = a * a + b * b + c * c
    projected[1:, width] = x * x + y * y + z * z
    for i in range(4):
        for k in range(kept):
            rows[at, i, k] = projected[i, k]
        rows[at, i, kept] = projected[i, width]
        for k in range(width + 1):
            sums[at + 1, i, k] = sums[at, i, k] + projected[i, k]
    reduce(rows, reduced, errors, at, at + 1)


@compiled(
    "float64(float64[:,:,::1], float64[:,:,::1], int64, int64[::1], int64, int64, float64[:,::1], float64[:,::1], "
    "float64[:,::1], float64[:,::1], float64[::1], float64[::1], float64[::1], float64[::1], "
    "float64[:,::1], float64[:,::1], float64[::1], float64, float64[::1], float64[:,::1])"
)
def largest(
    reduced: Array,
    sums: Array,
    end: int,
    windows: NDArray[np.int64],
    short: int,
    long: int,
    inverse: Array,
    solution: Array,
    long_inverse: Array,
    long_solution: Array,
    errors: Array,
    std: Array,
    scale: Array,
    near: Array,
    square: Array,
    usual: Array,
    student: Array,
    scatter: float,
    limits: Array,
    out: Array,
) -> float:
    """The deviation with most standard deviations, as `ChangeDetector._largest` of both `_since`. Returns its ratio.

    Args:
        reduced, sums: of all blocks, of which the last is before `end`.
        windows: numbers of blocks. short, long: how many of the short ones are looked at, from the first, and up to
            where the long ones are, from the first long one at `limits[2]`.
        inverse, solution: of the estimate without the latest blocks; `long_`: without twice as many.
        errors: (k,), first entries of p; the others are zero. std: of model errors.
        scale, near: (4,), units and Huber's limit. square, usual: (windows, 4). student: (windows,).
        limits: least change, pending blocks, number of short windows.
        out: (3, 4), blocks and whether to report; δ; variance.
    """
    best, first_long = -1.0, int(limits[2])
    size, variance, mean, long_mean = np.empty(4), np.empty(4), np.empty(10), np.empty(10)
    work = np.empty((2, windows[-1]))
    mean_of(solution, errors, mean)
    mean_of(long_solution, errors, long_mean)
    out[:] = 0.0
    out[2] = 1.0
    for w in range(len(windows)):
        n = windows[w]
        if w < first_long:
            if w >= short:
                continue
            m, inv, sol = mean, inverse, solution
        else:
            if w >= long:
                continue
            m, inv, sol = long_mean, long_inverse, long_solution
        since(
            reduced[end - n : end],
            sums[end - n],
            sums[end],
            n,
            m,
            inv,
            sol,
            std,
            scale,
            near,
            square[w],
            usual[w],
            scatter,
            size,
            variance,
            work,
        )
        reported = False
        for i in range(4):
            reported |= abs(size[i]) > limits[0]
        ratio = 0.0
        if reported or 3 * n > limits[1]:
            for i in range(4):
                if not reported or abs(size[i]) > limits[0]:
                    ratio = max(ratio, abs(size[i]) / sqrt(variance[i]))
        ratio *= student[w]
        if ratio > best:
            best = ratio
            out[0, 0], out[0, 1] = n, 1.0 if reported else 0.0
            out[1], out[2] = size, variance
    return max(best, 0.0)


@compiled(
    "void(float64[:,:,::1], float64[:,:,::1], int64, int64, float64, int64[::1], float64[::1], float64[:,::1], "
    "float64[::1], float64[::1], float64, float64[::1], float64[:,::1], float64[:,::1], int64[::1])"
)
def spreads(
    reduced: Array,
    sums: Array,
    begin: int,
    n: int,
    share: float,
    windows: NDArray[np.int64],
    mean: Array,
    solution: Array,
    std: Array,
    scale: Array,
    outlier: float,
    scatter: Array,
    square: Array,
    expected: Array,
    counts: NDArray[np.int64],
) -> None:
    """Mean squares of past averages and their usual variance due to model errors, as `ChangeDetector.learn`.

    Args:
        reduced, sums: of all blocks. begin: index of the first block, n: number of blocks.
        share: of the variances due to model errors that `expected` exceeds.
        mean, solution: of the estimate. std: of model errors. scale: (4,). outlier: Huber's limit.
        scatter: (4,), written. square, expected: (windows, 4), written; counts: (windows,), of averages.
    """
    singles, running, work = np.empty((n, 4)), np.zeros((n + 1, 4, 2)), np.empty(n)
    for i in range(4):
        for k in range(n):
            singles[k, i] = single(reduced[begin + k], i, mean, scale)
            work[k] = abs(singles[k, i])
        scatter[i] = max(1.5 * middle(work, n), 1e-6)
        near = outlier * scatter[i]
        for k in range(n):
            weight = reduced[begin + k, i, 11]
            running[k + 1, i, 0] = running[k, i, 0] + min(max(singles[k, i], -near), near) * weight
            running[k + 1, i, 1] = running[k, i, 1] + weight
    weight_at = sums.shape[2] - 1
    squares, variances = np.empty((4, n)), np.empty((4, n))
    for w in range(len(windows)):
        m, count = windows[w], 0
        for first in range(0, n - m, max(m // 2, 1)):
            for i in range(4):
                near_sum = running[first + m, i, 0] - running[first, i, 0]
                weight = max(running[first + m, i, 1] - running[first, i, 1], 1e-12)
                squares[i, count] = (near_sum / weight) ** 2
                before, after = sums[begin + first, i], sums[begin + first + m, i]
                weight = max(after[weight_at] - before[weight_at], 1e-12) * scale[i]
                variances[i, count] = by_errors(before, after, min(i, 1), solution, std) / weight**2
            count += 1
        counts[w] = count
        if count == 0:
            continue
        for i in range(4):
            work[:count] = squares[i, :count]
            limit = WILD**2 * middle(work, count) / MEDIAN
            mean_square = 0.0
            for k in range(count):
                mean_square += min(squares[i, k], limit)
            square[w, i] = mean_square / count
            # the quantile between two values, linearly
            at = share * (count - 1)
            low = int(at)
            below = smallest(variances[i], count, low)
            above = smallest(variances[i], count, min(low + 1, count - 1))
            expected[w, i] = below + (at - low) * (above - below)
