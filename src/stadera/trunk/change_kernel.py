"""Averages over the latest blocks, compiled: the parts of `stadera.trunk.changes` that run at each block."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled, part, reordered
from stadera.types import Array

DEVIATION = 1.5  # standard deviation over the median absolute deviation, of Gaussian values


@reordered
def mean_of(solution: Array, errors: Array, out: Array) -> None:
    """θ̂ (10,) = R⁻¹ z - K p, of p whose first entries are `errors` and whose others are zero."""
    for i in range(len(out)):
        value, row = solution[i, 0], solution[i, 1:]
        for e in range(len(errors)):
            value -= row[e] * errors[e]
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
def clipped_mean(squares: Array, n: int, limit: float, work: Array) -> float:
    """Mean of the first n squares, clipped at a multiple of their median."""
    for k in range(n):
        work[k] = squares[k]
    limit = limit * middle(work, n)
    total = 0.0
    for k in range(n):
        total += min(squares[k], limit)
    return total / n


@part
def quantile(values: Array, n: int, share: float) -> float:
    """The quantile of the first n values, linear between two of them, which are sorted partly."""
    at = share * (n - 1)
    low = int(at)
    below = smallest(values, n, low)
    return below + (at - low) * (smallest(values, n, min(low + 1, n - 1)) - below)


@part
def single(reduced: Array, i: int, mean: Array, scale: Array) -> float:
    """One block's own difference in component i, in units of `scale`."""
    left: float = reduced[i, 10]
    for c in range(10):
        left -= reduced[i, c] * mean[c]
    return float(left / (max(reduced[i, 11], 1e-12) * scale[i]))


@part
def differences(reduced: Array, mean: Array, scale: Array, out: Array) -> None:
    """Single blocks' own differences (4, n), in units of `scale`, of n reduced rows."""
    for k in range(len(reduced)):
        for i in range(4):
            out[i, k] = single(reduced[k], i, mean, scale)


@part
def huber(values: Array, rows: Array, component: int, near: float, heaviest: float, work: Array) -> tuple[float, float]:
    """Weighted mean of values (n,) clipped about their median, and its weight; the weights are those of reduced rows
    (n, 4, 12), limited to the heaviest.
    """
    n, total, weight = len(values), 0.0, 0.0
    for k in range(n):
        work[k] = values[k]
    centre = smallest(work, n, n // 2)
    for k in range(n):
        own = min(rows[k, component, 11], heaviest)
        total += min(max(values[k], centre - near), centre + near) * own
        weight += own
    return total / max(weight, 1e-12), max(weight, 1e-12)


@part
def significance(size: Array, variance: Array, least: float, long: bool) -> tuple[float, bool]:
    """Standard deviations of the largest component of δ, and whether one exceeds the least change; those that do not
    count in long averages only, and only where none does.
    """
    reported, ratio = False, 0.0
    for i in range(4):
        reported |= abs(size[i]) > least
    for i in range(4):
        if abs(size[i]) > least or (long and not reported):
            ratio = max(ratio, abs(size[i]) / sqrt(variance[i]))
    return ratio, reported


@part
def look_back(
    reduced: Array,
    sums: Array,
    end: int,
    windows: NDArray[np.int64],
    first: int,
    stop: int,
    inverse: Array,
    solution: Array,
    errors: Array,
    std: Array,
    scale: Array,
    blocks: Array,
    square: Array,
    usual: Array,
    student: Array,
    scatter: float,
    limits: Array,
    best: float,
    out: Array,
) -> float:
    """The largest deviation from one earlier estimate over a range of windows, from `first` to before `stop`, if it
    exceeds `best`: arguments and result as of `largest`.
    """
    if stop <= first:
        return best
    longest = windows[stop - 1]
    mean, before, size, variance, own = np.empty(10), np.zeros(4), np.empty(4), np.empty(4), np.empty(4)
    past = max(limits[3], 1.0)
    values, work, latest, weight_at = np.empty((4, longest)), np.empty(longest), sums[end], sums.shape[2] - 1
    mean_of(solution, errors, mean)
    differences(reduced[end - longest : end], mean, scale, values)
    for i in range(4):
        for c in range(10):
            before[i] += scatter * (inverse[i, c] / scale[i]) ** 2
    for w in range(first, stop):
        n = windows[w]
        earlier, rows = sums[end - n], reduced[end - n : end]
        for i in range(4):
            size[i], weight = huber(values[i, longest - n :], rows, i, blocks[0, i], blocks[2, i], work)
            size[i] -= blocks[1, i]
            own[i] = 1.0 / (weight * scale[i] ** 2)
            variance[i] = max(square[w, i], own[i]) + max(before[i], n / past * square[w, i])
        ratio, reported = significance(size, variance, limits[0], 3 * n > limits[1])
        if ratio * student[w] <= best:
            continue  # model errors only add to the variance
        for i in range(4):
            weight = max(latest[i, weight_at] - earlier[i, weight_at], 1e-12)
            by_model = by_errors(earlier[i], latest[i], min(i, 1), solution, std) / (weight * scale[i]) ** 2
            spread = square[w, i] + max(by_model - usual[w, i], 0.0)
            variance[i] = max(spread, own[i]) + max(before[i], n / past * square[w, i])
        ratio, reported = significance(size, variance, limits[0], 3 * n > limits[1])
        if ratio * student[w] > best:
            best = ratio * student[w]
            out[0, 0], out[0, 1] = n, 1.0 if reported else 0.0
            for i in range(4):
                out[1, i], out[2, i] = size[i], variance[i]
    return best


@part
def reduced_rows(rows: Array, reduced: Array, errors: Array, begin: int, end: int) -> None:
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
    """Adds a block's rows (6, 10 + 1 + errors), projected as in `Blocks`, to the running sums, writes
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
    for i in range(1, 4):
        projected[i, width] = x * x + y * y + z * z
    for i in range(4):
        for k in range(kept):
            rows[at, i, k] = projected[i, k]
        rows[at, i, kept] = projected[i, width]
        for k in range(width + 1):
            sums[at + 1, i, k] = sums[at, i, k] + projected[i, k]
    reduced_rows(rows, reduced, errors, at, at + 1)


@compiled("void(float64[:,:,::1], float64[:,:,::1], float64[::1], int64, int64)")
def reduce(rows: Array, reduced: Array, errors: Array, begin: int, end: int) -> None:
    """`reduced_rows`, for errors that have changed."""
    reduced_rows(rows, reduced, errors, begin, end)


@compiled(
    "float64(float64[:,:,::1], float64[:,:,::1], int64, int64[::1], int64, int64, float64[:,::1], float64[:,::1], "
    "float64[:,::1], float64[:,::1], float64[::1], float64[::1], float64[::1], float64[:,::1], "
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
    blocks: Array,
    square: Array,
    usual: Array,
    student: Array,
    scatter: float,
    limits: Array,
    out: Array,
) -> float:
    """The deviation with most standard deviations, as `ChangeDetector._best`. Returns its ratio.

    Args:
        reduced, sums: of all blocks, of which the last is before `end`.
        windows: numbers of blocks. short, long: how many of the short ones are looked at, from the first, and up to
            where the long ones are, from the first long one at `limits[2]`.
        inverse, solution: of the estimate without the latest blocks; `long_`: without twice as many.
        errors: (k,), first entries of p; the others are zero. std: of model errors.
        scale: (4,), units. blocks: (3, 4), what is usual for single blocks: Huber's limit, Huber mean, largest weight.
        square, usual: (windows, 4). student: (windows,).
        limits: least change, pending blocks, number of short windows, number of past blocks.
        out: (3, 4), blocks and whether to report; δ; variance.
    """
    for i in range(3):
        for k in range(4):
            out[i, k] = 1.0 if i == 2 else 0.0
    shared = std, scale, blocks, square, usual, student, scatter, limits
    best = look_back(reduced, sums, end, windows, 0, short, inverse, solution, errors, *shared, -1.0, out)
    first = int(limits[2])
    best = look_back(reduced, sums, end, windows, first, long, long_inverse, long_solution, errors, *shared, best, out)
    return max(best, 0.0)


@part
def of_singles(
    reduced: Array, i: int, mean: Array, scale: Array, outlier: float, work: Array, usual: Array, running: Array
) -> None:
    """Writes what is `usual` (3,) for component i of single blocks, and running sums (n + 1, 2) of their clipped
    differences times weight and of the weight; arguments as of `spreads`.
    """
    n = len(reduced)
    singles = np.empty(n)
    for k in range(n):
        singles[k] = work[k] = single(reduced[k], i, mean, scale)
    centre = middle(work, n)
    for k in range(n):
        work[k] = abs(singles[k] - centre)
    usual[0] = max(DEVIATION * middle(work, n), 1e-6)
    for k in range(n):
        work[k] = reduced[k, i, 11]
    heaviest = usual[2] = middle(work, n)
    low, high = centre - outlier * usual[0], centre + outlier * usual[0]
    for k in range(n):
        weight = min(reduced[k, i, 11], heaviest)
        running[k + 1, 0] = running[k, 0] + min(max(singles[k], low), high) * weight
        running[k + 1, 1] = running[k, 1] + weight
    usual[1] = running[n, 0] / max(running[n, 1], 1e-12)


@compiled(
    "void(float64[:,:,::1], float64[:,:,::1], int64, int64, float64, int64[::1], float64[::1], float64[:,::1], "
    "float64[::1], float64[::1], float64, float64, float64[:,::1], float64[:,::1], float64[:,::1], int64[::1])"
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
    clipped: float,
    usual: Array,
    square: Array,
    expected: Array,
    counts: NDArray[np.int64],
) -> None:
    """Mean squares of past averages and their usual variance due to model errors, as `ChangeDetector.learn`.

    Args:
        reduced, sums: of all blocks. begin: index of the first block, n: number of blocks.
        share: of the variances due to model errors that `expected` exceeds.
        mean, solution: of the estimate. std: of model errors. scale: (4,). outlier: Huber's limit.
        clipped: multiple of the median at which squares of averages are clipped.
        usual: (3, 4), written: of single blocks, scatter, Huber mean, largest weight.
        square, expected: (windows, 4), written; counts: (windows,), of averages.
    """
    running, work = np.zeros((n + 1, 4, 2)), np.empty(n)
    for i in range(4):
        of_singles(reduced[begin : begin + n], i, mean, scale, outlier, work, usual[:, i], running[:, i])
    weight_at = sums.shape[2] - 1
    squares, variances = np.empty((4, n)), np.empty((4, n))
    for w in range(len(windows)):
        m, count = windows[w], 0
        for first in range(0, n - m, max(m // 2, 1)):
            for i in range(4):
                near_sum = running[first + m, i, 0] - running[first, i, 0]
                weight = max(running[first + m, i, 1] - running[first, i, 1], 1e-12)
                squares[i, count] = (near_sum / weight - usual[1, i]) ** 2
                before, after = sums[begin + first, i], sums[begin + first + m, i]
                weight = max(after[weight_at] - before[weight_at], 1e-12) * scale[i]
                variances[i, count] = by_errors(before, after, min(i, 1), solution, std) / weight**2
            count += 1
        counts[w] = count
        if count == 0:
            continue
        for i in range(4):
            square[w, i] = clipped_mean(squares[i], count, clipped, work)
            expected[w, i] = quantile(variances[i], count, share)
