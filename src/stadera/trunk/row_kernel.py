"""Sums over blocks, compiled: the parts of `stadera.trunk.rows` that would be many small products in numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled
from stadera.types import Array

Ints = NDArray[np.int64]


@compiled(
    "void(float64[:,::1], int64[::1], int64[::1], int64[::1], float64[:,:,::1], float64[:,:,::1], "
    "float64[:,:,:,::1], float64[:,:,::1], float64[:,::1], float64[:,::1], float64[:,::1], float64[:,::1], "
    "float64[:,:,::1], float64[:,:,::1], float64[:,:,:,:,::1], float64[:,:,:,:,::1], float64[:,:,::1])"
)
def window_sums(
    weights: Array,
    block: Ints,
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
    """Weighted sums over the n samples of B blocks, in H halves of a window.

    Args:
        weights: (H, n). block: (n,), of each sample.
        joints, legs: (J,), of the joints in the legs, their place among all and their leg.
        E, inertial, columns: of a `State`. terms: (n, J, T), left, rate: (n, J), h - τ and τ̇.
        variance: (B, J), of the torques' white noise.
        target: (n, 6), zero, b of each sample is added. force: (n, legs, 3), zero, those of the contacts are added.
        by_rate, squared, by_terms, by_links: (B, H, 6), (B, H, 6), (B, H, J, 6, T), (B, H, K, 6, 10), zero; added are
            Σ w E τ̇, Σ w² E σ² E, Σ w E by term, and Σ w of `columns` of the first K links.
    """
    n, count, halves = len(left), len(joints), len(weights)
    for k in range(n):
        b = block[k]
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
                    by_rate[b, h, c] += weighted * rate[k, j]
                    squared[b, h, c] += weighted * weighted * variance[b, j]
                    for t in range(terms.shape[2]):
                        by_terms[b, h, j, c, t] += weighted * terms[k, j, t]
        for h in range(halves):
            for link in range(by_links.shape[2]):
                for c in range(6):
                    for p in range(10):
                        by_links[b, h, link, c, p] += weights[h, k] * columns[k, link, c, p]


@compiled(
    "void(int64[::1], int64[::1], int64[::1], float64[:,:,::1], float64[:,::1], float64[:,:,::1], float64, "
    "float64[:,:,::1], float64[:,:,::1])"
)
def differences(
    joints: Ints,
    legs: Ints,
    order: Ints,
    E: Array,
    left: Array,
    inertial: Array,
    step: float,
    probes: Array,
    middle: Array,
) -> None:
    """Derivatives of b of B blocks, from states in which one quantity after another is moved in all legs at once.

    Args:
        joints, legs, order: (J,), of the joints in the legs, their place among all, their leg, and their place in it.
        E, inertial: of a `State` at B N samples; left: (B N, n), h - τ. The states of a block have a unit of each of
            the trunk's six accelerations, of the acceleration of each place in a leg, nothing moved, and `step` of
            each position.
        probes: (B, 6, 6 + J), zero, written, by accelerations. middle: (B, 6, J), written, by positions.
    """
    most = (len(E) // len(probes) - 7) // 2
    for b in range(len(probes)):
        start = b * (7 + 2 * most)
        still = start + 6 + most
        for c in range(6):
            for i in range(6):
                for body in range(inertial.shape[1]):
                    probes[b, c, i] -= inertial[start + i, body, c]
                for j in joints:
                    probes[b, c, i] += E[start + i, j, c] * left[start + i, j]
            for k in range(len(joints)):
                accelerated, moved = start + 6 + order[k], still + 1 + order[k]
                change = inertial[still, legs[k], c] - inertial[moved, legs[k], c]
                probes[b, c, 6 + k] = -inertial[accelerated, legs[k], c]
                for i in range(len(joints)):
                    if legs[i] == legs[k]:
                        j = joints[i]
                        probes[b, c, 6 + k] += E[accelerated, j, c] * left[accelerated, j]
                        change += E[moved, j, c] * left[moved, j] - E[still, j, c] * left[still, j]
                middle[b, c, k] = change / step
