"""The residual that all hypotheses are compared by: what a log's signals, taken together, leave unexplained.

Encoders and torques give the force of the ground on each foot, f = J^-T (h - τ) for legs at rest under the actual
specific force (`stadera.body`): the effect of their accelerations cancels over steps, and is zero at rest. Then, at
each instant,

**Feet.** A foot l on the ground, at p_l in the trunk frame and moving at s_l relative to it, is at rest in the world:
s_l + ω x p_l is the same for all loaded feet. Weighted with their loads, its variance is their sliding: whether
encoders and gyro agree on the trunk's rotation, and torques on the loaded feet.

**Balance.** Within a second the trunk's mass m and first moment h are constant, and with b the wrench of the feet minus
that of the legs' weight,

    [a ; -[a]x h] (m, h) = b,

four unknowns for six equations an instant: whether torques, encoders and accelerometer agree on how the load moves from
foot to foot as the trunk sways.

The cost of an instant is log(1 + square / usual²), which limits the influence of feet that touch down or slip and of
swinging legs. The usual value cancels when a log is compared with itself under a hypothesis: `Gain`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from stadera.body import Body, Motion, State, discounted
from stadera.checks.instants import Instants
from stadera.checks.limits import CheckLimits
from stadera.constants import GRAVITY
from stadera.inertia import skews
from stadera.logs.mend import Mend
from stadera.robot.imu import force_at_origin
from stadera.robot.model import Robot
from stadera.types import Array, Bools


@lru_cache(maxsize=16)
def body_of(robot: Robot) -> Body:
    """The robot's legs and trunk, cached."""
    return Body.of(robot, others=False)


@dataclass(frozen=True, eq=False)
class Footing:
    """Kinematics and forces of the L legs at the instants of a log, trunk frame; joints in the tree's order."""

    robot: Robot
    blocks: Instants
    limits: CheckLimits

    def after(self, mend: Mend) -> Footing:
        """The footing at the same instants of the log after a correction."""
        after, now = replace(self, blocks=self.blocks.after(mend)), self.blocks
        if after.blocks.position is now.position and after.blocks.specific_force is now.specific_force is not None:
            after.__dict__["state"] = self.state  # torques and gyro are no part of it
        return after

    def thinned(self, most: int) -> Footing:
        """The footing at no more than so many instants, by whole seconds."""
        return replace(self, blocks=self.blocks.thinned(most, self.limits))

    @property
    def body(self) -> Body:
        """The robot's legs and trunk."""
        return body_of(self.robot)

    @property
    def weight(self) -> float:
        """Of the model [N]."""
        return self.robot.mass * GRAVITY

    @cached_property
    def specific_force(self) -> Array:
        """(instants, 3) [m/s²], of the IMU; without one along the total contact force, which the legs' weight hardly
        turns.
        """
        if self.blocks.specific_force is not None:
            return self.blocks.specific_force
        a = np.tile([0.0, 0.0, GRAVITY], (len(self.blocks), 1))
        for _ in range(self.limits.rounds):
            state = self._at_rest(a)
            a = GRAVITY * unit(self._contacts(state)[..., :3].sum(axis=1))
        return a

    @cached_property
    def at_origin(self) -> Array:
        """The same of the trunk's origin: an IMU 0.3 m before it feels 5 % of the weight of a sway as well."""
        blocks, omega = self.blocks, self.blocks.angular_velocity
        if omega is None:
            return self.specific_force
        return force_at_origin(self.specific_force, omega, blocks.lever, blocks.slopes(omega))

    @cached_property
    def up(self) -> Array:
        """(instants, 3), unit vectors along the specific force."""
        return unit(self.specific_force)

    @cached_property
    def state(self) -> State:
        """Dynamics of the legs at rest."""
        return self._at_rest(self.specific_force)

    def _at_rest(self, specific_force: Array) -> State:
        """Of a leg that is nearly singular no force is determined."""
        body, q, still, none = self.body, self.blocks.position, 0.0 * self.blocks.position, 0.0 * specific_force
        state = body.at(Motion(q, still, still, none, none, specific_force, unit(specific_force)))
        felt = np.abs(state.volume) >= self.limits.unfelt * self.robot.leg_length**3
        return replace(state, to_wrench=np.where(felt[:, body.leg_of, None], state.to_wrench, 0.0))

    def _contacts(self, state: State) -> Array:
        return self.body.contacts(state, (state.torque - self.blocks.effort)[:, self.body.in_legs])

    @cached_property
    def force(self) -> Array:
        """Force of the ground on the feet, (instants, L, 3) [N]."""
        return self._contacts(self.state)[..., :3]

    @cached_property
    def target(self) -> Array:
        """b, (instants, 6) [N, N·m]."""
        return self.body.target(self.state, self._contacts(self.state))

    @cached_property
    def contact(self) -> Array:
        """Points of contact, (instants, L, 3) [m]."""
        return np.asarray(self.state.feet - self.body.radii[:, None] * self.up[:, None])

    @cached_property
    def load(self) -> Array:
        """Upward force on each foot, share of the weight, (instants, L)."""
        return np.asarray(np.einsum("nli,ni->nl", self.force, self.up) / self.weight)

    @cached_property
    def speed(self) -> Array:
        """Of the points of contact relative to the trunk, (instants, L, 3) [m/s]; NaN where it is not known."""
        body, legs = self.body, self.body.in_legs
        arm = self.contact[:, body.leg_of[legs]] - self.state.origin[:, legs]
        moved = np.cross(self.state.axis[:, legs], arm) * self.blocks.rate[:, legs, None]
        return np.asarray(np.add.reduceat(moved, body.starts, axis=1))

    @cached_property
    def moving(self) -> Bools:
        """Instants in which the robot moves, (instants,); none without an IMU."""
        limits, length, omega = self.limits, self.robot.leg_length, self.blocks.angular_velocity
        if omega is None:
            return np.zeros(len(self.blocks), dtype=bool)
        feet = (np.nan_to_num(self.speed) ** 2).sum(axis=2).mean(axis=1)
        least = limits.lively_motion * limits.slide * length
        return np.asarray(feet + length**2 * (omega**2).sum(axis=1) > least**2)

    @cached_property
    def spread(self) -> Array:
        """Variance of the loaded feet's velocities in the world, (instants,) [m²/s²]; NaN for instants that are not
        used, all without an IMU.
        """
        omega, load = self.blocks.angular_velocity, np.clip(self.load - self.limits.carries, 0.0, 1.0)
        if omega is None:
            return np.full(len(load), np.nan)
        enough = (load > 0).sum(axis=1) >= 2
        weight = (load / np.where(enough, load.sum(axis=1), 1.0)[:, None])[..., None]
        velocity = np.nan_to_num(self.speed) + np.cross(omega[:, None], self.contact)
        spread = (weight * (velocity - (weight * velocity).sum(axis=1, keepdims=True)) ** 2).sum(axis=(1, 2))
        # the variance of a weighted mean of few loses one degree of freedom
        spread /= np.maximum(1.0 - (weight**2).sum(axis=(1, 2)), 1e-3)
        return np.where(enough & np.isfinite(self.speed).all(axis=(1, 2)), spread, np.nan)

    @cached_property
    def sliding(self) -> Array:
        """Cost of feet that slide, (instants,); NaN for instants that are not used."""
        return np.log1p(self.spread / (self.limits.slide * self.robot.leg_length) ** 2)

    @cached_property
    def unbalance(self) -> Array:
        """Cost of torques that do not balance the trunk, (instants,); NaN for instants that are not used."""
        a, length, group = self.at_origin, self.robot.leg_length, self.blocks.group
        if not len(a):
            return np.empty(0)
        scale, none = np.array([1.0, 1.0, 1.0, *[length] * 3]), np.zeros((len(a), 3, 3))
        A = np.concatenate([np.dstack([a, none]), np.dstack([none[..., 0], -skews(a) / length])], axis=1)
        least = self.limits.unbalance * self.weight
        hidden = self.state.unfelt.swapaxes(1, 2) * self.robot.unfelt_std / (least * scale[:, None])
        A, b = np.split(discounted(np.dstack([A, self.target / scale]), hidden), [-1], axis=2)
        first, count = np.unique(group, return_index=True, return_counts=True)[1:]
        squares = np.add.reduceat(A.transpose(0, 2, 1) @ A, first)
        along = np.add.reduceat((A.transpose(0, 2, 1) @ b)[..., 0], first)
        solution = (np.linalg.pinv(squares, rcond=1e-12, hermitian=True) @ along[..., None])[..., 0]
        left = b[..., 0] - (A @ np.repeat(solution, count, axis=0)[..., None])[..., 0]
        cost = np.log1p((left**2).sum(axis=1) / least**2)
        return np.where(np.repeat(count >= self.limits.fewest, count), cost, np.nan)

    def costs(self, other: Footing) -> tuple[Array, Array]:
        """`sliding` and `unbalance` of this log and of another one, (2, instants) each.

        Feet slide at no cost in instants in which the robot moves by neither of the two; one alone does not decide it,
        for by a gyro that is divided away no robot moves.
        """
        rests = ~(self.moving | other.moving)
        own, others = (np.where(rests, 0.0 * each.sliding, each.sliding) for each in (self, other))
        return np.stack([own, self.unbalance]), np.stack([others, other.unbalance])

    def fits(self, recorded: Footing) -> bool:
        """True if a correction leaves little of the cost of the log as recorded, of the part that it changes."""
        parts = zip(*recorded.costs(self), strict=True)
        changed = [pair for pair in parts if not np.array_equal(*pair, equal_nan=True)]
        now, left = np.array([[_mean(part) for part in pair] for pair in changed]).reshape(-1, 2).sum(axis=0)
        return bool(left < self.limits.better * now)

    @property
    def turning(self) -> float:
        """Root mean square of the trunk's angular velocity [rad/s], of a log with an IMU."""
        assert self.blocks.angular_velocity is not None
        return float(np.sqrt((self.blocks.angular_velocity**2).sum(axis=1).mean()))

    @property
    def lively(self) -> float:
        """Share of instants in which the robot moves."""
        return float(self.moving.mean()) if len(self.blocks) else 0.0

    @property
    def least_gain(self) -> float:
        """Decrease of an instant's cost that confirms a hypothesis: at rest static friction counts."""
        return self.limits.gain if self.lively > self.limits.lively_share else self.limits.gain_at_rest

    @property
    def slides(self) -> float:
        """Median sliding speed of loaded feet [m/s]."""
        return float(np.sqrt(np.nanmedian(self.spread))) if np.isfinite(self.spread).any() else 0.0


@dataclass(frozen=True)
class Gain:
    """Reduction of the cost of an instant by a hypothesis."""

    mean: float  # over the instants
    deviations: float  # the mean divided by its standard deviation, from the scatter of half seconds
    slides: float = 0.0  # the part by feet that slide less, over the instants

    @classmethod
    def of(cls, now: Footing, other: Footing) -> Gain:
        """Compares a log with another one. A part of the cost available for only one of them is ignored."""
        before, after = now.costs(other)
        gains = before - after
        slides, balance = np.nan_to_num(gains)[:, np.isfinite(gains).any(axis=0)]
        parts = len(slides) // (now.limits.second // 2)
        if parts < 2:
            return cls(0.0, 0.0)
        means = np.array([part.mean() for part in np.array_split(slides + balance, parts)])
        std = float(means.std(ddof=1) / np.sqrt(parts))
        return cls(float(means.mean()), float(means.mean()) / std if std > 0 else 0.0, float(slides.mean()))

    def confirms(self, least: float, limits: CheckLimits) -> bool:
        """True if it is at least this large, and certain."""
        return self.mean >= least and self.deviations >= limits.deviations

    def is_plain(self, limits: CheckLimits) -> bool:
        """True if it is so large and certain that much may remain unexplained."""
        return self.mean >= limits.plain_gain and self.deviations >= limits.plain_deviations


def _mean(cost: Array) -> float:
    """Over the instants that are used; zero if there are none."""
    used = cost[np.isfinite(cost)]
    return float(used.mean()) if len(used) else 0.0


def unit(vectors: Array) -> Array:
    """Vectors (n, 3) divided by their lengths; zero stays zero."""
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(size > 0, size, 1.0))
