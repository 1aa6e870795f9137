"""Runs a recorded sequence of arithmetic, compiled: `stadera.legs.tape`, whose docstring says what a tape is."""

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled, part
from stadera.types import Array

TILE = 128  # samples at a time: the registers of a leg's regressor fit into the processor's caches

# a, b and c are the operands, k the constant
COSINE, SINE = range(2)
PLUS_CONSTANT, MINUS_FROM, TIMES_CONSTANT = range(2, 5)
ADD, SUBTRACT, TIMES = range(5, 8)
TIMES_ADD, TIMES_SUBTRACT, SUBTRACT_TIMES = range(8, 11)  # a b + c, a b - c, c - a b

# π/2 in three parts, the first two of 33 bits so that their product with a number below 2^20 is exact; and the
# polynomials of sine and cosine within ±π/4 (fdlibm, Sun Microsystems 1993)
TURNS = 2.0 / np.pi
P1, P2, P3 = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624871116645580e-21
S1, S2, S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
S4, S5, S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
C1, C2, C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
C4, C5, C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11
LARGEST = 1e6
"""Angle up to which sine and cosine are within a rounding or two [rad]."""


@part
def sine(angle: float, quarters: float) -> float:
    """sin(angle + quarters π/2), in arithmetic that runs on several samples at once, unlike the library's sine."""
    whole: float = np.floor(angle * TURNS + 0.5)
    r = ((angle - whole * P1) - whole * P2) - whole * P3
    z = r * r
    s = r + r * z * (S1 + z * (S2 + z * (S3 + z * (S4 + z * (S5 + z * S6)))))
    c = 1.0 - 0.5 * z + z * z * (C1 + z * (C2 + z * (C3 + z * (C4 + z * (C5 + z * C6)))))
    turn = whole + quarters
    turn -= 4.0 * np.floor(0.25 * turn)
    value = c if turn == 1.0 or turn == 3.0 else s
    return -value if turn >= 2.0 else value


@compiled(inline="always")
def of_angle(kind: int, z: Array, a: Array) -> None:
    """Writes the cosine or sine of a into z, all (TILE,)."""
    if kind == SINE:
        for t in range(TILE):
            z[t] = sine(a[t], 0.0)
    else:
        for t in range(TILE):
            z[t] = sine(a[t], 1.0)


@compiled(inline="always")
def with_constant(kind: int, z: Array, a: Array, k: float) -> None:
    """Writes an operation on a and a constant into z."""
    if kind == TIMES_CONSTANT:
        for t in range(TILE):
            z[t] = k * a[t]
    elif kind == PLUS_CONSTANT:
        for t in range(TILE):
            z[t] = a[t] + k
    else:
        for t in range(TILE):
            z[t] = k - a[t]


@compiled(inline="always")
def of_two(kind: int, z: Array, a: Array, b: Array) -> None:
    """Writes an operation on a and b into z."""
    if kind == ADD:
        for t in range(TILE):
            z[t] = a[t] + b[t]
    elif kind == SUBTRACT:
        for t in range(TILE):
            z[t] = a[t] - b[t]
    else:
        for t in range(TILE):
            z[t] = a[t] * b[t]


@compiled(inline="always")
def of_three(kind: int, z: Array, a: Array, b: Array, c: Array) -> None:
    """Writes a product of a and b in a sum or difference with c into z."""
    if kind == TIMES_ADD:
        for t in range(TILE):
            z[t] = a[t] * b[t] + c[t]
    elif kind == TIMES_SUBTRACT:
        for t in range(TILE):
            z[t] = a[t] * b[t] - c[t]
    else:
        for t in range(TILE):
            z[t] = c[t] - a[t] * b[t]


@compiled("void(int64[:, ::1], float64[::1], int64, float64[:, ::1], int64[::1], float64[:, ::1])")
def run(
    code: NDArray[np.int64], constants: Array, registers: int, inputs: Array, stores: NDArray[np.int64], out: Array
) -> None:
    """Runs a tape on all samples.

    Args:
        code: (operations, 5): kind, register of the result, registers of a, b and c.
        constants: (operations,), k.
        registers: their number; the inputs are in the first ones at the beginning.
        inputs: (inputs, samples).
        stores: (rows,), register of each result; -1 for a row that is left alone.
        out: (rows, samples), written.
    """
    w = np.zeros((registers, TILE))
    samples = inputs.shape[1]
    for start in range(0, samples, TILE):
        m = min(TILE, samples - start)
        for r in range(len(inputs)):
            w[r, :m] = inputs[r, start : start + m]
        for i in range(len(code)):
            kind, k = code[i, 0], constants[i]
            z, a, b, c = w[code[i, 1]], w[code[i, 2]], w[code[i, 3]], w[code[i, 4]]
            if kind <= SINE:
                of_angle(kind, z, a)
            elif kind <= TIMES_CONSTANT:
                with_constant(kind, z, a, k)
            elif kind <= TIMES:
                of_two(kind, z, a, b)
            else:
                of_three(kind, z, a, b, c)
        for r in range(len(stores)):
            if stores[r] >= 0:
                out[r, start : start + m] = w[stores[r], :m]
