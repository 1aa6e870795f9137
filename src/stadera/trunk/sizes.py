"""Sizes of the kinds of model errors of one robot, from the marginal likelihood of its rows.

Errors of kind g have the covariance s_g² Σ_g, with Σ_g the prior of `ModelErrors`, which describes all robots: a single
robot has good encoders and much friction. ln s_g is normally distributed, with s_g² of mean one. Rows of the errors, θ
eliminated, have the normal matrix J and the right side h, both over the variance of what repeats in them. With
Σ = L Lᵀ, A = Lᵀ J L, c = Lᵀ h and S the diagonal matrix of all s, the likelihood of the rows, errors integrated out, is

    ln p(rows | s) = -½ ln |1 + S A S| + ½ cᵀ S F S c,      F = (1 + S A S)⁻¹

Given the sizes of all others, kind g has F_gg = (1 + s_g A' s_g)⁻¹ and (F S c)_g = s_g F_gg c', with A' and c' after
eliminating the others' errors. With A' = V Λ Vᵀ and u = Vᵀ c',

    ln p(rows | s_g) = ½ Σ_i [s_g² u_i² / (1 + s_g² λ_i) - ln (1 + s_g² λ_i)]

so the mean of s_g² is a sum over values of ln s_g. All kinds are updated at once, each by half of the step of its
logarithm, from one evaluation to the next. The mean and not the likeliest size is used: small sizes are nearly equally
likely, and the likeliest may be zero. A kind that no row shows keeps its size.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt
from types import MappingProxyType

import numpy as np
from scipy.linalg import lapack

from stadera.trunk.error_model import ErrorLayout
from stadera.types import Array

KINDS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "rotor": ("rotor",),
        "friction": ("viscous", "coulomb", "standstill"),
        "limb_friction": ("limb_viscous", "limb_coulomb"),
        "limb_links": ("limb_mass", "limb_com"),
        "offset": ("offset", "limb_offset"),
        "gain": ("gain",),
        "load_friction": ("load_friction",),
        "encoder": ("encoder",),
        "contact": ("contact",),
        "links": ("link_mass", "link_com"),
        "imu": ("imu_lever", "imu_rotation", "accelerometer"),
        "response": ("imu_response",),
        "lag": ("torque_lag", "velocity_lag"),
    }
)
"""Kinds of errors by name, of the names in `ErrorLayout.places`."""

BOUNDED = ("gain",)
"""Kinds that are never larger than usual: torques are the target, so free gains take up whatever is wrong."""

_WIDEST, _TRIES = 5.0, 81  # standard deviations of ln s, and number of its values, in sums over it


class Sizes:
    """Sizes of one robot's errors.

    Args:
        layout: places of the errors. spread: standard deviation of ln s.

    Attributes:
        by_kind: s by kind, of `KINDS`.
    """

    def __init__(self, layout: ErrorLayout, spread: float) -> None:
        self.by_kind = dict.fromkeys(KINDS, 1.0)
        self._at = {kind: at for kind, names in KINDS.items() if len(at := layout.at(*names))}
        self._starts = np.cumsum([0, *map(len, self._at.values())])[:-1]
        self._layout = layout
        tried = np.linspace(-_WIDEST, _WIDEST, _TRIES)  # (ln s about the prior's median) / spread
        self._square, self._prior = np.exp(2.0 * spread * (tried - spread))[:, None], 0.5 * tried[:, None] ** 2

    @property
    def factors(self) -> Array:
        """Factors (errors,) on the prior's standard deviations. Static friction is as large as sliding friction; errors
        that no residual shows keep their size.
        """
        out = np.ones(self._layout.count)
        for kind, at in self._at.items():
            out[at] = self.by_kind[kind]
        out[self._layout.sticking] = self.by_kind["friction"]
        out[self._layout.places["limb_stiction"]] = self.by_kind["limb_friction"]
        return out

    def update(self, normal: Array, right: Array) -> None:
        """Takes in rows: A (learnt, learnt) and c (learnt,), see the module's text."""
        S = self.factors[: len(right)]
        system = S[:, None] * normal * S
        system.flat[:: len(system) + 1] += 1.0
        root = lapack.dtrtri(lapack.dpotrf(system)[0])[0]  # T of F = T Tᵀ
        found, square = root @ (root.T @ (S * right)), self._square
        parts = [(at, *lapack.dsyevd(root[at] @ root[at].T)[:2]) for at in self._at.values()]
        size = np.concatenate([S[at] for at, _, _ in parts])
        known = np.clip(np.concatenate([values for _, values, _ in parts]), 1e-12, 1.0)
        along = np.concatenate([vectors.T @ found[at] for at, _, vectors in parts]) / (size * known)  # u
        spread = 1.0 + square * ((1.0 / known - 1.0) / size**2)
        likely = np.add.reduceat(square * along**2 / spread - np.log(spread), self._starts, axis=1)
        weight = np.exp(0.5 * (likely - likely.max(axis=0)) - self._prior)
        means = np.sqrt(square[:, 0] @ weight / weight.sum(axis=0))
        for kind, mean in zip(self._at, means.tolist(), strict=True):
            self.by_kind[kind] = sqrt(self.by_kind[kind] * (min(mean, 1.0) if kind in BOUNDED else mean))
