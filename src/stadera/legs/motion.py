"""Motion of a tree of rigid bodies over time: the input of the regressors.

The specific force of a frame's origin is its acceleration minus gravity. A trunk that moves with angular velocity ω and
specific force a obeys the equations of one at rest in gravity-free space accelerated by a, so neither orientation nor
gravity nor velocity of the trunk appears.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stadera.constants import GRAVITY
from stadera.errors import IdentificationError
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class TrunkMotion:
    """Motion of the trunk, in its own frame and at its origin: specific force (acceleration minus gravity) [m/s²],
    angular velocity [rad/s] and acceleration [rad/s²], each (samples, 3), or (3,) if constant.
    """

    specific_force: Array
    angular_velocity: Array
    angular_acceleration: Array

    @classmethod
    def held(cls, up: ArrayLike = (0.0, 0.0, 1.0), gravity: float = GRAVITY) -> TrunkMotion:
        """A trunk held still. `up` is the vertical in trunk axes (need not be of unit length)."""
        direction = np.asarray(up, dtype=float)
        norm = np.linalg.norm(direction)
        if direction.shape != (3,) or not np.isfinite(norm) or norm == 0:
            raise IdentificationError(f"the vertical needs three numbers, not all zero; got {up!r}")
        return cls(gravity * direction / norm, np.zeros(3), np.zeros(3))

    @property
    def turns(self) -> bool:
        """True if the trunk rotates."""
        return bool(self.angular_velocity.any() or self.angular_acceleration.any())


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Motion of the joints: position [rad], velocity [rad/s], acceleration [rad/s²], each (samples, joints)."""

    position: Array
    velocity: Array
    acceleration: Array

    def __post_init__(self) -> None:
        if not self.position.shape == self.velocity.shape == self.acceleration.shape or self.position.ndim != 2:
            shapes = (self.position.shape, self.velocity.shape, self.acceleration.shape)
            raise IdentificationError(f"joint motion needs three arrays of shape (samples, joints), got {shapes}")

    def __len__(self) -> int:
        return len(self.position)

    def slice(self, samples: slice) -> JointMotion:
        """A slice of the samples."""
        return JointMotion(self.position[samples], self.velocity[samples], self.acceleration[samples])
