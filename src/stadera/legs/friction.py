"""What a joint itself adds to the torque: rotor inertia, viscous and Coulomb friction, a constant offset.

    τ_joint = I_a q̈ + b q̇ + τ_c s(q̇) + τ_0,     s(q̇) = tanh(q̇ / v_s)

linear in (I_a, b, τ_c, τ_0). Everything that identifies or uses Coulomb friction has its direction from here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.errors import UnknownNameError
from stadera.robot.model import Robot
from stadera.types import Array

FRICTION_TERMS: tuple[str, ...] = ("armature", "viscous", "coulomb", "offset")
"""The joint-side terms, in their order."""

FRICTION_UNITS: dict[str, str] = {"armature": "kg·m²", "viscous": "N·m·s/rad", "coulomb": "N·m", "offset": "N·m"}

STICTION_VELOCITY = 0.02
"""v_s [rad/s]: the noise of a joint's measured velocity, so that noise about standstill does not flip friction's sign.
Legs of a real Go2 and Aliengo identified with 0.01 or 0.02 predict their own later torques alike; 0.05 is 5 % worse.
"""


def direction(velocity: Array, out: Array | None = None) -> Array:
    """s(q̇): how surely a joint slides, and which way, -1 to 1, at velocities of any shape [rad/s]."""
    return np.asarray(np.tanh(velocity / STICTION_VELOCITY, out=out))


def joint_columns(robot: Robot) -> NDArray[np.int_]:
    """(4, 3), where each leg's joints, from the trunk outwards, are in the tree's order."""
    return np.array([[robot.tree.joints.index(joint) for joint in leg.joints] for leg in robot.legs])


@dataclass(frozen=True, eq=False)
class JointFriction:
    """Friction and torque offsets of a robot's legs, each (4, 3), by leg and joint.

    Attributes:
        viscous: [N·m·s/rad]. coulomb: [N·m]. offset: [N·m].
    """

    viscous: Array
    coulomb: Array
    offset: Array

    @classmethod
    def of(cls, robot: Robot) -> JointFriction:
        """The robot's own."""
        dynamics = [[robot.dynamics[joint] for joint in leg.joints] for leg in robot.legs]
        terms = np.array([[(d.viscous, d.coulomb, d.offset) for d in leg] for leg in dynamics])
        return cls(*np.moveaxis(terms, -1, 0))

    def torque(self, velocity: Array, sliding: Array | None = None) -> Array:
        """What friction and offsets take at joint velocities (..., 4, 3) [rad/s], (..., 4, 3) [N·m].

        Args:
            sliding: velocities that decide the direction of Coulomb friction; None for `velocity`.
        """
        torque = self.viscous * velocity + self.offset
        if self.coulomb.any():
            torque += self.coulomb * direction(velocity if sliding is None else sliding)
        return np.asarray(torque)


@dataclass(frozen=True)
class FrictionModel:
    """Which joint-side columns there are.

    Args:
        terms: any of armature, viscous, coulomb, offset; none of them for rigid bodies alone.

    Raises:
        UnknownNameError: a term that is none of the four.
    """

    terms: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for term in self.terms:
            if term not in FRICTION_TERMS:
                raise UnknownNameError("friction term", term, FRICTION_TERMS)
        object.__setattr__(self, "terms", tuple(t for t in FRICTION_TERMS if t in self.terms))

    @classmethod
    def full(cls) -> FrictionModel:
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
