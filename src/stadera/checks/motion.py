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

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from stadera.body.statics import cross
from stadera.checks.footing import Footing
from stadera.checks.limits import CheckLimits
from stadera.constants import GRAVITY
from stadera.inertia import skews
from stadera.types import Array, Bools

Places = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class MotionCosts:
    """Costs of a log with an IMU by instant, computed on first use."""

    footing: Footing  # the instants
    limits: CheckLimits  # with the usual values

    @cached_property
    def balance(self) -> Array:
        """Of torques that do not balance the trunk, (instants,); NaN for instants that are not used."""
        return _unbalance(self.footing, self.limits)

    @property
    def feet(self) -> Array:
        """Of feet that slide, (instants,); NaN for instants that are not used."""
        return self._slide[0]

    @property
    def mean(self) -> float:
        """Of both together over the instants that are used."""
        parts = [part[np.isfinite(part)] for part in (self.feet, self.balance)]
        return float(sum(part.mean() for part in parts if len(part)))

    @property
    def lively(self) -> float:
        """Share of instants in which the robot moves."""
        return self._slide[1]

    @cached_property
    def _slide(self) -> tuple[Array, float]:
        return _slide(self.footing, self.limits)


@dataclass(frozen=True)
class Gain:
    """Reduction of the costs by a hypothesis."""

    mean: float  # over the instants
    deviations: float  # the mean divided by its standard deviation, from the scatter of half seconds

    @classmethod
    def of(cls, now: MotionCosts, other: MotionCosts) -> Self:
        """Compares costs with those under a hypothesis. A part available for only one of them is ignored."""
        counted = [np.isfinite(a) & np.isfinite(b) for a, b in ((now.feet, other.feet), (now.balance, other.balance))]
        gain = np.where(counted[0], now.feet - other.feet, 0.0) + np.where(counted[1], now.balance - other.balance, 0.0)
        means = _means(gain[counted[0] | counted[1]], now.limits.segment)
        if len(means) < 2:
            return cls(0.0, 0.0)
        std = float(means.std(ddof=1) / np.sqrt(len(means)))
        mean = float(means.mean())
        return cls(mean, mean / std if std > 0 else 0.0)

    @staticmethod
    def most(now: MotionCosts, other: Array) -> float:
        """Upper bound of the mean, without the other's sliding, and with its balance (instants,), zero where it is not
        known: no cost is below zero.
        """
        balance = now.balance - other
        if not np.isfinite(balance).all():
            return np.inf
        means = _means(np.nan_to_num(now.feet) + balance, now.limits.segment)
        return float(means.mean()) if len(means) > 1 else 0.0


def _means(gain: Array, segment: int) -> Array:
    """Means of successive parts of at least `segment` instants; fewer than two if there are too few instants."""
    parts = len(gain) // segment
    first = np.arange(parts) * (len(gain) // max(parts, 1)) + np.minimum(np.arange(parts), len(gain) % max(parts, 1))
    return np.asarray(np.add.reduceat(gain, first) / np.diff(first, append=len(gain)))


def moving(footing: Footing, limits: CheckLimits) -> Bools:
    """Instants in which the robot moves, (instants,), of a log with an IMU."""
    omega, length = footing.blocks.angular_velocity, footing.legs.length
    assert omega is not None
    motion = (np.nan_to_num(footing.states.speed) ** 2).sum(axis=(0, 1)) / 4.0 + length**2 * (omega**2).sum(axis=1)
    return np.asarray(motion > (limits.lively_motion * limits.slide * length) ** 2)


def _slide(footing: Footing, limits: CheckLimits) -> tuple[Array, float]:
    """Costs of sliding feet, and the share of instants with motion."""
    omega, length, states = footing.blocks.angular_velocity, footing.legs.length, footing.states
    assert omega is not None
    usual = limits.slide * length
    speed, moves = np.nan_to_num(states.speed), moving(footing, limits)
    carried = (footing.forces * footing.up.T[:, None]).sum(axis=0) / (footing.robot.mass * GRAVITY)
    load = np.clip(carried - limits.carries, 0.0, 1.0)
    enough = (load > 0).sum(axis=0) >= 2
    weight = load / np.where(enough, load.sum(axis=0), 1.0)
    velocity = speed + cross(omega.T[:, None], states.contact)
    spread = (weight * (velocity - (weight * velocity).sum(axis=1, keepdims=True)) ** 2).sum(axis=(0, 1))
    # the variance of a weighted mean of few loses one degree of freedom
    spread /= np.maximum(1.0 - (weight**2).sum(axis=0), 1e-3)
    cost = np.where(moves, np.log1p(spread / usual**2), 0.0)
    known = enough & np.isfinite(states.speed).all(axis=(0, 1))
    return np.where(known, cost, np.nan), float(moves.mean()) if len(moves) else 0.0


def _unbalance(footing: Footing, limits: CheckLimits) -> Array:
    """Costs of torques that do not balance the trunk."""
    a, legs, length, forces = footing.specific_force.T, footing.legs, footing.legs.length, footing.forces
    weight = footing.robot.mass * GRAVITY
    moment = cross(footing.states.contact, forces).sum(axis=1) - cross(footing.states.moment.sum(axis=1), a)
    target = np.concatenate([forces.sum(axis=1) - legs.leg_mass * a, moment / length])
    cost = np.full(len(footing.blocks), np.nan)
    for at, explained in footing.known.once(
        _balances, footing.specific_force, footing.blocks.group, length, limits.fewest
    ):
        b = target[:, at].transpose(1, 2, 0).reshape(len(at), -1, 1)
        left = (b - explained @ (explained.transpose(0, 2, 1) @ b)).reshape(*at.shape, 6) / weight
        cost[at] = np.log1p((left**2).sum(axis=2) / limits.unbalance**2)
    return cost


def _balances(specific_force: Array, group: Array, length: float, fewest: int) -> list[tuple[Places, Array]]:
    """For groups of equally many instants, at least `fewest`: these (groups, n), and an orthonormal basis (groups, 6 n,
    4) of what the trunk's mass and first moment explain, zero in directions that they do not affect.
    """
    rows = np.zeros((len(specific_force), 6, 4))
    rows[:, :3, 0] = specific_force
    rows[:, 3:, 1:] = -skews(specific_force) / length
    order, count = np.argsort(group, kind="stable"), np.bincount(group)
    first, found = np.cumsum(count) - count, []
    for n in np.unique(count[count >= fewest]):
        at = order[first[count == n][:, None] + np.arange(n)]
        basis, size, _ = np.linalg.svd(rows[at].reshape(len(at), -1, 4), full_matrices=False)
        seen = size > 6 * n * np.finfo(float).eps * size[:, :1]
        found.append((at, basis * seen[:, None]))
    return found
