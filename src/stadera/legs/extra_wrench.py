"""Inertial wrench of moving links that belong to no leg (an arm, a turning lidar), to be taken from the trunk's rows.

The trunk's parameters θ contain these links at a reference position. Where they move, they differ from it by

    Δw = Σ_i w_i(q, q̇, q̈, ω, α, a) - A(ω, α, a) φ

with w_i the inertial wrench of link i about the trunk's origin and φ the ten parameters of all of them at the
reference. The rows of `stadera.legs.base_wrench` become A θ = b - Δw, and θ stays constant.

A link hangs from its parent at r, turns about s or slides along it, and so moves as (outwards, trunk axes)

    turning:  ω_i = ω + s q̇,   α_i = α + s q̈ + ω x s q̇,   a_i = a + α x r + ω x (ω x r)
    sliding:  ω_i = ω,         α_i = α,                    a_i = a + α x r + ω x (ω x r) + 2 ω x s q̇ + s q̈

where a_i is the specific force at its joint, o. With its first moment h and inertia I there,

    F = m a_i + α_i x h + ω_i x (ω_i x h),    M = h x a_i + I α_i + ω_i x I ω_i + o x F
"""

from typing import NamedTuple

import numpy as np

from stadera.inertia import InertialParameters
from stadera.legs.model import cross, rotated, rotated_back
from stadera.robot.extra import ExtraJoints, turned_about
from stadera.types import Array


class _Body(NamedTuple):
    """Motion of a link: rotation to trunk axes (3, 3, n), joint's position and the rest (3, n)."""

    turn: Array
    origin: Array
    omega: Array
    alpha: Array
    a: Array


def extra_wrench(
    extra: ExtraJoints,
    position: Array,
    velocity: Array,
    acceleration: Array,
    angular_velocity: Array,
    angular_acceleration: Array,
    specific_force: Array,
) -> Array:
    """Δw, (6, n) [N, N·m]: force above moment about the trunk's origin, trunk axes. Joints' states are (n, k), the
    trunk's motion (3, n), at its origin, in its axes.
    """
    n = len(position)
    still = np.repeat(np.eye(3)[..., None], n, axis=2)
    trunk = _Body(still, np.zeros((3, n)), angular_velocity, angular_acceleration, specific_force)
    links: list[_Body] = []
    wrench = -_wrench(trunk, extra.lumped)
    for k, parent in enumerate(extra.parents):
        state = position[:, k], velocity[:, k], acceleration[:, k]
        links.append(_next(trunk if parent < 0 else links[parent], extra, k, *state))
        wrench += _wrench(links[-1], extra.bodies[k])
    return wrench


def _next(parent: _Body, extra: ExtraJoints, k: int, q: Array, qd: Array, qdd: Array) -> _Body:
    turn = np.einsum("ijn,jk->ikn", parent.turn, extra.rotations[k])
    s = np.einsum("ijn,j->in", turn, extra.axes[k])
    r = np.einsum("ijn,j->in", parent.turn, extra.translations[k])
    omega, alpha = parent.omega, parent.alpha
    if extra.sliding[k]:
        r = r + s * q
        own = 2.0 * cross(omega, s * qd) + s * qdd
    else:
        turn, own = np.einsum("ijn,jkn->ikn", turn, turned_about(extra.axes[k], q)), np.zeros_like(r)
    a = parent.a + cross(parent.alpha, r) + cross(parent.omega, cross(parent.omega, r)) + own
    if not extra.sliding[k]:
        omega, alpha = omega + s * qd, alpha + s * qdd + cross(omega, s * qd)
    return _Body(turn, parent.origin + r, omega, alpha, a)


def _wrench(link: _Body, body: InertialParameters) -> Array:
    turn, origin, omega, alpha, a = link
    h = np.einsum("ijn,j->in", turn, body.first_moment)
    force = body.mass * a + cross(alpha, h) + cross(omega, cross(omega, h))

    def inertia(v: Array) -> Array:
        return rotated(turn, np.asarray(body.inertia @ rotated_back(turn, v)))

    moment = cross(h, a) + inertia(alpha) + cross(omega, inertia(omega)) + cross(origin, force)
    return np.concatenate([force, moment])
