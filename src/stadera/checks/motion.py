"""How well a log's motion fits together: feet that carry do not slide, and the trunk's centre of mass stays in it.

Two sums of squares for each instant. **Feet.** A foot l on the ground, at p_l in the trunk frame and moving at s_l as
seen from it, does not move in the world, so s_l + ω x p_l is the same for all feet that carry. Weighted with their
loads w_l, the variance of

    u_l = s_l + ω x p_l

is what they slide. It needs encoders and gyro to agree on how the trunk turns, and torques on which feet carry.
**Balance.** In a second the trunk's mass m and first moment h are constant, and with what the feet do to the robot,
less the legs' weight,

    Σ f - m_l a = m a,    Σ p x f - h_l x a = h x a,

four unknowns for six equations an instant. It needs torques, encoders and accelerometer to agree on how the load moves
from foot to foot as the trunk sways. Legs' accelerations are left out.

The cost of an instant is log(1 + square / usual²), so that feet that touch down or slip, and swinging legs, count for
little. What is usual cancels where a log is compared with itself, changed by a hypothesis: `Gain`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.checks.footing import Footing
from stadera.checks.limits import CheckLimits
from stadera.constants import GRAVITY
from stadera.inertia import skews
from stadera.types import Array

_FEWEST = 6  # instants in which a second's trunk can be fitted
_SEGMENT = 12  # instants whose mean gain counts as one draw: gains of neighbours are alike


@dataclass(frozen=True, eq=False)
class MotionCosts:
    """Costs by instant; NaN where an instant does not count.

    Attributes:
        feet, balance: (instants,).
        lively: share of the instants in which the robot moves.
    """

    feet: Array
    balance: Array
    lively: float

    @property
    def total(self) -> Array:
        """(instants,), their sum, NaN counted as nothing."""
        return np.asarray(np.nan_to_num(self.feet) + np.nan_to_num(self.balance))

    @classmethod
    def of(cls, footing: Footing, limits: CheckLimits) -> MotionCosts:
        """Of a log with an IMU."""
        feet, lively = _slide(footing, limits)
        return cls(feet, _unbalance(footing, limits), lively)


@dataclass(frozen=True)
class Gain:
    """By how much a hypothesis lowers the costs.

    Attributes:
        mean: over the instants.
        deviations: the mean over its standard deviation, by the scatter of half seconds.
    """

    mean: float
    deviations: float

    @classmethod
    def of(cls, now: MotionCosts, other: MotionCosts) -> Gain:
        """Of costs as they are against those under a hypothesis. A part that only one of them has counts in neither."""
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
    """Costs of feet that slide, and the share of instants in which anything moves."""
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
    # the variance of a weighted mean of few takes one degree of freedom
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
