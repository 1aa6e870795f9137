"""Contact forces at one sample, and their covariance.

With B = J^-T the force is f = B (h - τ). An error δτ of the torque and an error δp of the foot's position change it by

    δf = -B δτ,      δf = -B G δp,   G's rows (f x a_j)ᵀ          as (∂(Jᵀf)_j / ∂p) δp = (a_j x δp) · f

and the moment about the trunk's origin, μ = Σ p x f, by p x δf, and by δp x f for the foot's own error.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import sqrt

import numpy as np

from stadera.inertia import skews
from stadera.trunk.standing.noise import ForceNoise
from stadera.types import Array, Bools


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Forces of the ground on the feet, trunk frame and axes; legs in the robot's order.

    Attributes:
        force: (4, 3) [N]; NaN for a near-singular leg, for which a direction of the force is not determined.
        contact: (4, 3) [m], contact points, on the foot's sphere towards the ground.
        stance: (4,) bool, the loaded feet.
        normal: (3,), unit normal of the ground through the feet in stance.
        jacobian: (4, 3, 3) [m/rad], J of the contacts.
        by_torque: (4, 3, 3) [1/m], J^-T; NaN for a near-singular leg.
        axes: (4, 3, 3), the joints' axes as columns.
        noise: of torques and feet, from which the covariances are computed.
        feet_move_forces: True if the Jacobians are at the measured feet, so that errors of the feet change the forces.
    """

    force: Array
    contact: Array
    stance: Bools
    normal: Array
    jacobian: Array
    by_torque: Array
    axes: Array
    noise: ForceNoise
    feet_move_forces: bool = True

    @cached_property
    def total_force(self) -> Array:
        """Total force on the feet in stance, (3,) [N]."""
        return np.asarray(np.where(self.stance[..., None], self.force, 0.0).sum(axis=-2))

    @cached_property
    def moment(self) -> Array:
        """Moment of the forces on the feet in stance about the trunk's origin, (3,) [N·m]."""
        force = np.where(self.stance[..., None], self.force, 0.0)
        return np.asarray((skews(self.contact) @ force[..., None])[..., 0].sum(axis=-2))

    @property
    def wrench(self) -> Array:
        """(6,): `total_force` and `moment`."""
        return np.concatenate([self.total_force, self.moment], axis=-1)

    @cached_property
    def torque_to_force(self) -> Array:
        """Derivative of each foot's force with respect to its leg's torques, (4, 3, 3) [1/m], -J^-T; zero for a
        near-singular leg.
        """
        return -np.nan_to_num(self.by_torque)

    @cached_property
    def foot_to_force(self) -> Array:
        """Derivative of each foot's force with respect to its position [N/m], (4, 3, 3), -B G."""
        if not self.feet_move_forces:
            return np.zeros_like(self.jacobian)
        rows = np.cross(np.nan_to_num(self.force)[:, None, :], self.axes.swapaxes(-1, -2))  # f x a_j
        return np.asarray(self.torque_to_force @ rows)

    @cached_property
    def wrench_slope(self) -> Array:
        """Derivative (6, 24) of `wrench` with respect to the legs' torques [N·m], then the feet's positions [m], leg by
        leg.
        """
        arms, held = skews(self.contact), skews(np.nan_to_num(self.force))
        by_torque, by_foot = self.torque_to_force, self.foot_to_force
        torque = np.concatenate([by_torque, arms @ by_torque], axis=1)
        foot = np.concatenate([by_foot, arms @ by_foot - held], axis=1)
        slopes = np.concatenate([torque, foot]) * np.tile(self.stance, 2)[:, None, None]
        return np.asarray(slopes.transpose(1, 0, 2).reshape(6, 24))

    @property
    def white_covariance(self) -> Array:
        """Covariance (6, 6) of `wrench` due to the torques' white noise."""
        scaled = self.wrench_slope[:, :12] * self.noise.torque_white.ravel()
        return np.asarray(scaled @ scaled.T)


def ground_normal(feet: Array, stance: Bools, up: Array) -> Array:
    """Unit normal (..., 3) of the plane through the feet in stance, on the side of `up` (..., 3).

    Computed from the diagonals of the quadrilateral LF, RF, RH, LH, which gives the best plane's normal if the four
    feet are not in one plane. A foot that is not in stance is replaced by its neighbour, which leaves the triangle of
    the others. With fewer than three feet the normal is `up`.

    Args:
        feet: (..., 4, 3) [m], in the order LF, RF, LH, RH; stance: (..., 4).
    """
    points = feet
    if not stance.all():
        points = np.where(stance[..., None], feet, feet[..., [1, 0, 3, 2], :])
    elif feet.ndim == 2:
        return _normal_of_four(feet, up)
    normal = np.cross(points[..., 1, :] - points[..., 2, :], points[..., 0, :] - points[..., 3, :])
    normal *= np.where((normal * up).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    usable = (stance.sum(axis=-1, keepdims=True) >= 3) & (size > 0)
    return np.where(usable, normal / np.where(usable, size, 1.0), up)


def _normal_of_four(feet: Array, up: Array) -> Array:
    """`ground_normal` for one sample with four feet in stance, without array overhead, for a controller's loop."""
    lf, rf, lh, rh = feet.tolist()
    ax, ay, az = rf[0] - lh[0], rf[1] - lh[1], rf[2] - lh[2]
    bx, by, bz = lf[0] - rh[0], lf[1] - rh[1], lf[2] - rh[2]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = sqrt(x * x + y * y + z * z)
    if size == 0.0:
        return up
    ux, uy, uz = up.tolist()
    size = size if x * ux + y * uy + z * uz >= 0.0 else -size
    return np.array([x / size, y / size, z / size])
