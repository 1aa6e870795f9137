"""Consistency of a log's motion: loaded feet do not slide, and the trunk's centre of mass does not move in the trunk.

The cost of an instant has two sums of squares. **Feet.** A foot l on the ground, at p_l in the trunk frame and moving
at s_l relative to it, does not move in the world, so s_l + ω x p_l is the same for all loaded feet. Weighted with their
loads w_l, the variance of

    u_l = s_l + ω x p_l

is their sliding. It tests whether encoders and gyro agree on the trunk's rotation, and torques on the loaded feet.
**Balance.** Within a second the trunk's mass m and first moment h are constant, and with the forces on the feet minus
the legs' weight,

    Σ f - m_l a = m a,    Σ p x f - h_l x a = h x a,

four unknowns for six equations per instant. It tests whether torques, encoders and accelerometer agree on how the load
moves from foot to foot as the trunk sways. The legs' accelerations are neglected.

The cost of an instant is log(1 + square / usual²), which limits the influence of feet that touch down or slip and of
swinging legs. The usual value cancels when a log is compared with itself under a hypothesis: `Gain`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.checks.footing import Footing
from stadera.checks.limits import CheckLimits
from stadera.constants import GRAVITY
from stadera.inertia import skews
from stadera.types import Array

_FEWEST = 6  # instants needed to fit a second's trunk
_SEGMENT = 12  # instants whose mean gain counts as one draw, since neighbouring gains are correlated


@dataclass(frozen=True, eq=False)
class MotionCosts:
    """Costs by instant; NaN for instants that are not used.

    Attributes:
        feet, balance: (instants,).
        lively: share of instants in which the robot moves.
    """

    feet: Array
    balance: Array
    lively: float

    @property
    def total(self) -> Array:
        """Sum of both, (instants,), with NaN counted as zero."""
        return np.asarray(np.nan_to_num(self.feet) + np.nan_to_num(self.balance))

    @classmethod
    def of(cls, footing: Footing, limits: CheckLimits) -> MotionCosts:
        """Computes the costs of a log with an IMU."""
        feet, lively = _slide(footing, limits)
        return cls(feet, _unbalance(footing, limits), lively)


@dataclass(frozen=True)
class Gain:
    """Reduction of the costs by a hypothesis.

    Attributes:
        mean: over the instants.
        deviations: the mean divided by its standard deviation, from the scatter of half seconds.
    """

    mean: float
    deviations: float

    @classmethod
    def of(cls, now: MotionCosts, other: MotionCosts) -> Gain:
        """Compares costs with those under a hypothesis. A part available for only one of them is ignored."""
        counted = [np.isfinite(a) & np.isfinite(b) for a, b in ((now.feet, other.feet), (now.balance, other.balance))]
        gain = np.where(counted[0], now.feet - other.feet, 0.0) + np.where(counted[1], now.balance - other.balance, 0.0)
        gain = gain[counted[0] | counted[1]]
        parts = len(gain) // _SEGMENT
        if parts < 2:
            return cls(0.0, 0.0)
        means = np.array([part.mean() for part in np.array_split(gain, parts)])
        std = float(means.std(ddof=1) / np.sqrt(parts))
        mean = float(means.mean())
        return cls(mean, mean / std if std > 0 else 0.0)


def _slide(footing: Footing, limits: CheckLimits) -> tuple[Array, float]:
    """Costs of sliding feet, and the share of instants with motion."""
    omega, length = footing.blocks.angular_velocity, footing.legs.length
    assert omega is not None
    usual = limits.slide * length
    speed = np.nan_to_num(footing.speed)
    motion = (speed**2).sum(axis=(1, 2)) / 4.0 + length**2 * (omega**2).sum(axis=1)
    moving = motion > (limits.lively_motion * usual) ** 2
    load = np.clip(footing.load - limits.carries, 0.0, 1.0)
    enough = (load > 0).sum(axis=1) >= 2
    weight = (load / np.where(enough, load.sum(axis=1), 1.0)[:, None])[..., None]
    velocity = speed + np.cross(omega[:, None], footing.contact)
    spread = (weight * (velocity - (weight * velocity).sum(axis=1, keepdims=True)) ** 2).sum(axis=(1, 2))
    # the variance of a weighted mean of few loses one degree of freedom
    spread /= np.maximum(1.0 - (weight**2).sum(axis=(1, 2)), 1e-3)
    cost = np.where(moving, np.log1p(spread / usual**2), 0.0)
    known = enough & np.isfinite(footing.speed).all(axis=(1, 2))
    return np.where(known, cost, np.nan), float(moving.mean()) if len(moving) else 0.0


def _unbalance(footing: Footing, limits: CheckLimits) -> Array:
    """Costs of torques that do not balance the trunk."""
    a, legs, length = footing.specific_force, footing.legs, footing.legs.length
    weight = footing.robot.mass * GRAVITY
    force = footing.force.sum(axis=1) - legs.leg_mass * a
    moment = np.cross(footing.contact, footing.force).sum(axis=1) - np.cross(footing.leg_moment, a)
    target = np.concatenate([force, moment / length], axis=1)
    rows = np.zeros((len(a), 6, 4))
    rows[:, :3, 0] = a
    rows[:, 3:, 1:] = -skews(a) / length
    cost = np.full(len(a), np.nan)
    for group in np.unique(footing.blocks.group):
        at = np.flatnonzero(footing.blocks.group == group)
        if len(at) < _FEWEST:
            continue
        A, b = rows[at].reshape(-1, 4), target[at].ravel()
        left = (b - A @ np.linalg.lstsq(A, b)[0]).reshape(-1, 6) / weight
        cost[at] = np.log1p((left**2).sum(axis=1) / limits.unbalance**2)
    return cost
