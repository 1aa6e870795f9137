"""Tests whether the torques of a moving robot explain its motion better if they are those of other legs.

As the trunk sways, the load moves from foot to foot, and each leg's torques follow its own foot's load. The rows of the
trunk (`stadera.body`), at instants of 40 ms, are

    A θ + C p = b + noise,        b = Σ_l E_l (h_l - τ_π(l)) - Σ_l w_l

for torques in the order π, with θ the trunk's ten parameters, unknown in every second, and p the errors that robots
have: friction, rotor inertia, offsets, gains, lag, encoder zeros and the IMU, with their usual sizes Σ. After θ is
eliminated, N equations with residual r remain, and with the noise's variance s² chosen best

    -2 log L(π) = min_s [ rᵀ (s² k 1 + C Σ Cᵀ)⁻¹ r + N/k log s² + log |1 + Σ Cᵀ C / s² k| ],

k instants sharing one error. Another order than the recorded one is found where

- it gains more than by chance in any of 23 orders, also without the second that it gains most in: swapped torques are
  wrong all the time, a load that lands or a push for a moment;
- it explains the motion itself, with a residual s of a few per cent of the weight. Where neither order does, something
  else is wrong with the log or the model, and their difference tells nothing.

It is certain if it also gains where a constant force and moment from outside, unknown in every second, may act. A robot
at rest shows no order by this: there static friction varies more than the load.

Two legs whose torques are swapped at rest push against each other, if the feet are not below the hips. Friction can
hold that, so it is a doubt and not a contradiction.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stadera.body import Body, Motion
from stadera.body.friction import direction
from stadera.checks.footing import Footing
from stadera.checks.hypotheses import FaultHypothesis, torque_orders
from stadera.checks.instants import Instants
from stadera.checks.limits import CheckLimits
from stadera.checks.motion import MotionCosts
from stadera.constants import GRAVITY, NOTHING
from stadera.inertia import skews
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.settings import ModelErrors
from stadera.trunk.wrench import TRUNK_MAP, trunk_signals
from stadera.types import Array

_STEP = 1e-4  # rad, of the differences by joint positions
_SCALES = np.logspace(-3.0, 3.0, 49)  # s², in rows of 1 % of the weight
_OF_TORQUES = ("gain", "torque_lag", "encoder")
_OTHERS = ("rotor", "viscous", "coulomb", "offset", "imu_rotation", "accelerometer")
_PAIRS = ((0, 1), (2, 3))  # front and hind feet


@dataclass(frozen=True, eq=False)
class SwappedTorques:
    """The hypothesis that torques are recorded in another order of the legs, twice its gain in log likelihood, and
    whether it is certain: likelier also where something may push or pull the robot.
    """

    hypothesis: FaultHypothesis
    gain: float
    certain: bool


def swapped_in_motion(footing: Footing, limits: CheckLimits) -> SwappedTorques | None:
    """The order of torques that explains the motion better; None if the recorded one is not worse than by chance, or
    the robot is at rest.
    """
    blocks = footing.blocks
    if not blocks.complete:
        return None
    if len(blocks) < limits.order_fewest or MotionCosts(footing, limits).lively <= limits.lively_share:
        return None
    if len(blocks) > limits.order_instants:
        footing = Footing(footing.robot, blocks.thinned(limits.order_instants, limits))
    rows, group = InstantRows.of(footing), footing.blocks.group

    def gain(of: _Rows, order: Sequence[int]) -> float:
        return of.fitted((0, 1, 2, 3), limits).cost - of.fitted(order, limits).cost

    free = _Rows.of(rows, group, limits)
    recorded = free.fitted((0, 1, 2, 3), limits).cost
    found = [(recorded - free.fitted(order, limits).cost, order, what) for order, what in torque_orders(footing.robot)]
    most, order, best = max(found, key=lambda entry: entry[0])
    if most <= limits.order_gain or free.fitted(order, limits).residual(limits) > limits.order_fits:
        return None
    if min(gain(free.without(k), order) for k in range(len(free.seconds))) <= 0.5 * limits.order_gain:
        return None
    certain = gain(_Rows.of(rows, group, limits, pushed=True), order) > limits.order_certain
    return SwappedTorques(best, most, certain)


def pushing_at_rest(footing: Footing, limits: CheckLimits) -> Iterator[str]:
    """Yields pairs of feet that push against each other, and would not with their torques swapped; one clause each."""
    robot, columns, blocks = footing.robot, footing.legs.columns, footing.blocks
    for a, b in _PAIRS:
        order = np.arange(len(robot.tree.joints))
        order[[*columns[a], *columns[b]]] = [*columns[b], *columns[a]]
        swapped = Footing(robot, replace(blocks, effort=blocks.effort[:, order]), footing.known)
        now, other = _push(footing, a, b), _push(swapped, a, b)
        load = float(np.einsum("nli,ni->nl", footing.force, footing.up)[:, [a, b]].mean())
        if abs(now) > limits.pushing * load and abs(other) < limits.push_left * abs(now):
            yield (
                f"feet {robot.legs[a].name} and {robot.legs[b].name} would push against each other with "
                f"{abs(now):.3g} N under {load:.3g} N each; with their torques swapped they would not"
            )


def _push(footing: Footing, a: int, b: int) -> float:
    """Mean force of two feet against each other, along the level line between them [N]."""
    up, contact, force = footing.up.mean(axis=0), footing.contact.mean(axis=0), footing.force.mean(axis=0)
    line = contact[b] - contact[a]
    line -= up * (line @ up)
    return float((force[b] - force[a]) @ line) / (2.0 * float(np.linalg.norm(line)))


@dataclass(frozen=True, eq=False)
class _Rows:
    """Products of all columns that rows of some instants are made of, in units of 1 % of the weight.

    b and the columns of C that depend on the torques are sums over the legs, each linear in the torques τ_m that the
    leg is given. So the rows of any order of torques are sums of columns of leg l with torques m, and their products
    follow from those of these columns, summed over the instants once.
    """

    # (seconds, c, c), after θ is eliminated, of the columns: b without torques; `fixed` errors that do not depend on
    # the torques; by m, l and joint -E τ; by m and l E τ̇; and by m, l and displaced joint ∂b/∂q
    seconds: Array
    fixed: int  # number of errors that do not depend on the torques
    counts: NDArray[np.int64]  # (seconds,), numbers of rows less θ's
    root: Array  # (p, p), root of the errors' covariance

    @classmethod
    def of(cls, rows: InstantRows, group: NDArray[np.int64], limits: CheckLimits, *, pushed: bool = False) -> _Rows:
        """With another trunk in every second, and with `pushed` another constant force and moment from outside."""
        seconds, counts, second = [], [], np.repeat(group, 6)
        for one in np.unique(group):
            at = np.flatnonzero(second == one)
            A = np.hstack([rows.matrix[at], outside(len(at))]) if pushed else rows.matrix[at]
            weak = limits.loose * np.eye(A.shape[1])
            explained = np.linalg.qr(np.vstack([A, weak]))[0][: len(at)].T @ rows.both[at]
            seconds.append(rows.both[at].T @ rows.both[at] - explained.T @ explained)
            counts.append(max(len(at) - A.shape[1], 0))
        return cls(np.array(seconds), rows.fixed, np.array(counts), rows.root)

    def without(self, second: int) -> _Rows:
        """The same without one of the seconds."""
        return replace(self, seconds=np.delete(self.seconds, second, 0), counts=np.delete(self.counts, second))

    def fitted(self, order: Sequence[int], limits: CheckLimits) -> Likelihood:
        """Likelihood of the torques in this order."""
        chosen = sums(self.seconds.shape[1], self.fixed, order)
        products = chosen.T @ self.seconds.sum(axis=0) @ chosen
        products[1:] = self.root.T @ products[1:]
        products[:, 1:] = products[:, 1:] @ self.root
        return Likelihood.of(products, int(self.counts.sum()), limits.order_repeated)


@dataclass(frozen=True, eq=False)
class InstantRows:
    """Rows of the trunk at some instants, in units of 1 % of the weight."""

    # (6 n, c), columns as in `_Rows.seconds`; of each leg with its recorded torques alone, if only those were asked
    # for
    both: Array
    fixed: int  # number of errors that do not depend on the torques
    matrix: Array  # (6 n, 10), A, with θ in units of the robot's mass and leg length
    root: Array  # (p, p), root of the errors' covariance
    by_offset: Array  # (6 n, 12), effect on b of offsets of the torques, each of the size of its limit
    limit: Array  # (12,) [N·m], by leg and joint

    @classmethod
    def of(cls, footing: Footing, *, recorded: bool = False) -> InstantRows:
        """Computes the rows of a log with an IMU; with `recorded`, for the recorded order of the torques alone, which
        takes a quarter of the memory.
        """
        robot, b = footing.robot, footing.blocks
        body, length = Body.of(robot, others=False), robot.leg_length
        legs = body.in_legs.reshape(4, 3)
        a, omega, velocity = footing.specific_force, b.angular_velocity, b.rate
        assert omega is not None
        qd, torque = velocity[:, legs], b.effort[:, legs]
        acceleration, alpha, rate = slopes(velocity, b), slopes(omega, b), slopes(torque, b)
        qdd = acceleration[:, legs]

        def at(position: Array) -> _Wrenches:
            return _Wrenches.of(body, Motion(position, velocity, acceleration, omega, alpha, a, footing.up))

        def moved(joint: int) -> Array:
            step = np.zeros(len(body.joints))
            step[legs[:, joint]] = _STEP
            return np.asarray(b.position + step)

        wrenches, displaced = at(b.position), [at(moved(joint)) for joint in range(3)]
        scale = 0.01 * robot.mass * GRAVITY * np.array([1.0, 1.0, 1.0, *[length] * 3])
        model = ErrorModel(robot, ModelErrors(), length)
        places = model.layout.places
        chosen = np.concatenate([np.arange(model.layout.count)[places[name]] for name in (*_OTHERS, *_OF_TORQUES)])
        root = np.linalg.cholesky(model.covariance[np.ix_(chosen, chosen)])
        E, n = wrenches.to_wrench, len(b)
        moment = robot.inertias[robot.trunk].first_moment + footing.states.moment.sum(axis=1).mean(axis=1)
        by_force = np.concatenate([robot.mass * np.eye(3), skews(moment)])  # of the whole robot
        by_joint = [_flat(-E * x, scale) for x in (qdd, qd, direction(qd), np.ones_like(qd))]
        by_imu = [(x / scale[:, None]).reshape(6 * n, 3) for x in (by_force @ skews(a), np.tile(-by_force, (n, 1, 1)))]
        fixed = np.hstack([*by_joint, *by_imu])
        unloaded = wrenches.target(np.zeros_like(torque)).sum(axis=2)
        of_leg = [slice(None)] if recorded else [slice(m, m + 1) for m in range(4)]
        of_torques = _by_torques(wrenches, displaced, torque, rate, of_leg)
        both = np.hstack([_flat(unloaded, scale), fixed, *(_flat(x, scale) for x in of_torques)])
        matrix = (TRUNK_MAP @ trunk_signals(a.T, omega.T, alpha.T)).T.reshape(n, 6, 10) / scale[:, None]
        size = robot.mass * np.array([1.0, *[0.5 * length] * 3, *[0.5 * length**2] * 6])
        return cls(
            both, fixed.shape[1], (matrix * size).reshape(6 * n, 10), root, _flat(-E, scale) * model.limit, model.limit
        )


@dataclass(frozen=True, eq=False)
class _Wrenches:
    """The legs' side of the rows at n instants: E (6, n, 4, 3), h (n, 4, 3), inertial wrenches (6, n, 4)."""

    to_wrench: Array
    torque: Array
    inertial: Array

    @classmethod
    def of(cls, body: Body, motion: Motion) -> _Wrenches:
        state, legs = body.at(motion), body.in_legs.reshape(4, 3)
        torque = state.torque + body.friction(motion.velocity, motion.velocity)
        return cls(
            state.to_wrench[:, legs].transpose(3, 0, 1, 2), torque[:, legs], state.inertial[:, :4].transpose(2, 0, 1)
        )

    def target(self, effort: Array) -> Array:
        """b by leg (6, n, 4), from efforts (n, 4, 3) [N·m]."""
        return np.asarray((self.to_wrench * (self.torque - effort)).sum(axis=-1) - self.inertial)


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Of rows from which θ was eliminated."""

    cost: float  # -2 log L
    variance: float  # s² k of a row
    # value, vector: eigenvalues and vectors of Cᵀ C, with p in units of its usual size
    value: Array
    vector: Array

    def residual(self, limits: CheckLimits) -> float:
        """s, standard deviation of a row, as a share of the weight."""
        return float(0.01 * np.sqrt(self.variance / limits.order_repeated))

    @classmethod
    def of(cls, products: Array, count: int, repeated: float) -> Likelihood:
        """From the products of b and C, (1 + p, 1 + p), over `count` rows, of which `repeated` share an error."""
        value, vector = np.linalg.eigh(products[1:, 1:])
        value, along = np.maximum(value, 0.0), (vector.T @ products[1:, 0]) ** 2
        k = repeated * _SCALES[:, None]
        squares = (products[0, 0] - (along / (k + value)).sum(axis=1)) / k[:, 0]
        costs = squares + count / repeated * np.log(_SCALES) + np.log1p(value / k).sum(axis=1)
        best = int(np.argmin(costs))
        return cls(float(costs[best]), float(k[best, 0]), value, vector)


def _by_torques(
    wrenches: _Wrenches, displaced: Sequence[_Wrenches], torque: Array, rate: Array, of_leg: Sequence[slice]
) -> list[Array]:
    """Columns of b and C that depend on the torques and their rates (n, 4, 3), see `_Rows.seconds`, for each leg in
    `of_leg`, whose torques all legs are given; all legs for each with its own.
    """
    E = wrenches.to_wrench
    given = [np.broadcast_to(torque[:, legs], torque.shape) for legs in of_leg]
    late = [(E * rate[:, legs]).sum(axis=3) for legs in of_leg]
    turned = []
    for effort in given:
        own = wrenches.target(effort)
        turned.append(np.stack([(moved.target(effort) - own) / _STEP for moved in displaced], -1))
    return [*(-E * effort for effort in given), *late, *turned]


def outside(rows: int) -> Array:
    """Effect (rows, 6) of a constant force and moment from outside, of any size."""
    return 10.0 * np.tile(np.eye(6), (rows // 6, 1))


def sums(columns: int, fixed: int, order: Sequence[int] = (0, 0, 0, 0)) -> Array:
    """(c, 1 + p): which of `InstantRows.both` make b and C of the torques in this order; of rows of the recorded order
    alone without it.
    """
    first = 1 + fixed
    pairs = (columns - first) // 7  # (m, l): by joint, in sum, and displaced by joint
    legs = 4 * np.array(order) + np.arange(4)  # places of (m, l)
    joints = (3 * legs[:, None] + np.arange(3)).ravel()
    out = np.zeros((columns, first + 12 + 1 + 12))
    out[np.arange(first), np.arange(first)] = 1.0
    out[first + joints, 0] = 1.0
    out[first + joints, first + np.arange(12)] = 1.0
    out[first + 3 * pairs + legs, first + 12] = 1.0
    out[first + 4 * pairs + joints, first + 13 + np.arange(12)] = 1.0
    return out


def _flat(values: Array, scale: Array) -> Array:
    """(6, n, ...) as rows (6 n, k), instant by instant, in units of `scale`."""
    six = values.reshape(6, values.shape[1], -1) / scale[:, None, None]
    return np.asarray(six.transpose(1, 0, 2).reshape(-1, six.shape[2]))


def slopes(values: Array, blocks: Instants) -> Array:
    """Derivatives (instants, ...) [1/s], by central differences within each stretch, one-sided at its ends."""
    out = np.zeros_like(values)
    if len(blocks) < 2:
        return out
    wide = (slice(None), *[None] * (values.ndim - 1))
    steps, joined = np.diff(blocks.time), np.diff(blocks.group) == 0
    between = np.diff(values, axis=0) / steps[wide]
    before, after = np.append(False, joined), np.append(joined, False)
    # the slope on either side counts as much as the step on the other side is long; the only one, fully
    left = np.where(before, np.where(after, np.append(steps, 1.0), 1.0), 0.0)
    right = np.where(after, np.where(before, np.append(1.0, steps), 1.0), 0.0)
    total = np.maximum(left + right, NOTHING)
    out[1:] += (left / total)[1:][wide] * between
    out[:-1] += (right / total)[:-1][wide] * between
    return out
