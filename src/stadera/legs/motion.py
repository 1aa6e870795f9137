"""Motion of a tree of rigid bodies over time: the input of the regressors.

Recursion from a link p to its child i, joint at `t` in p, R the child's rotation in p, s the joint axis::

    ω_i = Rᵀ ω_p + s q̇
    α_i = Rᵀ α_p + (Rᵀ ω_p) x s q̇ + s q̈
    a_i = Rᵀ (a_p + α_p x t + ω_p x (ω_p x t))

where `a` is the specific force of the frame's origin: its acceleration minus gravity. A trunk that moves with angular
velocity ω and specific force a obeys the equations of one at rest in gravity-free space accelerated by a, so neither
orientation nor gravity nor velocity of the trunk appears.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stadera.constants import GRAVITY
from stadera.errors import IdentificationError
from stadera.legs.components import Component, Vector, minus, plus, times, transform
from stadera.robot.model import Tree
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


@dataclass(frozen=True, eq=False)
class JointRotation:
    """Rotates vectors from a parent link's axes to its child's, Rᵀ v, for all samples at once."""

    into_spin: Array  # (3, 3): parent axes to axes whose z is the joint axis
    out_of_spin: Array | None  # (3, 3) back to child axes; None where the joint axis is z already
    cos: Component
    sin: Component

    @classmethod
    def of(cls, tree: Tree, joint: int, cos: Component, sin: Component) -> JointRotation:
        """The rotation of one joint of a tree by angles with these cosines and sines."""
        align = _z_onto(tree.axes[joint])
        is_z = np.array_equal(align, np.eye(3))
        into = align.T @ tree.rotations[joint].T
        return cls(into, None if is_z else align, cos, sin)

    def __call__(self, v: Vector) -> Vector:
        """Rᵀ v."""
        x, y, z = transform(self.into_spin, v)
        turned = (plus(times(self.cos, x), times(self.sin, y)), minus(times(self.cos, y), times(self.sin, x)), z)
        return turned if self.out_of_spin is None else transform(self.out_of_spin, turned)


def _z_onto(axis: Array) -> Array:
    """A rotation whose third column is `axis`; the identity for z."""
    x, y, z = axis
    if z == 1.0:
        return np.eye(3)
    if abs(x) < 0.9:
        first = np.array([0.0, z, -y])  # axis-normal, from e_x
    else:
        first = np.array([-z, 0.0, x])  # from e_y
    first /= np.linalg.norm(first)
    return np.column_stack((first, np.cross(axis, first), axis))
