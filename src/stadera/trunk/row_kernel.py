"""Sums over a block, compiled: the parts of `stadera.trunk.rows` and `stadera.trunk.lifted` that would be many small
products in numpy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled
from stadera.types import Array, Bools

Ints = NDArray[np.int64]


@compiled(
    "void(float64[:,::1], int64[::1], int64[::1], float64[:,:,::1], float64[:,:,::1], float64[:,:,:,::1], "
    "float64[:,:,::1], float64[:,::1], float64[:,::1], float64[::1], float64[:,::1], float64[:,::1], float64[:,::1], "
    "float64[:,:,:,::1], float64[:,:,:,::1], float64[:,:,::1])"
)
def window_sums(
    weights: Array,
    joints: Ints,
    legs: Ints,
    E: Array,
    inertial: Array,
    columns: Array,
    terms: Array,
    left: Array,
    rate: Array,
    variance: Array,
    target: Array,
    by_rate: Array,
    squared: Array,
    by_terms: Array,
    by_links: Array,
    force: Array,
) -> None:
    """Weighted sums over a block's n samples, in H halves of a window.

    Args:
        weights: (H, n). joints, legs: (J,), of the joints in the legs, their place among all and their leg.
        E, inertial, columns: of a `State`. terms: (n, J, T), left, rate: (n, J), h - τ and τ̇.
        variance: (J,), of the torques' white noise.
        target: (n, 6), zero, b of each sample is added. force: (n, legs, 3), zero, those of the contacts are added.
        by_rate, squared, by_terms, by_links: (H, 6), (H, 6), (H, J, 6, T), (H, K, 6, 10), zero; added are Σ w E τ̇,
            Σ w² E σ² E, Σ w E by term, and Σ w of `columns` of the first K links.
    """
    n, count, halves = len(left), len(joints), len(weights)
    for k in range(n):
        for c in range(6):
            for body in range(inertial.shape[1]):
                target[k, c] -= inertial[k, body, c]
        for j in range(count):
            at, leg = joints[j], legs[j]
            for c in range(6):
                e = E[k, at, c]
                target[k, c] += e * left[k, j]
                if c < 3:
                    force[k, leg, c] += e * left[k, j]
                for h in range(halves):
                    weighted = weights[h, k] * e
                    by_rate[h, c] += weighted * rate[k, j]
                    squared[h, c] += weighted * weighted * variance[j]
                    for t in range(terms.shape[2]):
                        by_terms[h, j, c, t] += weighted * terms[k, j, t]
        for h in range(halves):
            for link in range(by_links.shape[1]):
                for c in range(6):
                    for p in range(10):
                        by_links[h, link, c, p] += weights[h, k] * columns[k, link, c, p]


@compiled(
    "void(int64[::1], int64[::1], float64[:,:,::1], float64[:,:,::1], float64[:,:,::1], float64[:,::1], "
    "float64[:,::1], float64[:,:,::1], float64[:,:,::1], float64[::1], int64, float64[::1], boolean[::1])"
)
def lifted_legs(
    joints: Ints,
    legs: Ints,
    E: Array,
    force: Array,
    moved: Array,
    known: Array,
    known_std: Array,
    feet: Array,
    pace: Array,
    normal: Array,
    parts: int,
    limits: Array,
    air: Bools,
) -> None:
    """Legs in the air throughout a block of n samples, see `Lifted`.

    Args:
        joints, legs, E: as of `window_sums`. force, feet, pace: (n, legs, 3).
        moved: (n, 3, J), q̈, q̇ and s of the joints. known, known_std: (3, J).
        normal: (3,), of the ground. parts: number of averages over the block.
        limits: height of a lifted foot [m]; squared speed of one that moves [m²/s²]; squared force of a light one, the
            robot's weight squared [N²]; load of the others [N].
        air: (legs,), written.
    """
    n, count = len(force), force.shape[1]
    for leg in range(count):
        air[leg] = True
    for p in range(parts):
        begin, end = p * n // parts, (p + 1) * n // parts
        felt, speed = np.zeros((count, 3)), np.zeros((count, 3))
        height, unsure, along = np.zeros(count), np.zeros(count), np.zeros(count)
        for k in range(begin, end):
            for j in range(len(joints)):
                torque = variance = square = 0.0
                for t in range(3):
                    torque += known[t, j] * moved[k, t, j]
                    variance += (known_std[t, j] * moved[k, t, j]) ** 2
                for c in range(3):
                    felt[legs[j], c] += E[k, joints[j], c] * torque / (end - begin)
                    square += E[k, joints[j], c] ** 2
                unsure[legs[j]] += square * variance / (end - begin)
            for leg in range(count):
                for c in range(3):
                    felt[leg, c] += force[k, leg, c] / (end - begin)
                    speed[leg, c] += pace[k, leg, c] / (end - begin)
                    height[leg] += feet[k, leg, c] * normal[c] / (end - begin)
        for leg in range(count):
            for c in range(3):
                along[leg] += felt[leg, c] * normal[c]
        for leg in range(count):
            carried = pressed = level = x = y = z = 0.0
            for other in range(count):
                if other != leg:
                    press = max(along[other], 0.0)
                    carried += along[other]
                    pressed += press
                    level += press * height[other]
                    x, y, z = x + press * speed[other, 0], y + press * speed[other, 1], z + press * speed[other, 2]
            pressed = max(pressed, 1e-9)
            raised, square = height[leg] - level / pressed, 0.0
            x, y, z = speed[leg, 0] - x / pressed, speed[leg, 1] - y / pressed, speed[leg, 2] - z / pressed
            fast = x * x + y * y + z * z
            for c in range(3):
                square += felt[leg, c] ** 2
            light = square < min(limits[2] + unsure[leg], limits[3])
            air[leg] &= (raised > limits[0] or fast > limits[1]) and light and carried > limits[4]
