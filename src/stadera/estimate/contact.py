"""Contact forces of one sample or of many, with what is uncertain about them.

With B = J^-T the force is f = B (h - τ). An error δτ of the torque, and an error δp of where the foot is, move it by

    δf = -B δτ,      δf = -B G δp,   G's rows (f x a_j)ᵀ          as (∂(Jᵀf)_j / ∂p) δp = (a_j x δp) · f

and the moment about the trunk's origin, μ = Σ p x f, by p x δf, the foot's error besides by δp x f.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stadera.errors import UnknownNameError
from stadera.estimate.noise import ForceNoise
from stadera.inertia import skew

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Source = Literal["white", "constant", "foot"]

SOURCES: tuple[Source, ...] = ("white", "constant", "foot")
"""Independent sources of error: torque, white and constant; foot position, constant."""

_SKEW = np.stack([skew(axis) for axis in np.eye(3)]).reshape(3, 9)


@dataclass(frozen=True, eq=False)
class ContactForces:
    """What the ground does to the feet, trunk frame and axes; `...` is empty for one sample, or (samples,).

    Attributes:
        force: (..., 4, 3) [N], legs in the robot's order; NaN for a leg so stretched that a direction is not felt.
        contact: (..., 4, 3) [m], where it acts: on the foot's sphere, towards the ground.
        stance: (..., 4) bool, the feet that carry.
        normal: (..., 3), unit normal of the ground through the feet in stance.
        jacobian: (..., 4, 3, 3) [m/rad], J of the contacts.
        axes: (..., 4, 3, 3), the joints' axes as columns.
        noise: what the covariances reckon with.
        feet_move_forces: the Jacobians are of the measured feet, so that an error of theirs moves the forces as well.
    """

    force: Array
    contact: Array
    stance: Bools
    normal: Array
    jacobian: Array
    axes: Array
    noise: ForceNoise
    feet_move_forces: bool = True

    @cached_property
    def total_force(self) -> Array:
        """(..., 3) [N], of the feet in stance."""
        return np.asarray(np.where(self.stance[..., None], self.force, 0.0).sum(axis=-2))

    @cached_property
    def moment(self) -> Array:
        """(..., 3) [N·m], about the trunk's origin, of the feet in stance."""
        force = np.where(self.stance[..., None], self.force, 0.0)
        return np.asarray((_skews(self.contact) @ force[..., None])[..., 0].sum(axis=-2))

    @property
    def wrench(self) -> Array:
        """(..., 6): `total_force` and `moment`."""
        return np.concatenate([self.total_force, self.moment], axis=-1)

    @cached_property
    def torque_to_force(self) -> Array:
        """(..., 4, 3, 3) [1/m]: change of each foot's force with its leg's torques, -B; zero for a singular leg."""
        singular = np.asarray(np.isnan(self.force).any(axis=-1))[..., None, None]
        transposed = np.where(singular, np.eye(3), np.swapaxes(self.jacobian, -1, -2))
        return np.where(singular, 0.0, -np.linalg.inv(transposed))

    @cached_property
    def foot_to_force(self) -> Array:
        """(..., 4, 3, 3): change of each foot's force with an error of its position [N/m], -B G."""
        if not self.feet_move_forces:
            return np.zeros_like(self.jacobian)
        rows = np.cross(np.nan_to_num(self.force)[..., None, :], np.swapaxes(self.axes, -1, -2))  # f x a_j
        return np.asarray(self.torque_to_force @ rows)

    def force_covariance(self, source: Source) -> Array:
        """Covariance of each foot's force from one source of error, (..., 4, 3, 3) [N²].

        Raises:
            UnknownNameError: no such source.
        """
        return _squared(self._to_force(source), self._variances(source))

    def wrench_covariance(self, source: Source) -> Array:
        """Covariance of `wrench` from one source of error, (..., 6, 6).

        Raises:
            UnknownNameError: no such source.
        """
        to_force = self._to_force(source)
        to_moment = _skews(self.contact) @ to_force
        if source == "foot":
            to_moment = to_moment - _skews(np.nan_to_num(self.force))
        to_wrench = np.concatenate([to_force, to_moment], axis=-2) * self.stance[..., None, None]
        return np.asarray(_squared(to_wrench, self._variances(source)).sum(axis=-3))

    def _to_force(self, source: Source) -> Array:
        return self.foot_to_force if source == "foot" else self.torque_to_force

    def _variances(self, source: Source) -> Array:
        match source:
            case "white":
                return self.noise.torque_white**2
            case "constant":
                return self.noise.torque_constant**2
            case "foot":
                return np.full((4, 3), self.noise.foot_position**2)
        raise UnknownNameError("source of force errors", source, SOURCES)


def ground_normal(feet: Array, stance: Bools, up: Array) -> Array:
    """Unit normal (..., 3) of the plane through the feet in stance, on the side of `up` (..., 3).

    By the diagonals of the quadrilateral LF, RF, RH, LH, which is the best plane's normal where four feet are not in
    one plane. A foot that is not in stance is taken to be where its neighbour is, which leaves the triangle of the
    others. With fewer than three feet it is `up` itself.

    Args:
        feet: (..., 4, 3) [m], in the order LF, RF, LH, RH; stance: (..., 4).
    """
    points = feet
    if not stance.all():
        neighbour = feet[..., [1, 0, 3, 2], :]
        points = np.where(stance[..., None], feet, neighbour)
    normal = np.cross(points[..., 1, :] - points[..., 2, :], points[..., 0, :] - points[..., 3, :])
    normal *= np.where((normal * up).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    usable = (stance.sum(axis=-1, keepdims=True) >= 3) & (size > 0)
    return np.where(usable, normal / np.where(usable, size, 1.0), up)


def _squared(matrix: Array, variances: Array) -> Array:
    """M diag(variances) Mᵀ."""
    return np.asarray((matrix * variances[..., None, :]) @ np.swapaxes(matrix, -1, -2))


def _skews(vectors: Array) -> Array:
    """[v]x of vectors (..., 3), shape (..., 3, 3)."""
    return np.asarray((vectors @ _SKEW).reshape(*vectors.shape, 3))
