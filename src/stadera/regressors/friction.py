"""What a joint itself adds to the torque: rotor inertia, viscous and Coulomb friction, a constant offset.

    τ_joint = I_a q̈ + b q̇ + τ_c tanh(q̇ / v_s) + τ_0

linear in (I_a, b, τ_c, τ_0). The sign of Coulomb friction is smoothed over v_s, so that noise around standstill does
not flip it from sample to sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.errors import IdentificationError, UnknownNameError

Array = NDArray[np.float64]

FRICTION_TERMS: tuple[str, ...] = ("armature", "viscous", "coulomb", "offset")
"""The joint-side terms, in their order."""

FRICTION_UNITS: dict[str, str] = {"armature": "kg·m²", "viscous": "N·m·s/rad", "coulomb": "N·m", "offset": "N·m"}


@dataclass(frozen=True)
class FrictionModel:
    """Which joint-side columns there are.

    Args:
        terms: any of armature, viscous, coulomb, offset; none of them for rigid bodies alone.
        stiction_velocity: v_s [rad/s], over which Coulomb friction's sign is smoothed.

    Raises:
        UnknownNameError: a term that is none of the four.
        IdentificationError: a velocity that is not positive.
    """

    terms: tuple[str, ...] = ()
    stiction_velocity: float = 0.01

    def __post_init__(self) -> None:
        for term in self.terms:
            if term not in FRICTION_TERMS:
                raise UnknownNameError("friction term", term, FRICTION_TERMS)
        if not self.stiction_velocity > 0:
            raise IdentificationError(f"stiction velocity must be positive, got {self.stiction_velocity} rad/s")
        object.__setattr__(self, "terms", tuple(t for t in FRICTION_TERMS if t in self.terms))

    @classmethod
    def full(cls, stiction_velocity: float = 0.01) -> FrictionModel:
        """All four terms."""
        return cls(FRICTION_TERMS, stiction_velocity)

    def columns(self, joint: str) -> tuple[str, ...]:
        """Column names of one joint: `<joint>.armature`, ..."""
        return tuple(f"{joint}.{term}" for term in self.terms)

    def fill(self, velocity: Array, acceleration: Array, out: Array) -> None:
        """Writes the columns of one joint, each (samples,), into out (terms, samples)."""
        for row, term in zip(out, self.terms, strict=True):
            match term:
                case "armature":
                    row[:] = acceleration
                case "viscous":
                    row[:] = velocity
                case "coulomb":
                    np.tanh(velocity / self.stiction_velocity, out=row)
                case "offset":
                    row[:] = 1.0
