"""Dry friction of joints that varies with their position and with the torque that they carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.types import Array


@dataclass(frozen=True, eq=False)
class VaryingFriction:
    """Largest dry friction coulomb (1 + v(q)) + load |τ|, with v linear between knots evenly over a joint's range."""

    coulomb: Array  # (n,) [N·m]
    low: Array  # (n,) [rad], the first knot
    high: Array  # (n,) [rad], the last one
    variation: Array  # (n, knots), v at the knots
    load: Array  # (n,), share of the torque

    def at(self, position: Array, effort: Array) -> Array:
        """Friction (n,) [N·m] at joint positions (n,) [rad] under torques (n,) [N·m]."""
        last, joints = self.variation.shape[1] - 1, np.arange(len(position))
        x = last * np.clip((position - self.low) / (self.high - self.low), 0.0, 1.0)
        before = np.minimum(x.astype(int), last - 1)
        share = x - before
        v = (1.0 - share) * self.variation[joints, before] + share * self.variation[joints, before + 1]
        return np.asarray(self.coulomb * (1.0 + v) + self.load * np.abs(effort))

    def of(self, joints: list[int]) -> VaryingFriction:
        """That of some of the joints."""
        return VaryingFriction(*(getattr(self, name)[joints] for name in self.__dataclass_fields__))
