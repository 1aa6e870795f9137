"""Dynamics of a floating tree with contacts at many samples, compiled; `stadera.body.tree` derives them.

All vectors are in trunk axes, wrenches are force above moment about the trunk's origin. A link's own columns are first
formed in its own axes, where its ten parameters φ are constant: with a, ω, α of its frame,

    F = m a + B h,    M = h x a + (L(α) + [ω]x L(ω)) I,    B = [α]x + ω ωᵀ - ω² 1,    I v = L(v) (Ixx, Ixy, ...)

A wrench w on link j needs the torque r_kᵀ w of each joint k between it and the trunk, r = [o x s ; s] for a joint at o
that turns about s and [s ; 0] for one that slides along it. So with E the trunk's wrench for a unit of joint torque, w
changes the trunk's rows by T_j w, where T_j = T_parent + E_j r_jᵀ and T = -1 of the trunk.
"""

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled, part
from stadera.types import Array, Bools

Ints = NDArray[np.int64]


Vector = tuple[float, float, float]


@part
def of(a: Array, k: int) -> Vector:
    """Row k of an array as a vector."""
    return a[k, 0], a[k, 1], a[k, 2]


@part
def put(a: Array, k: int, v: Vector) -> None:
    """Writes a vector into row k of an array."""
    a[k, 0], a[k, 1], a[k, 2] = v


@part
def plus(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@part
def times(s: float, a: Vector) -> Vector:
    """s a."""
    return s * a[0], s * a[1], s * a[2]


@part
def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@part
def rotated(R: Array, j: int, v: Vector) -> Vector:
    """R_j v."""
    return (
        R[j, 0, 0] * v[0] + R[j, 0, 1] * v[1] + R[j, 0, 2] * v[2],
        R[j, 1, 0] * v[0] + R[j, 1, 1] * v[1] + R[j, 1, 2] * v[2],
        R[j, 2, 0] * v[0] + R[j, 2, 1] * v[1] + R[j, 2, 2] * v[2],
    )


@part
def rotated_back(R: Array, j: int, v: Vector) -> Vector:
    """R_jᵀ v."""
    return (
        R[j, 0, 0] * v[0] + R[j, 1, 0] * v[1] + R[j, 2, 0] * v[2],
        R[j, 0, 1] * v[0] + R[j, 1, 1] * v[1] + R[j, 2, 1] * v[2],
        R[j, 0, 2] * v[0] + R[j, 1, 2] * v[1] + R[j, 2, 2] * v[2],
    )


@part
def set_trunk(n: int, R: Array, o: Array) -> None:
    """Writes the trunk's rotation and origin, at place n."""
    for i in range(3):
        o[n, i] = 0.0
        for j in range(3):
            R[n, i, j] = 1.0 if i == j else 0.0


@part
def turn_about(R: Array, parent: int, fixed: Array, j: int, axis: Vector, angle: float) -> None:
    """Writes R_j = R_parent B_j exp([axis]x angle), with exp([a]x q) = cos q 1 + sin q [a]x + (1 - cos q) a aᵀ."""
    s, c = sin(angle), cos(angle)
    for i in range(3):
        row = rotated_back(fixed, j, (R[parent, i, 0], R[parent, i, 1], R[parent, i, 2]))
        along = (1.0 - c) * (row[0] * axis[0] + row[1] * axis[1] + row[2] * axis[2])
        row = plus(plus(times(c, row), times(s, cross(row, axis))), times(along, axis))
        R[j, i, 0], R[j, i, 1], R[j, i, 2] = row


@part
def columns_of_link(a: Vector, omega: Vector, alpha: Vector, j: int, out: Array) -> None:
    """Writes the inertial wrench of link j as columns (6, 10) of its parameters, all in its own axes."""
    for c in range(6):
        for k in range(10):
            out[j, c, k] = 0.0
    square = omega[0] * omega[0] + omega[1] * omega[1] + omega[2] * omega[2]
    for i in range(3):
        out[j, i, 0] = a[i]
        for k in range(3):
            out[j, i, 1 + k] = omega[i] * omega[k]
        out[j, i, 1 + i] -= square
    for i, k, third in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # [v]x has -v_third at (i, k) and v_third at (k, i)
        out[j, i, 1 + k] -= alpha[third]
        out[j, k, 1 + i] += alpha[third]
        out[j, 3 + i, 1 + k] += a[third]
        out[j, 3 + k, 1 + i] -= a[third]
    for at, p, q in ((4, 0, 0), (5, 0, 1), (5, 1, 0), (6, 0, 2), (6, 2, 0), (7, 1, 1), (8, 1, 2), (8, 2, 1), (9, 2, 2)):
        # an entry at (p, q) of the inertia: e_p α_q + ω x e_p ω_q
        one, two = (p + 1) % 3, (p + 2) % 3
        out[j, 3 + p, at] += alpha[q]
        out[j, 3 + one, at] += omega[two] * omega[q]
        out[j, 3 + two, at] -= omega[one] * omega[q]


@part
def inverse(A: Array, out: Array) -> float:
    """Writes the inverse of a small matrix, which is overwritten, by Gauss and Jordan. Returns its determinant."""
    n, found = len(A), 1.0
    for i in range(n):
        for k in range(n):
            out[i, k] = 1.0 if i == k else 0.0
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[best, k]):
                best = i
        if best != k:
            found = -found
            for c in range(n):
                A[k, c], A[best, c] = A[best, c], A[k, c]
                out[k, c], out[best, c] = out[best, c], out[k, c]
        pivot = A[k, k]
        found *= pivot
        for c in range(n):
            A[k, c] /= pivot
            out[k, c] /= pivot
        for i in range(n):
            if i != k:
                share = A[i, k]
                for c in range(n):
                    A[i, c] -= share * A[k, c]
                    out[i, c] -= share * out[k, c]
    return found


@part
def least_squares(J: Array, square: Array, back: Array, out: Array) -> float:
    """Writes (Jᵀ J)⁻¹ Jᵀ of J (n, m), n > m, as `out` (m, n). Returns √(det Jᵀ J)."""
    n, m = J.shape
    for i in range(m):
        for k in range(m):
            square[i, k] = 0.0
            for c in range(n):
                square[i, k] += J[c, i] * J[c, k]
    found = sqrt(max(inverse(square, back), 0.0))
    for i in range(m):
        for k in range(n):
            out[i, k] = 0.0
            for c in range(m):
                out[i, k] += back[i, c] * J[k, c]
    return found


@part
def map_leg(
    joints: Ints,
    n: int,
    size: int,
    point: Vector,
    about: Vector,
    o: Array,
    s: Array,
    rooms: Array,
    at: int,
    leg: int,
    E: Array,
    unfelt: Array,
) -> float:
    """Writes E (joints, 6) of a leg's joints at sample `at`: the trunk's wrench for a unit of h - τ, from a contact at
    a point with `size` components. Returns det J, or √(det J Jᵀ) of a leg with more joints than that.

    Jᵀ has the rows s x (p - o) and, of a contact that transmits moments, s. With more joints than components the force
    is that of least squares, (J Jᵀ)⁻¹ J (h - τ). With one joint less a joint without mass at the contact completes
    J, that turns `about` an axis, or of a point foot slides along it; its own column of E, for a unit of the contact's
    moment about that axis or force along it, is written into `unfelt`. `rooms`: (4, n, n), scratch.
    """
    rows = max(n, size)
    J = rooms[0, :rows, :size]
    for k in range(n):
        j = joints[k]
        J[k, 0], J[k, 1], J[k, 2] = cross(of(s, j), plus(point, times(-1.0, of(o, j))))
        if size == 6:
            J[k, 3], J[k, 4], J[k, 5] = of(s, j)
    if n < size:
        for c in range(3):
            J[n, c] = 0.0
        J[n, size - 3], J[n, size - 2], J[n, size - 1] = about
    to_force = rooms[1, :size, :rows]
    if n <= size:
        volume = inverse(J, to_force)
    else:
        volume = least_squares(J, rooms[2, :size, :size], rooms[3, :size, :size], to_force)
    for c in range(6):
        unfelt[at, leg, c] = 0.0
    for k in range(rows):
        force = to_force[0, k], to_force[1, k], to_force[2, k]
        moment = cross(point, force)
        if size == 6:
            moment = plus(moment, (to_force[3, k], to_force[4, k], to_force[5, k]))
        if k < n:
            j = joints[k]
            E[at, j, 0], E[at, j, 1], E[at, j, 2] = force
            E[at, j, 3], E[at, j, 4], E[at, j, 5] = moment
        else:
            unfelt[at, leg, 0], unfelt[at, leg, 1], unfelt[at, leg, 2] = force
            unfelt[at, leg, 3], unfelt[at, leg, 4], unfelt[at, leg, 5] = moment
    return volume


@part
def next_link(
    parent: int,
    j: int,
    slides: bool,
    fixed: Array,
    arms: Array,
    axes: Array,
    state: Vector,
    R: Array,
    o: Array,
    s: Array,
    omega: Array,
    alpha: Array,
    a: Array,
) -> None:
    """Writes rotation, origin, axis, ω, α and specific force of link j, whose joint is in the `state` q, q̇, q̈:

        turning:  ω_j = ω + s q̇,   α_j = α + s q̈ + ω x s q̇,   a_j = a + α x r + ω x (ω x r)
        sliding:  ω_j = ω,         α_j = α,                    a_j = a + α x r + ω x (ω x r) + 2 ω x s q̇ + s q̈

    with ω, α, a of its parent and r from the parent's origin to its own.
    """
    q, rate, more = state
    turn_about(R, parent, fixed, j, of(axes, j), 0.0 if slides else q)
    here, arm, w, dw = rotated(R, j, of(axes, j)), rotated(R, parent, of(arms, j)), of(omega, parent), of(alpha, parent)
    if slides:
        arm = plus(arm, times(q, here))
    spin = times(rate, here)
    force = plus(of(a, parent), plus(cross(dw, arm), cross(w, cross(w, arm))))
    if slides:
        force = plus(force, plus(times(2.0, cross(w, spin)), times(more, here)))
    else:
        dw = plus(dw, plus(cross(w, spin), times(more, here)))
        w = plus(w, spin)
    put(o, j, plus(of(o, parent), arm))
    put(s, j, here)
    put(omega, j, w)
    put(alpha, j, dw)
    put(a, j, force)


@part
def across(o: Array, s: Array, j: int, slides: bool, out: Array) -> None:
    """Writes r (6,) of joint j, which needs the torque rᵀ w for a wrench w."""
    out[j, 0], out[j, 1], out[j, 2] = of(s, j) if slides else cross(of(o, j), of(s, j))
    out[j, 3], out[j, 4], out[j, 5] = (0.0, 0.0, 0.0) if slides else of(s, j)


@part
def own_columns(j: int, R: Array, omega: Array, alpha: Array, a: Array, out: Array) -> None:
    """Writes the columns of link j, (6, 10), in its own axes."""
    force, w, dw = (rotated_back(R, j, of(a, j)), rotated_back(R, j, of(omega, j)), rotated_back(R, j, of(alpha, j)))
    columns_of_link(force, w, dw, j, out)


@part
def wrench_of_link(j: int, own: Array, parameters: Array, R: Array, o: Array, out: Array) -> None:
    """Writes the inertial wrench of link j, about the trunk's origin."""
    for c in range(6):
        out[j, c] = 0.0
        for k in range(10):
            out[j, c] += own[j, c, k] * parameters[j, k]
    force = rotated(R, j, (out[j, 0], out[j, 1], out[j, 2]))
    moment = plus(rotated(R, j, (out[j, 3], out[j, 4], out[j, 5])), cross(of(o, j), force))
    out[j, 0], out[j, 1], out[j, 2] = force
    out[j, 3], out[j, 4], out[j, 5] = moment


@part
def carried(parents: Ints, r: Array, wrench: Array, at: int, torque: Array) -> None:
    """Writes the joints' torques at sample `at`, and adds to each link's wrench those of all links beyond it."""
    n = len(parents)
    for j in range(n - 1, -1, -1):
        torque[at, j] = 0.0
        for c in range(6):
            torque[at, j] += r[j, c] * wrench[j, c]
            if parents[j] < n:
                wrench[parents[j], c] += wrench[j, c]


@part
def in_link(row: Vector, moment: Vector, j: int, R: Array, o: Array) -> tuple[Vector, Vector]:
    """A row (force, moment) that acts on wrenches about the trunk's origin, as one that acts on those of link j in its
    own axes: row [R 0 ; [o]x R, R].
    """
    return rotated_back(R, j, plus(row, cross(moment, of(o, j)))), rotated_back(R, j, moment)


@part
def effect_of(T: Array, j: int, own: Array, R: Array, o: Array, at: int, out: Array) -> None:
    """Writes T_j times the columns of link j, as wrenches about the trunk's origin."""
    for i in range(6):
        force, moment = in_link((T[j, i, 0], T[j, i, 1], T[j, i, 2]), (T[j, i, 3], T[j, i, 4], T[j, i, 5]), j, R, o)
        for k in range(10):
            out[at, j, i, k] = 0.0
        for c in range(3):
            for k in range(10):
                out[at, j, i, k] += force[c] * own[j, c, k] + moment[c] * own[j, 3 + c, k]


@compiled(
    "void(int64[::1], float64[:,:,::1], float64[:,::1], float64[:,::1], boolean[::1], float64[:,::1], int64[::1], "
    "int64[:,::1], int64[::1], float64[:,::1], float64[:,::1], boolean[::1], float64[:,:,::1], float64[:,:,::1], "
    "float64[:,:,::1], float64[:,::1], float64[:,:,::1], float64[:,:,::1], float64[:,:,:,::1], float64[:,:,::1], "
    "float64[:,:,::1], float64[:,:,::1], float64[:,::1], float64[:,:,::1], float64[:,:,::1])"
)
def evaluate(
    parents: Ints,
    rotations: Array,
    arms: Array,
    axes: Array,
    slides: Bools,
    parameters: Array,
    leg_of: Ints,
    legs: Ints,
    sizes: Ints,
    points: Array,
    about: Array,
    bears: Bools,
    joints: Array,
    trunk: Array,
    offset: Array,
    torque: Array,
    inertial: Array,
    to_wrench: Array,
    columns: Array,
    unfelt: Array,
    feet: Array,
    pace: Array,
    volume: Array,
    origin: Array,
    axis: Array,
) -> None:
    """Fills the arrays of a `stadera.body.tree.State` at N samples of n joints and L legs.

    Args:
        parents: (n,), of each link; n for the trunk. rotations, arms, axes, slides, parameters: as of `Body`.
        leg_of: (n,), the leg of each joint; L for one outside the legs.
        legs: (L, most), joints of each leg, outwards, filled up with -1. sizes: (L,), components of their contacts.
        points: (L, 3) [m], centres of the feet, in the last link's axes, as `about`: (L, 3), see `map_leg`. bears:
            (L,), False for E = 0.
        joints: (N, n, 3), q, q̇, q̈. trunk: (N, 3, 3), ω, α and a. offset: (N, L, 3) [m], of the contacts from the feet.
        columns: (N, n, 6, 10), or (0, n, 6, 10) if they are not needed.
    """
    n, count, most = len(parents), len(legs), legs.shape[1]
    R, o, s = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 3))
    omega, alpha, a = np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 3))
    own, wrench, r, T = np.empty((n, 6, 10)), np.empty((n, 6)), np.empty((n, 6)), np.empty((n + 1, 6, 6))
    rooms, lengths = np.empty((4, max(most, 6), max(most, 6))), np.zeros(count, dtype=np.int64)
    for leg in range(count):
        while lengths[leg] < most and legs[leg, lengths[leg]] >= 0:
            lengths[leg] += 1
    set_trunk(n, R, o)
    for c in range(6):
        for d in range(6):
            T[n, c, d] = -1.0 if c == d else 0.0
    for at in range(len(joints)):
        for c in range(3):
            omega[n, c], alpha[n, c], a[n, c] = trunk[at, 0, c], trunk[at, 1, c], trunk[at, 2, c]
        for c in range(6):
            for leg in range(count + 1):
                inertial[at, leg, c] = 0.0
            for j in range(n):
                to_wrench[at, j, c] = 0.0
        for j in range(n):  # outwards: motion of the links, and their wrenches
            state = joints[at, j, 0], joints[at, j, 1], joints[at, j, 2]
            next_link(parents[j], j, slides[j], rotations, arms, axes, state, R, o, s, omega, alpha, a)
            own_columns(j, R, omega, alpha, a, own)
            across(o, s, j, slides[j], r)
            wrench_of_link(j, own, parameters, R, o, wrench)
            for c in range(6):
                inertial[at, leg_of[j], c] += wrench[j, c]
        carried(parents, r, wrench, at, torque)
        for leg in range(count):
            last = legs[leg, lengths[leg] - 1]
            foot = plus(of(o, last), rotated(R, last, of(points, leg)))
            contact = plus(foot, (offset[at, leg, 0], offset[at, leg, 1], offset[at, leg, 2]))
            free = rotated(R, last, of(about, leg))
            volume[at, leg] = map_leg(
                legs[leg], lengths[leg], sizes[leg], contact, free, o, s, rooms, at, leg, to_wrench, unfelt
            )
            speed = cross(of(omega, n), foot)
            for k in range(lengths[leg]):
                j = legs[leg, k]
                arm = cross(of(s, j), plus(foot, times(-1.0, of(o, j))))
                speed = plus(speed, times(joints[at, j, 1], arm))
                if not bears[leg]:
                    for c in range(6):
                        to_wrench[at, j, c] = 0.0
            for c in range(3):
                feet[at, leg, c], pace[at, leg, c] = foot[c], speed[c]
        for j in range(n):
            for c in range(3):
                origin[at, j, c], axis[at, j, c] = o[j, c], s[j, c]
            if len(columns):
                for c in range(6):
                    for d in range(6):
                        T[j, c, d] = T[parents[j], c, d] + to_wrench[at, j, c] * r[j, d]
                effect_of(T, j, own, R, o, at, columns)


@compiled(
    "void(int64[::1], float64[:,:,::1], float64[:,::1], float64[:,::1], float64[:,:,::1], float64[:,::1], "
    "int64[:,::1], float64[:,::1])"
)
def torque_columns(
    parents: Ints,
    rotations: Array,
    arms: Array,
    axes: Array,
    joints: Array,
    force: Array,
    picks: Ints,
    out: Array,
) -> None:
    """Derivatives of the torques of joints that turn, on a trunk that does not, by the parameters of links, rᵀ X_j.

    Args:
        parents, ..., joints: as of `evaluate`. force: (N, 3) or (1, 3) [m/s²], specific force of the trunk.
        picks: (k, 3), a joint; a link; and one of its ten parameters. Those of one joint and link follow each other.
        out: (k, N).
    """
    n = len(parents)
    R, o, s, own = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty((n, 6, 10))
    omega, alpha, a, r = np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.empty((n + 1, 3)), np.empty((n, 6))
    set_trunk(n, R, o)
    for at in range(len(joints)):
        if at < len(force):
            put(a, n, of(force, at))
        for j in range(n):
            state = joints[at, j, 0], joints[at, j, 1], joints[at, j, 2]
            next_link(parents[j], j, False, rotations, arms, axes, state, R, o, s, omega, alpha, a)
            own_columns(j, R, omega, alpha, a, own)
            across(o, s, j, False, r)
        along = about = (0.0, 0.0, 0.0)
        for p in range(len(picks)):
            k, j, c = picks[p, 0], picks[p, 1], picks[p, 2]
            if p == 0 or k != picks[p - 1, 0] or j != picks[p - 1, 1]:
                along, about = in_link((r[k, 0], r[k, 1], r[k, 2]), (r[k, 3], r[k, 4], r[k, 5]), j, R, o)
            value = 0.0
            for d in range(3):
                value += along[d] * own[j, d, c] + about[d] * own[j, 3 + d, c]
            out[p, at] = value
