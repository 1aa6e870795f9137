"""Joint-side torques: rotor inertia, viscous and Coulomb friction, and a constant offset.

    τ_joint = I_a q̈ + b q̇ + τ_c s(q̇) + τ_0,     s(q̇) = tanh(q̇ / v_s)

linear in (I_a, b, τ_c, τ_0). All code that identifies or uses Coulomb friction takes its direction from here.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from stadera.errors import UnknownNameError
from stadera.types import Array

FRICTION_TERMS: tuple[str, ...] = ("armature", "viscous", "coulomb", "offset")
"""Names of the joint-side terms, in their order."""

FRICTION_UNITS: dict[str, str] = {"armature": "kg·m²", "viscous": "N·m·s/rad", "coulomb": "N·m", "offset": "N·m"}

STICTION_VELOCITY = 0.02
"""v_s [rad/s]: the noise of a joint's measured velocity, so that noise at standstill does not switch friction's sign.
Legs of a real Go2 and Aliengo identified with 0.01 or 0.02 predict their later torques equally well; 0.05 is 5 % worse.
"""


def direction(velocity: Array, out: Array | None = None) -> Array:
    """s(q̇), from -1 to 1: direction of sliding, smoothed near standstill, at velocities of any shape [rad/s]."""
    return np.asarray(np.tanh(velocity / STICTION_VELOCITY, out=out))


@dataclass(frozen=True)
class FrictionModel:
    """Selection of the joint-side columns: any of armature, viscous, coulomb, offset; empty for rigid bodies alone.
    Raises UnknownNameError for other terms.
    """

    terms: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for term in self.terms:
            if term not in FRICTION_TERMS:
                raise UnknownNameError("friction term", term, FRICTION_TERMS)
        object.__setattr__(self, "terms", tuple(t for t in FRICTION_TERMS if t in self.terms))

    @classmethod
    def full(cls) -> Self:
        """All four terms."""
        return cls(FRICTION_TERMS)

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
                    direction(velocity, out=row)
                case "offset":
                    row[:] = 1.0
