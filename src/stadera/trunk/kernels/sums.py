"""Sums of rows, compiled: what `stadera.trunk.segment` does by LAPACK for ten unknowns."""

from __future__ import annotations

from math import copysign, sqrt

import numpy as np

from stadera.compiled import compiled
from stadera.types import Array


@compiled("float64(float64[:,::1], float64[:,::1], float64, float64[:,::1])")
def fold(triangle: Array, rows: Array, root: float, out: Array) -> float:
    """Adds rows [A b C] to a triangle [R z G] that is first multiplied by `root`, by Householder reflections.

    Args:
        triangle: (10, 10 + 1 + errors). rows: (n, 10 + 1 + errors). out: as `triangle`, the sum.

    Returns:
        What the rows add to the sum of squares that no unknown explains.
    """
    n, unknowns, width = len(rows), len(triangle), triangle.shape[1]
    left, along = rows.copy(), np.empty(width)
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
    cost = 0.0
    for i in range(n):
        cost += left[i, unknowns] ** 2
    return cost


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
