"""Vector algebra by components, where each component is an array (samples,) or, if constant, a number.

Joint axes, offsets and gravity are constant, and mostly zeros and ones. Plain numbers are combined without touching an
array, which halves the cost of making rows.
"""

import numpy as np

from stadera.types import Array

Component = float | Array
Vector = tuple[Component, Component, Component]

ZERO: Vector = (0.0, 0.0, 0.0)


def vector(values: Array) -> Vector:
    """Makes a vector from (3,), constant, or (samples, 3)."""
    if values.ndim == 1:
        x, y, z = values.tolist()
        return (x, y, z)
    return (np.ascontiguousarray(values[:, 0]), np.ascontiguousarray(values[:, 1]), np.ascontiguousarray(values[:, 2]))


def is_zero(a: Component) -> bool:
    """True if a component is the constant zero."""
    return isinstance(a, float) and a == 0.0


def times(a: Component, b: Component) -> Component:
    """a b"""
    if is_zero(a) or is_zero(b):
        return 0.0
    if isinstance(a, float) and a == 1.0:
        return b
    if isinstance(b, float) and b == 1.0:
        return a
    return a * b


def plus(a: Component, b: Component) -> Component:
    """a + b"""
    if is_zero(a):
        return b
    return a if is_zero(b) else a + b


def minus(a: Component, b: Component) -> Component:
    """a - b"""
    if is_zero(b):
        return a
    return -b if is_zero(a) else a - b


def add(*vectors: Vector) -> Vector:
    """Σ v"""
    x, y, z = vectors[0]
    for a, b, c in vectors[1:]:
        x, y, z = plus(x, a), plus(y, b), plus(z, c)
    return (x, y, z)


def scale(a: Component, v: Vector) -> Vector:
    """a v"""
    return (times(a, v[0]), times(a, v[1]), times(a, v[2]))


def cross(a: Vector, b: Vector) -> Vector:
    """a x b"""
    return (
        minus(times(a[1], b[2]), times(a[2], b[1])),
        minus(times(a[2], b[0]), times(a[0], b[2])),
        minus(times(a[0], b[1]), times(a[1], b[0])),
    )


def dot(a: Vector, b: Vector) -> Component:
    """a · b"""
    return plus(plus(times(a[0], b[0]), times(a[1], b[1])), times(a[2], b[2]))


def transform(matrix: Array, v: Vector) -> Vector:
    """Product of a constant 3x3 matrix and v."""
    rows = [dot((float(r[0]), float(r[1]), float(r[2])), v) for r in matrix]
    return (rows[0], rows[1], rows[2])
