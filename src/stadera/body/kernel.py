"""Dynamics of a floating tree with contacts at many samples, compiled. `stadera.body.tree` says what it computes and why.

All vectors are in trunk axes, wrenches are force above moment about the trunk's origin. A link's own columns are first
formed in its own axes, where its ten parameters φ are constant: with a, ω, α of its frame,

    F = m a + B h,    M = h x a + (L(α) + [ω]x L(ω)) I,    B = [α]x + ω ωᵀ - ω² 1,    I v = L(v) (Ixx, Ixy, ...)

A wrench w on link j needs the torque r_kᵀ w of each joint k between it and the trunk, r = [o x s ; s] for a joint at o
that turns about s and [s ; 0] for one that slides along it. So with E the trunk's wrench for a unit of joint torque, w
changes the trunk's rows by T_j w, where T_j = T_parent + E_j r_jᵀ and T = -1 of the trunk.
"""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled, part
from stadera.types import Array, Bools

Ints = NDArray[np.int64]


@part
def cross(a: Array, b: Array, out: Array) -> None:
    """Writes a x b."""
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@part
def dot(a: Array, b: Array) -> float:
    """a · b."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@part
def rotate(R: Array, v: Array, out: Array) -> None:
    """Writes R v."""
    for i in range(3):
        out[i] = R[i, 0] * v[0] + R[i, 1] * v[1] + R[i, 2] * v[2]


@part
def rotate_back(R: Array, v: Array, out: Array) -> None:
    """Writes Rᵀ v."""
    for i in range(3):
        out[i] = R[0, i] * v[0] + R[1, i] * v[1] + R[2, i] * v[2]


@part
def turn_about(before: Array, fixed: Array, axis: Array, angle: float, out: Array) -> None:
    """Writes B R exp([axis]x angle) of rotations B and R: cos 1 + sin [a]x + (1 - cos) a aᵀ (Rodrigues)."""
    s, c, whole = sin(angle), cos(angle), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                whole[i, j] += before[i, k] * fixed[k, j]
    x, y, z = axis
    for i in range(3):
        u, v, w = whole[i]
        along = (1.0 - c) * (u * x + v * y + w * z)  # (row x axis) sin + row cos + axis (row · axis) (1 - cos)
        out[i, 0] = c * u + s * (v * z - w * y) + along * x
        out[i, 1] = c * v + s * (w * x - u * z) + along * y
        out[i, 2] = c * w + s * (u * y - v * x) + along * z


@part
def columns_of_link(a: Array, omega: Array, alpha: Array, out: Array) -> None:
    """Writes the inertial wrench of a link as columns (6, 10) of its parameters, all in its own axes."""
    out[:] = 0.0
    square = dot(omega, omega)
    for i in range(3):
        out[i, 0] = a[i]
        for j in range(3):
            out[i, 1 + j] = omega[i] * omega[j]
        out[i, 1 + i] -= square
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # [v]x has -v_k at (i, j) and v_k at (j, i)
        out[i, 1 + j] -= alpha[k]
        out[j, 1 + i] += alpha[k]
        out[3 + i, 1 + j] += a[k]
        out[3 + j, 1 + i] -= a[k]
    at = 4
    for i in range(3):
        for j in range(i, 3):
            for v in range(2 if i != j else 1):
                p, q = (i, j) if v == 0 else (j, i)  # I has an entry at (p, q): e_p α_q + ω x e_p ω_q
                one, two = (p + 1) % 3, (p + 2) % 3
                out[3 + p, at] += alpha[q]
                out[3 + one, at] += omega[two] * omega[q]
                out[3 + two, at] -= omega[one] * omega[q]
            at += 1


@part
def next_link(
    parent: int,
    j: int,
    fixed: Array,
    arm: Array,
    axis: Array,
    slides: bool,
    state: Array,
    R: Array,
    o: Array,
    s: Array,
    omega: Array,
    alpha: Array,
    a: Array,
) -> None:
    """Writes rotation, origin, axis, angular velocity, angular acceleration and specific force of link j, whose joint
    is in the `state` q, q̇, q̈, from those of its parent; the trunk's come last.
    """
    q, rate, more = state
    r, spin, u, v = np.empty(3), np.zeros(3), np.empty(3), np.empty(3)
    if slides:
        turn_about(R[parent], fixed, axis, 0.0, R[j])
    else:
        turn_about(R[parent], fixed, axis, q, R[j])
    rotate(R[parent], arm, r)
    rotate(R[j], axis, s[j])
    if slides:
        for c in range(3):
            r[c] += q * s[j, c]
    cross(omega[parent], r, u)
    cross(omega[parent], u, v)  # ω x (ω x r)
    cross(alpha[parent], r, u)
    for c in range(3):
        o[j, c], a[j, c] = o[parent, c] + r[c], a[parent, c] + u[c] + v[c]
        spin[c] = rate * s[j, c]
    cross(omega[parent], spin, u)
    for c in range(3):
        if slides:
            omega[j, c], alpha[j, c] = omega[parent, c], alpha[parent, c]
            a[j, c] += 2.0 * u[c] + more * s[j, c]
        else:
            omega[j, c] = omega[parent, c] + spin[c]
            alpha[j, c] = alpha[parent, c] + u[c] + more * s[j, c]


@part
def inverse(A: Array, out: Array) -> float:
    """Writes the inverse of a small matrix, which is overwritten, by Gauss and Jordan. Returns its determinant."""
    n, found = len(A), 1.0
    out[:] = 0.0
    for i in range(n):
        out[i, i] = 1.0
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[best, k]):
                best = i
        if best != k:
            found = -found
            for j in range(n):
                A[k, j], A[best, j] = A[best, j], A[k, j]
                out[k, j], out[best, j] = out[best, j], out[k, j]
        pivot = A[k, k]
        found *= pivot
        for j in range(n):
            A[k, j] /= pivot
            out[k, j] /= pivot
        for i in range(n):
            if i != k:
                share = A[i, k]
                for j in range(n):
                    A[i, j] -= share * A[k, j]
                    out[i, j] -= share * out[k, j]
    return found


@part
def map_leg(joints: Ints, size: int, point: Array, o: Array, s: Array, E: Array) -> float:
    """Writes E (joints, 6) of a leg's joints: the trunk's wrench for a unit of h - τ, from a contact at a point with
    `size` components. Returns det J, or √(det J Jᵀ) of a leg with more joints than that.

    J has the rows s x (p - o) and, of a contact that transmits moments, s. With more joints than components the force
    is that of least squares, (J Jᵀ)⁻¹ J (h - τ).
    """
    n, u, v = len(joints), np.empty(3), np.empty(3)
    J = np.empty((n, size))
    for k in range(n):
        j = joints[k]
        for c in range(3):
            u[c] = point[c] - o[j, c]
        cross(s[j], u, v)
        for c in range(3):
            J[k, c] = v[c]
            if size == 6:
                J[k, 3 + c] = s[j, c]
    to_force, square = np.zeros((size, n)), np.zeros((size, size))
    if n == size:
        volume = inverse(J, to_force)
    else:
        for i in range(size):
            for k in range(size):
                for l in range(n):
                    square[i, k] += J[l, i] * J[l, k]
        back = np.empty((size, size))
        volume = sqrt(max(inverse(square, back), 0.0))
        for i in range(size):
            for k in range(n):
                for l in range(size):
                    to_force[i, k] += back[i, l] * J[k, l]
    for k in range(n):
        for c in range(3):
            u[c] = E[joints[k], c] = to_force[c, k]
        cross(point, u, v)
        for c in range(3):
            E[joints[k], 3 + c] = v[c] + (to_force[3 + c, k] if size == 6 else 0.0)
    return volume


@part
def across(o: Array, s: Array, slides: bool, out: Array) -> None:
    """Writes r (6,) of a joint, which needs the torque rᵀ w for a wrench w."""
    if slides:
        out[:3] = s
        out[3:] = 0.0
    else:
        cross(o, s, out[:3])
        out[3:] = s


@part
def wrench_of(columns: Array, parameters: Array, R: Array, o: Array, out: Array) -> None:
    """Writes a link's inertial wrench about the trunk's origin, from its columns in its own axes."""
    own, u = np.zeros(6), np.empty(3)
    for c in range(6):
        for k in range(10):
            own[c] += columns[c, k] * parameters[k]
    rotate(R, own[:3], out[:3])
    rotate(R, own[3:], out[3:])
    cross(o, out[:3], u)
    for c in range(3):
        out[3 + c] += u[c]


@part
def effect_of(T: Array, columns: Array, R: Array, o: Array, out: Array) -> None:
    """Writes T X (6, 10) with X a link's columns as wrenches about the trunk's origin."""
    X = np.empty((6, 6))  # T [R 0 ; [o]x R, R]: its rows as those of T, turned
    u, row = np.empty(3), np.empty(3)
    for i in range(6):
        cross(T[i, 3:], o, u)
        for c in range(3):
            row[c] = T[i, c] + u[c]
        rotate_back(R, row, X[i, :3])
        rotate_back(R, T[i, 3:], X[i, 3:])
    for i in range(6):
        for k in range(10):
            out[i, k] = 0.0
            for c in range(6):
                out[i, k] += X[i, c] * columns[c, k]


@compiled(
    "void(int64[::1], float64[:,:,::1], float64[:,::1], float64[:,::1], boolean[::1], float64[:,::1], int64[::1], "
    "int64[:,::1], int64[::1], float64[:,::1], float64[::1], float64[:,:,::1], float64[:,:,::1], float64[:,::1], "
    "float64[:,::1], float64[:,:,::1], float64[:,:,::1], float64[:,:,:,::1], float64[:,:,::1], float64[:,:,::1], "
    "float64[:,::1], float64[:,:,::1], float64[:,:,::1])"
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
    radii: Array,
    joints: Array,
    trunk: Array,
    normal: Array,
    torque: Array,
    inertial: Array,
    to_wrench: Array,
    columns: Array,
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
        points, radii: (L, 3) and (L,) [m], of the contacts, in the last link's axes.
        joints: (N, n, 3), q, q̇, q̈. trunk: (N, 3, 3), ω, α and a. normal: (N, 3), of the ground.
        columns: (N, n, 6, 10), or (0, n, 6, 10) if they are not needed.
    """
    n, count = len(parents), len(legs)
    R, o, s = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 3))
    omega, alpha, a = np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 3))
    own_a, own_omega, own_alpha = np.empty(3), np.empty(3), np.empty(3)
    own, wrench, r, contact = np.empty((n, 6, 10)), np.empty((n, 6)), np.empty((n, 6)), np.empty(3)
    T, lengths, u, v = np.empty((n + 1, 6, 6)), np.zeros(count, dtype=np.int64), np.empty(3), np.empty(3)
    for leg in range(count):
        while lengths[leg] < legs.shape[1] and legs[leg, lengths[leg]] >= 0:
            lengths[leg] += 1
    R[n], o[n], s[n], T[n] = np.eye(3), 0.0, 0.0, -np.eye(6)
    for k in range(len(joints)):
        omega[n], alpha[n], a[n] = trunk[k, 0], trunk[k, 1], trunk[k, 2]
        inertial[k], to_wrench[k] = 0.0, 0.0
        for j in range(n):
            state = joints[k, j]
            next_link(parents[j], j, rotations[j], arms[j], axes[j], slides[j], state, R, o, s, omega, alpha, a)
            rotate_back(R[j], a[j], own_a)
            rotate_back(R[j], omega[j], own_omega)
            rotate_back(R[j], alpha[j], own_alpha)
            columns_of_link(own_a, own_omega, own_alpha, own[j])
            wrench_of(own[j], parameters[j], R[j], o[j], wrench[j])
            across(o[j], s[j], slides[j], r[j])
            for c in range(6):
                inertial[k, leg_of[j], c] += wrench[j, c]
        for j in range(n - 1, -1, -1):
            torque[k, j] = 0.0
            for c in range(6):
                torque[k, j] += r[j, c] * wrench[j, c]
                if parents[j] < n:
                    wrench[parents[j], c] += wrench[j, c]
        for leg in range(count):
            own_joints = legs[leg, : lengths[leg]]
            last = own_joints[-1]
            rotate(R[last], points[leg], u)
            for c in range(3):
                feet[k, leg, c] = o[last, c] + u[c]
                contact[c] = feet[k, leg, c] - radii[leg] * normal[k, c]
            volume[k, leg] = map_leg(own_joints, sizes[leg], contact, o, s, to_wrench[k])
            cross(omega[n], feet[k, leg], pace[k, leg])
            for j in own_joints:
                for c in range(3):
                    u[c] = feet[k, leg, c] - o[j, c]
                cross(s[j], u, v)
                for c in range(3):
                    pace[k, leg, c] += joints[k, j, 1] * v[c]
        for j in range(n):
            origin[k, j], axis[k, j] = o[j], s[j]
            if len(columns):
                for c in range(6):
                    for d in range(6):
                        T[j, c, d] = T[parents[j], c, d] + to_wrench[k, j, c] * r[j, d]
                effect_of(T[j], own[j], R[j], o[j], columns[k, j])
