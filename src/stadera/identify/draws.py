"""Robots drawn from the posterior of an identification, for domain randomisation: correlated, and all of them possible.

The posterior is the Gaussian of estimate and covariance, restricted to bodies with a positive definite pseudo-inertia
and to rotor inertia and friction that are not negative. In coordinates u in which it is isotropic, each of many
independent chains moves along a random direction d by a step t, drawn from the exact conditional distribution (hit and
run: Smith 1984, Bélisle et al. 1993): a normal one about -u·d, cut off where

    1 + t λ = 0,   λ an eigenvalue of J^-½ J(d) J^-½, with J the present pseudo-inertia,

or where a friction becomes zero. Legs are drawn independently of one another. What the logs do not measure is drawn as
far from the model's value as the prior has it.
"""

import numpy as np
from scipy.special import ndtr, ndtri

from stadera.errors import IdentificationError
from stadera.identify.prior import Prior
from stadera.identify.solutions import Estimate, signed
from stadera.inertia import PSEUDO_BASIS
from stadera.types import Array


def drawn(estimate: Estimate, count: int, rng: np.random.Generator, sweeps: int = 4) -> Array:
    """Parameters of `count` legs, (count, n), in the estimate's order and units, each by a chain of `sweeps` steps per
    parameter from the estimate. Raises IdentificationError: the
    estimate itself is not possible, or `count` is not positive.
    """
    if count < 1:
        raise IdentificationError(f"draws need a number above 0, got {count}")
    prior, n = estimate.prior, len(estimate.columns)
    if not estimate.is_physical:
        raise IdentificationError("the identified leg is not possible, so nothing is drawn about it")
    scaled = estimate.covariance / np.outer(prior.scales, prior.scales)
    sizes, axes = np.linalg.eigh(scaled)
    root = prior.scales[:, None] * axes * np.sqrt(np.maximum(sizes, 0.0))
    positive = signed(prior)
    begin = _inside(estimate, positive)
    u = np.tile(np.linalg.lstsq(root, begin - estimate.values)[0], (count, 1))
    values = np.tile(begin, (count, 1))
    for _ in range(sweeps * n):
        direction = rng.normal(size=(count, n))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        step = direction @ root.T
        low, high = _reach(values, step, prior, positive)
        middle = -np.sum(u * direction, axis=1)
        t = middle + _cut_normal(low - middle, high - middle, rng)
        t = np.clip(t, 0.999 * low, 0.999 * high)  # rounding does not leave the set
        values, u = values + t[:, None] * step, u + t[:, None] * direction
    return values


def _inside(estimate: Estimate, positive: list[int]) -> Array:
    """A point near the estimate off the border of the possible set, whose corners chains hardly leave, (n,). Values
    without variance are the estimate's, as no chain would bring them back.
    """
    prior, values = estimate.prior, estimate.values.copy()
    varies = np.diag(estimate.covariance) > 0.0
    values[positive] = np.maximum(values[positive], 0.1 * np.sqrt(np.diag(estimate.covariance))[positive])
    for link in prior.links:
        own = np.arange(len(values))[prior.block(link)]
        free = own[varies[own]]
        for share in (0.0, *np.logspace(-10, 0, 21)):  # towards the model's values, which are inside
            values[free] = estimate.values[free] + share * (prior.values[free] - estimate.values[free])
            J = np.tensordot(values[own], PSEUDO_BASIS, axes=1)
            if np.linalg.eigvalsh(J).min() > 1e-9 * np.trace(J):
                break
    return values


def _reach(values: Array, step: Array, prior: Prior, positive: list[int]) -> tuple[Array, Array]:
    """How far each chain can go backwards (at most 0) and forwards (at least 0), each (chains,)."""
    rates = []
    for link in prior.links:
        J, change = (np.tensordot(x[:, prior.block(link)], PSEUDO_BASIS, axes=1) for x in (values, step))
        sizes, axes = np.linalg.eigh(J)
        root = axes / np.sqrt(np.maximum(sizes, 1e-12 * sizes[:, -1:]))[:, None, :]  # at the border, but for rounding
        rates.append(np.linalg.eigvalsh(root.transpose(0, 2, 1) @ change @ root))
    tiny = 1e-300
    rates.append(step[:, positive] / np.maximum(values[:, positive], tiny))
    every = np.concatenate(rates, axis=1)
    return -1.0 / np.maximum(every.max(axis=1), tiny), -1.0 / np.minimum(every.min(axis=1), -tiny)


def _cut_normal(low: Array, high: Array, rng: np.random.Generator) -> Array:
    """Draws of standard normal numbers between bounds; those above zero are mirrored, where the tail has all digits."""
    mirrored = low > 0.0
    a, b = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    below, above = ndtr(a), ndtr(b)
    found = ndtri(below + rng.uniform(size=len(a)) * (above - below))
    found = np.clip(np.where(np.isfinite(found), found, b), a, b)
    return np.asarray(np.where(mirrored, -found, found))
