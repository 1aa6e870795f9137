"""The trunk's side of its six equations: its inertial wrench, force above moment about its origin, trunk axes.

It is linear in a, α and the products of ω (h = m c, I about the trunk's origin)::

    force:  m a + α x h + ω x (ω x h)
    moment: h x a + I α + ω x I ω

so the filtered matrix is the matrix of the filtered signals: `TRUNK_MAP` maps the twelve to (6, 10).
"""

from __future__ import annotations

import numpy as np

from stadera.inertia import skew
from stadera.types import Array

_PRODUCTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_UNIT = np.eye(3)
SIGNALS = 6 + len(_PRODUCTS)
"""Number of signals: specific force, angular acceleration, products of the angular velocity."""


def trunk_signals(specific_force: Array, angular_velocity: Array, angular_acceleration: Array) -> Array:
    """The twelve signals in which the trunk's rows are linear, from components first (3, samples): (12, samples)."""
    w = angular_velocity
    return np.concatenate([specific_force, angular_acceleration, np.array([w[i] * w[j] for i, j in _PRODUCTS])])


def trunk_matrix(signals: Array) -> Array:
    """A, (..., 6, 10), from the twelve signals (..., 12)."""
    return np.asarray((signals @ TRUNK_MAP.T).reshape(*signals.shape[:-1], 6, 10))


def wrench_of_specific_force(mass: float, first_moment: Array) -> Array:
    """Derivative (6, 3) of a body's inertial wrench with respect to the specific force, [m 1 ; [h]x]."""
    return np.concatenate([mass * _UNIT, skew(first_moment)])


def wrench_of_angular_acceleration(first_moment: Array, inertia: Array) -> Array:
    """Derivative (6, 3) of a body's inertial wrench with respect to the angular acceleration, [-[h]x ; I]."""
    return np.concatenate([-skew(first_moment), inertia])


def _trunk_map() -> Array:
    """Builds the map (60, 12) by setting one signal at a time."""
    out = np.zeros((6, 10, SIGNALS))
    tensors = np.zeros((6, 3, 3))
    for k, (i, j) in enumerate(_PRODUCTS):
        tensors[k, i, j] = tensors[k, j, i] = 1.0
    for k, axis in enumerate(np.eye(3)):
        out[:3, 0, k] = axis
        out[3:, 1:4, k] = -skew(axis)
        out[:3, 1:4, 3 + k] = skew(axis)
        out[3:, 4:, 3 + k] = (tensors @ axis).T
    for k, square in enumerate(tensors):  # ω ωᵀ: ω x (ω x h) = (ω ωᵀ - tr 1) h, and ω x I ω of its products with I
        out[:3, 1:4, 6 + k] = square - np.trace(square) * np.eye(3)
        for c, tensor in enumerate(tensors):
            P = tensor @ square  # I ω ωᵀ: ω x Iω is its antisymmetric part
            out[3:, 4 + c, 6 + k] = [P[2, 1] - P[1, 2], P[0, 2] - P[2, 0], P[1, 0] - P[0, 1]]
    return out.reshape(-1, SIGNALS)


TRUNK_MAP: Array = _trunk_map()
"""(60, 12): from the twelve signals to the trunk's matrix (6, 10), row by row."""
