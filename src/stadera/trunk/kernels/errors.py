"""Mean and covariance of the model errors, compiled: `Errors`, `Covariance.explained` and `SwingJoints.posterior`.

Loops go over whole rows, also where a triangle would do: these are done several columns at once.
"""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled, part, reordered
from stadera.types import Array, Bools

_SINGULAR = 1e-13  # of a variance: what remains of it is rounding


@part
def product(A: Array, B: Array, out: Array) -> None:
    """A B, by BLAS."""
    np.dot(A, B, out)


@part
def product_of_rows(A: Array, B: Array, out: Array) -> None:
    """A Bᵀ, by BLAS."""
    np.dot(A, B.T, out)


@part
def columns_of(A: Array, begin: int, width: int) -> Array:
    """A copy of some columns."""
    out = np.empty((len(A), width))
    for i in range(len(A)):
        for c in range(width):
            out[i, c] = A[i, begin + c]
    return out


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
def eliminate(A: Array, least: float) -> None:
    """Upper triangular factor U of a positive semidefinite matrix Uᵀ U, in its place, with zeros below. Pivots up to
    `least` are taken for zero.
    """
    for k in range(len(A)):
        row = A[k]
        without(A, k, A, row)
        pivot = 1.0 / sqrt(row[k]) if row[k] > least else 0.0
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
        eliminate(information, 0.0)
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


@part
def residual_variance(mean: Array, remainder: Array, known: int, blocks: float, along: Array) -> float:
    """Mean square of the rows' residual. Writes the products (known,) of the residual and the first errors."""
    square = remainder[0, 0]
    for i in range(known):
        along[i] = remainder[0, 1 + i]
    for e in range(known):
        for i in range(known):
            along[i] -= remainder[1 + e, 1 + i] * mean[e]
    for i in range(known):
        square -= (remainder[0, 1 + i] + along[i]) * mean[i]
    return float(square / (6.0 * blocks))


@part
def combined(joints: Array, normal: Array, out: Array) -> None:
    """(P⁻¹ + N)⁻¹ of the first rows and columns of two matrices; P may be singular.

    With P = Uᵀ U it is Uᵀ (1 + U N Uᵀ)⁻¹ U.
    """
    k = len(out)
    size, U, N, turned, system = np.empty(k), np.empty((k, k)), np.empty((k, k)), np.empty((k, k)), np.empty((k, k))
    for i in range(k):
        size[i] = sqrt(joints[i, i])
    for i in range(k):
        for j in range(k):
            unit = size[i] * size[j]
            U[i, j], N[i, j] = joints[i, j] / unit if unit > 0.0 else 0.0, normal[i, j] * unit
    eliminate(U, _SINGULAR)
    product(U, N, turned)
    product_of_rows(turned, U, system)
    for i in range(k):
        system[i, i] += 1.0
    eliminate(system, 0.0)
    divide(system, U)
    square_of(U, out)
    for i in range(k):
        for j in range(k):
            out[i, j] *= size[i] * size[j]


@part
def hold(variance: Array, shown: Array, sticking: Array, std: Array, begin: int) -> None:
    """`Covariance.held`, in place, of static friction from place `begin` on."""
    held = len(std)
    for j in range(held):
        std[j] /= max(sqrt(variance[begin + j]), 1e-300)
        variance[begin + j] *= std[j] ** 2
        for i in range(len(shown)):
            shown[i, begin + j] *= std[j]
    for i in range(held):
        for j in range(held):
            sticking[i, j] *= std[i] * std[j]


@part
def spread_rows(normal: Array, joints: Array, sticking: Array, variance: Array, begin: int, out: Array) -> None:
    """Products of rows (k, n) with Σ before loaded rows: of joints, static friction and variances."""
    (k, n), known, held = normal.shape, len(joints), len(sticking)
    by_joints, by_sticking = np.empty((k, known)), np.empty((k, held))
    product(columns_of(normal, 0, known), joints, by_joints)
    product(columns_of(normal, begin, held), sticking, by_sticking)
    for i in range(k):
        for e in range(known, n):
            out[i, e] = normal[i, e] * variance[e]
        for e in range(known):
            out[i, e] = by_joints[i, e]
        for e in range(held):
            out[i, begin + e] = by_sticking[i, e]


@part
def learn(S: Array, normal: Array, joints: Array, sticking: Array, variance: Array, begin: int, shown: Array) -> None:
    """Σ' = F Σ Fᵀ + S N S, F = 1 - S N, of `RowSums`: writes the rows `shown`, and updates joints and variance."""
    (k, n), known = shown.shape, len(joints)
    spread, moved, together = np.empty((k, n)), np.empty((k, n)), np.empty((k, k))  # N Σ, S N Σ, N Σ Nᵀ + N
    spread_rows(normal, joints, sticking, variance, begin, spread)
    product(S, spread, moved)
    product_of_rows(spread, normal, together)
    for i in range(k):
        for j in range(k):
            together[i, j] += normal[i, j]
        for e in range(n):
            shown[i, e] = -moved[i, e]
        for e in range(known):
            shown[i, e] += joints[i, e]
    half, own = np.empty((k, k)), np.empty((k, k))
    product(S, together, half)
    product(half, S, own)
    for i in range(k):
        for j in range(k):
            own[i, j] += joints[i, j] - moved[i, j] - moved[j, i]
    for i in range(k):
        for j in range(k):
            shown[i, j] = 0.5 * (own[i, j] + own[j, i])
        for e in range(known):
            joints[i, e] = joints[e, i] = shown[i, e]
        variance[i] = shown[i, i]


@compiled(
    "void(float64[::1], float64[:,::1], float64[:,::1], float64[::1], float64[:,::1], float64[::1], float64[:,::1], "
    "float64[:,::1], float64[::1], int64, int64)"
)
def update(
    mean: Array,
    joints: Array,
    sticking: Array,
    variance: Array,
    shown: Array,
    std: Array,
    remainder: Array,
    friction: Array,
    numbers: Array,
    coulomb: int,
    begin: int,
) -> None:
    """Mean (n,) and covariance of the errors, as `Errors`.

    Args:
        mean, joints, sticking, variance: of p and Σ before any loaded row, but for the variance of those in `joints`;
            updated.
        shown: see `Covariance`, std: (n,), both written.
        remainder: (1 + n, 1 + n), of the rows.
        friction: (2, 12), Coulomb friction that the model has; variance of its error, negative for that found here.
        numbers: of blocks; `RowSums.repeated`; the least variance of the residual; `ModelErrors.held`.
        coulomb, begin: first places of Coulomb and of static friction.
    """
    (k, n), known = shown.shape, len(joints)
    for e in range(known):
        variance[e] = joints[e, e]
    along, normal, S = np.empty(known), np.empty((k, n)), np.empty((k, k))
    loud = numbers[1] * max(residual_variance(mean, remainder, known, numbers[0], along), numbers[2])
    for i in range(k):
        for e in range(n):
            normal[i, e] = remainder[1 + i, 1 + e] / loud
    combined(joints, normal, S)
    for i in range(k):
        for j in range(k):
            mean[i] += S[i, j] * along[j] / loud
    learn(S, normal, joints, sticking, variance, begin, shown)
    size = np.empty(friction.shape[1])
    for j in range(len(size)):
        found = friction[1, j] < 0.0
        square = (friction[0, j] + (mean[coulomb + j] if found else 0.0)) ** 2
        square += variance[coulomb + j] if found else friction[1, j]
        size[j] = numbers[3] * sqrt(square)
    hold(variance, shown, sticking, size, begin)
    for e in range(n):
        std[e] = sqrt(variance[e])


@part
def write_diagonal(variance: Array, known: int, at: int, begin: int, out: Array) -> None:
    """Writes variances but for the first errors and the blocks of offsets and static friction, into (1 + n,)."""
    for e in range(known, len(variance)):
        if e >= at + 12 and not begin <= e < begin + 12:
            out[1 + e] = variance[e]


@part
def block_of(joints: Array, at: int) -> Array:
    """The block (12, 12) of offsets."""
    return columns_of(joints[at : at + 12], at, 12)


@part
def by_blocks(rows: Array, diagonal: Array, offsets: Array, sticking: Array, at: int, begin: int, out: Array) -> None:
    """Product of rows (m, 1 + n), whose first entries do not count, with Λ: see `energies`."""
    one, two = np.empty((len(rows), 12)), np.empty((len(rows), 12))
    product(columns_of(rows, 1 + at, 12), offsets, one)
    product(columns_of(rows, 1 + begin, 12), sticking, two)
    for i in range(len(rows)):
        row, to = rows[i], out[i]
        for e in range(len(row)):
            to[e] = row[e] * diagonal[e]
        for j in range(12):
            to[1 + at + j], to[1 + begin + j] = one[i, j], two[i, j]


@compiled(
    "float64(float64[:,::1], float64[:,::1], float64[:,::1], float64[::1], float64[:,::1], float64[:,::1], int64, "
    "int64, float64[::1])"
)
def energies(
    D: Array,
    wide: Array,
    through: Array,
    variance: Array,
    joints: Array,
    sticking: Array,
    at: int,
    begin: int,
    out: Array,
) -> float:
    """tr (D Σ)², as `Covariance.explained`.

    Σ = Λ + E W + Wᵀ Eᵀ, with Λ zero but for variances and the blocks of offsets and static friction, W the rows of
    `shown` with half their first block, and E the first columns of a unit matrix. So with B = W D

        tr (D Σ)² = tr (D Λ)² + 4 tr B Λ D E + 2 tr (B E)² + 2 tr B Wᵀ Eᵀ D E

    Args:
        D: (1 + n, 1 + n), of which the first row and column do not count. wide: (k, 1 + n), W. through: (k, 1 + n), B.
        variance, joints, sticking: see `Covariance`.
        at, begin: first places of offsets and static friction.
        out: (n,), the diagonal of D Σ.
    """
    k, n = len(wide), len(variance)
    diagonal, offsets, weighted = np.zeros(1 + n), block_of(joints, at), np.empty((1 + n, 1 + n))
    write_diagonal(variance, k, at, begin, diagonal)
    by_blocks(D, diagonal, offsets, sticking, at, begin, weighted)
    squares = 0.0
    for e in range(1, 1 + n):
        out[e - 1] = weighted[e, e]
        squares += diagonal[e] * dot(D[e], weighted[e])
    for i in range(12):
        for j in range(12):
            squares += offsets[i, j] * dot(D[1 + at + i], weighted[1 + at + j])
            squares += sticking[i, j] * dot(D[1 + begin + i], weighted[1 + begin + j])
    inner = np.empty((k, k))
    product_of_rows(wide, through, inner)
    for i in range(k):
        out[i] += through[i, 1 + i]
        for e in range(n):
            out[e] += wide[i, 1 + e] * D[1 + i, 1 + e]
        squares += 4.0 * dot(through[i], weighted[1 + i])
    for i in range(k):
        for j in range(i + 1):
            both = 2.0 * (inner[i, j] * D[1 + i, 1 + j] + through[i, 1 + j] * through[j, 1 + i])
            squares += both if i == j else 2.0 * both
    return squares


@part
def of_motion(moments: Array, sticking: Array, by_force: Array, out: Array) -> None:
    """`RowMoments.follows_motion`, given the rows' derivatives (10, 18) by the specific force, by row and axis."""
    if moments[0] == 0.0:
        out[:] = 0.0
        return
    weight, left, error = moments[0], np.zeros((6, 12)), np.zeros((6, 6))
    for i in range(6):
        for j in range(12):
            for k in range(12):
                left[i, j] += moments[13 + 12 * i + k] / weight * sticking[k, j]
    for i in range(6):
        for j in range(6):
            for k in range(12):
                error[i, j] += left[i, k] * moments[13 + 12 * j + k] / weight
    spread, moved = np.empty((18, 18)), np.empty((10, 18))
    for u in range(3):
        for v in range(3):
            about = moments[4 + 3 * u + v] / weight - moments[1 + u] * moments[1 + v] / weight**2
            for i in range(6):
                for j in range(6):
                    spread[3 * i + u, 3 * j + v] = weight**2 / 3.0 * error[i, j] * about
    product(by_force, spread, moved)
    product_of_rows(moved, by_force, out)


@compiled(
    "void(float64[:,::1], float64[:,::1], float64[::1], float64[:,::1], float64[:,::1], float64[:,::1], float64[::1], "
    "float64[:,::1], float64, int64, int64, float64[:,::1])"
)
def trunk_covariance(
    inverse: Array,
    solution: Array,
    moments: Array,
    by_force: Array,
    joints: Array,
    sticking: Array,
    variance: Array,
    shown: Array,
    scatter: float,
    at: int,
    begin: int,
    out: Array,
) -> None:
    """Covariance of the trunk's parameters, (10, 10), written, as `Errors.trunk_covariance`.

    Args:
        inverse, solution, moments: of a `Segment`. by_force: see `of_motion`.
        joints, sticking, variance, shown: see `Covariance`. scatter: κ.
        at, begin: first places of offsets and static friction.
    """
    (k, n), size = shown.shape, len(out)
    P, F, half, turned = np.empty((size, size)), np.empty((size, size)), np.empty((size, size)), np.empty((size, n))
    product_of_rows(inverse, inverse, P)
    of_motion(moments, sticking, by_force, F)
    product(P, F, half)
    product(half, P, out)
    K, wide, diagonal = columns_of(solution, 1, n), shown.copy(), np.zeros(1 + n)
    for i in range(k):
        for j in range(k):
            wide[i, j] *= 0.5
    product(columns_of(solution, 1, k), wide, turned)
    product_of_rows(turned, K, half)
    write_diagonal(variance, k, at, begin, diagonal)
    offsets, weighted = block_of(joints, at), np.empty((size, 1 + n))
    by_blocks(solution, diagonal, offsets, sticking, at, begin, weighted)
    for i in range(size):
        for j in range(size):
            out[i, j] += scatter * P[i, j] + half[i, j] + half[j, i] + dot(weighted[i], solution[j])


@compiled("void(float64[:,::1], float64, float64[:,::1])")
def add_scaled(total: Array, scale: float, known: Array) -> None:
    """Adds a multiple of a matrix to another one, in one pass."""
    for i in range(len(total)):
        to, row = total[i], known[i]
        for c in range(len(to)):
            to[c] += scale * row[c]
