"""Hypotheses of torques that the trunk's rows decide while the robot moves: another order of legs, a step of a sensor.

As the trunk sways, the load moves from foot to foot, and each leg's torques follow its own foot's load. The rows of the
trunk (`stadera.body`), at instants of 40 ms, are

    A θ + C p = b + noise,        b = Σ_l E_l (h_l - τ_π(l)) - Σ_l w_l

for torques in the order π, or with the sign of one joint reversed, θ the trunk's ten parameters, unknown in every
second, and p the errors that robots have: friction, rotor inertia, offsets, gains, lag, encoder zeros and the IMU, with
their usual sizes Σ. After θ is eliminated, N equations with residual r remain, and with the noise's variance s² chosen
best

    -2 log L(π) = min_s [ rᵀ (s² k 1 + C Σ Cᵀ)⁻¹ r + N/k log s² + log |1 + Σ Cᵀ C / s² k| ],

k instants sharing one error. Another order than the recorded one is found where

- its forces are possible on average (`stadera.checks.statics`): in a squat all legs do the same, and with the torques
  of a front and a hind leg whose knees bend the other way these two pull at the ground, and a robot of hardly any
  weight fits better than the right one. Then no other order counts, either;
- it gains more than by chance in any of the orders, also without the second that it gains most in: swapped torques are
  wrong all the time, a load that lands or a push for a moment;
- it gains as much over any other order: where several gain alike, what they gain is something else, such as friction of
  a slow sway;
- it explains the motion itself, with a residual s of a few per cent of the weight. Where neither order does, something
  else is wrong with the log or the model, and their difference tells nothing.

It is certain if it also gains where a constant force and moment from outside, unknown in every second, may act; else it
is a doubt: a few of a hundred clean sways that are slow and short seem to have one. A robot at rest shows no order by
this: there static friction varies more than the load. Two legs whose torques are swapped at rest push against each
other, if the feet are not below the hips. Friction can hold that, so it is a doubt and not a contradiction.

**Steps.** An offset c of joint k that begins at t₀ adds E_k(t) c from then on, or all the time if it was there before.
A load that comes at t₀ adds A(t) δ instead, δ its mass and first moment. Within some seconds around t₀,

    A θ + [t > t₀] A δ + C p + [t > t₀] (E_k c + Σ_j [|q̇_j| small] E_j s_j) = b,

θ and δ are eliminated, p has its usual size, and c is as large as its standard deviation z times; z² is compared for
all joints and times. Instants share one error as long as what the likeliest step leaves is correlated: in a slow sway
friction that turns with the motion lasts. s_j is a change of the static friction that holds joint j while it hardly
moves, as in a crawl's stance: hips of two legs may push against each other. Legs that swing tell c from a load: no foot
in the air carries. A robot must move all the time: as it begins to, friction lets go of all joints, which looks like a
step. A push from outside that begins at t₀ adds a nearly constant force and moment, which an offset imitates: the two
look alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from stadera.body import Motion, State, discounted
from stadera.body.friction import direction
from stadera.checks.finding import Finding
from stadera.checks.hypotheses import Hypothesis, joint_signs, mirrors, torque_orders
from stadera.checks.likelihood import Likelihood, Products, explained, less
from stadera.checks.residual import Footing, Gain
from stadera.checks.statics import Consistency
from stadera.inertia import skews
from stadera.logs.mend import AS_RECORDED, Mend
from stadera.trunk.block_rows import unit_of_rows
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.history import wide_prior
from stadera.trunk.settings import ModelErrors, TrunkSettings
from stadera.trunk.wrench import TRUNK_MAP, trunk_signals, wrench_of_specific_force
from stadera.types import Array

_ERRORS = ("rotor", "viscous", "coulomb", "offset", "imu_rotation", "accelerometer", "gain", "torque_lag", "encoder")
"""Errors of `stadera.trunk.error_model`; in the order of C's columns."""

Second = tuple[NDArray[np.int64], Array]
"""Rows of a second, and an orthonormal basis of what is another one in every second."""


@dataclass(frozen=True, eq=False)
class TrunkRows:
    """Rows of the trunk at n instants, in units of 1 % of the weight; all but the torques is evaluated once."""

    footing: Footing
    motion: Motion
    state: State
    hidden: Array  # (n, 6, L), what no joint tells of the contacts, of unit variance
    displaced: list[State]  # with the k-th joints of all legs displaced by `step`
    matrix: Array  # (6 n, 10), A, with θ in units of the robot's mass and leg length
    by_force: Array  # (6, 3), of the trunk's wrench by the specific force
    scale: Array  # (6, 1), the unit [N, N·m]
    root: Array  # (1 + p, 1 + p), of b, which it leaves, and root of the errors' covariance
    limit: Array  # (J,) [N·m], limits of the torques, by leg
    held: Array  # (J,), standard deviation of a change of static friction from rest to rest, share of the limit
    step: ClassVar[float] = 1e-4  # rad, of the differences by joint positions

    @classmethod
    def of(cls, footing: Footing) -> TrunkRows | None:
        """The rows of a log with an IMU; None of others."""
        robot, b, body = footing.robot, footing.blocks, footing.body
        if not b.complete or b.angular_velocity is None:
            return None
        omega, alpha, a = b.angular_velocity, b.slopes(b.angular_velocity), footing.at_origin
        motion = Motion(b.position, b.rate, b.slopes(b.rate), omega, alpha, a, footing.up)
        shifts = np.zeros((body.most, len(body.joints)))
        for leg in body.legs:
            shifts[range(len(leg)), leg] = cls.step
        still, rest = np.tile(b.position.mean(axis=0), (3, 1)), np.zeros((3, 3))
        fed = body.at(Motion(still, 0.0 * still, 0.0 * still, rest, rest, np.eye(3), np.zeros(3)))
        trunk = robot.inertias[robot.trunk]
        scale = unit_of_rows(robot)[:, None]
        A = (TRUNK_MAP @ trunk_signals(a.T, omega.T, alpha.T)).T.reshape(-1, 6, 10) / scale
        state = body.at(motion)
        hidden = state.unfelt.swapaxes(1, 2) * robot.unfelt_std / scale
        model = ErrorModel(robot, ModelErrors())
        chosen = model.layout.at(*_ERRORS)
        root = np.eye(1 + len(chosen))
        root[1:, 1:] = np.linalg.cholesky(model.covariance[np.ix_(chosen, chosen)])
        return cls(
            footing,
            motion,
            state,
            hidden,
            [body.at(motion._replace(position=b.position + shift)) for shift in shifts],
            discounted(A * wide_prior(robot), hidden).reshape(-1, 10),
            wrench_of_specific_force(trunk.mass, trunk.first_moment) + fed.inertial.sum(axis=1).T,
            scale,
            root,
            model.limit,
            np.sqrt(2.0 * (1.0 - model.renewed)) * model.held * model.resting / model.limit,
        )

    def columns(self, undo: Mend = AS_RECORDED) -> Array:
        """(6 n, 1 + p): b and C, after a correction of the torques."""
        body, motion, blocks = self.footing.body, self.motion, self.footing.blocks.after(undo)
        J = body.in_legs
        torque, rate, q_rate = blocks.effort[:, J], blocks.slopes(blocks.effort)[:, J], motion.velocity[:, J]
        E = np.moveaxis(self.state.to_wrench[:, J], 1, 2)
        states = (self.state, *self.displaced)
        own, *moved = (body.contacts(s, body.left(s, motion, blocks.effort)) - s.inertial[:, :-1] for s in states)
        place = np.concatenate([np.arange(len(leg)) for leg in body.legs])
        by_joint = (np.array(moved)[place, :, body.leg_of[J]] - own[:, body.leg_of[J]].swapaxes(0, 1)) / self.step
        terms = motion.acceleration[:, J], q_rate, direction(q_rate), np.ones_like(q_rate)
        parts = [own.sum(axis=1)[..., None], *(-E * x[:, None] for x in terms)]
        parts += [self.by_force @ skews(motion.specific_force), np.tile(-self.by_force, (len(E), 1, 1))]
        parts += [-E * torque[:, None], (E @ rate[..., None]), np.moveaxis(by_joint, 0, 2)]
        return discounted(np.concatenate(parts, axis=2) / self.scale, self.hidden).reshape(6 * len(E), -1)

    @cached_property
    def steps(self) -> Array:
        """(6 n, J), of an offset of each torque by its limit."""
        steps = -np.moveaxis(self.state.to_wrench[:, self.footing.body.in_legs], 1, 2) * self.limit / self.scale
        return np.asarray(discounted(steps, self.hidden).reshape(-1, len(self.limit)))

    def seconds(self, *, pushed: bool = False) -> list[Second]:
        """Rows of each second, and what θ, and with `pushed` a force and moment from outside, explains of them."""
        group, outside = np.repeat(self.footing.blocks.group, 6), 10.0 * np.tile(np.eye(6), (len(self.matrix) // 6, 1))
        matrix = np.hstack([self.matrix, outside]) if pushed else self.matrix
        each = [np.flatnonzero(group == one) for one in np.unique(group)]
        return [(at, explained(matrix[at], self.footing.limits.loose)) for at in each]

    def by_second(self, seconds: list[Second], undo: Mend = AS_RECORDED) -> Products:
        """Of the log after a correction, without what is another one in every second."""
        columns = self.columns(undo) @ self.root
        counts = [max(len(at) - basis.shape[1], 0) for at, basis in seconds]
        found = np.array([less(columns[at], basis) for at, basis in seconds])
        return Products(found, np.array(counts, dtype=float), np.zeros(len(counts)))


def likelier(now: Footing, other: Footing) -> bool:
    """True if a log of the same instants balances the trunk better than another one, by more than friction and other
    errors of models explain; not without an IMU.
    """
    costs = []
    for rows in (TrunkRows.of(now), TrunkRows.of(other)):
        if rows is None:
            return False
        costs.append(rows.by_second(rows.seconds()).likelihood(now.limits.order_repeated).cost)
    return bool(costs[0] - costs[1] > now.limits.order_gain)


def misread_in_motion(footing: Footing) -> tuple[list[Hypothesis], float] | None:
    """The order of the legs' torques, or the joint of another sign (one hypothesis, or two that explain it alike), that
    explains the motion better, known if it does so even where something may push or pull the robot, and twice its gain
    in log likelihood; None if the log as recorded is not worse than by chance, or the robot is at rest, or there is no
    IMU.
    """
    limits = footing.limits
    rows = TrunkRows.of(footing.thinned(limits.motion_instants))
    if rows is None or len(footing.blocks) < limits.order_fewest or footing.lively <= limits.lively_share:
        return None

    # friction of joints that rest turns with no motion, and takes any sign
    signs = dict(joint_signs(footing.robot.tree.joints)) if footing.lively > limits.step_lively else {}
    recorded, alone = Hypothesis("", "as recorded", AS_RECORDED), rows.seconds()
    hypotheses = (recorded, *torque_orders(footing.robot, limits.orders), *signs)
    seconds = {one: rows.by_second(alone, one.undo) for one in hypotheses}
    fits = {one: each.likelihood(limits.order_repeated) for one, each in seconds.items()}
    ranked = sorted(fits, key=lambda one: fits[one].cost)
    best, rival = (*ranked, recorded)[:2]
    fit = fits[best]
    error = 0.01 * np.sqrt(fit.variance / limits.order_repeated)
    if best is recorded or fits[rival].cost - fit.cost <= limits.order_gain or error > limits.order_fits:
        return None
    if Consistency.of(rows.footing.after(best.undo)).faults:
        return None
    always = seconds[recorded].gains_always(seconds[best], 0.5 * limits.order_gain, limits.order_repeated)
    if not always or (best in signs and not _shows_sign(rows.footing, best)):
        return None
    pushed = rows.seconds(pushed=True)
    now, other = (rows.by_second(pushed, one.undo).likelihood(limits.order_repeated) for one in (recorded, best))
    known = now.cost - other.cost > limits.order_certain
    named = _whose_sign(rows.footing, best, signs[best]) if best in signs else [best]
    return [replace(one, known=known) for one in named], fits[recorded].cost - fit.cost


def _shows_sign(footing: Footing, sign: Hypothesis) -> bool:
    """True if the torque of a joint that may have the other sign varies by more than friction."""
    ((_, joint),) = sign.undo.joint_factors
    k = footing.body.joints.index(joint)
    return bool(footing.blocks.effort[:, k].std() > footing.limits.sign_torque * footing.robot.effort_limits[k])


def _whose_sign(footing: Footing, torque: Hypothesis, whole: Hypothesis) -> list[Hypothesis]:
    """Whether a joint's torque alone has the other sign or all of its values, or both where nothing tells."""
    logs = (footing.after(torque.undo), footing.after(whole.undo))

    def nearer(now: Footing, other: Footing) -> bool:
        return likelier(now, other) or Gain.of(now, other).confirms(footing.limits.gain, footing.limits)

    return [whole] if nearer(*logs) else [torque] if nearer(*logs[::-1]) else [torque, whole]


def pushing_at_rest(footing: Footing) -> Iterator[str]:
    """Yields pairs of left and right feet that push against each other, and would not with their torques swapped; one
    clause each.
    """
    legs, limits = footing.robot.legs, footing.limits
    order = next((order for order, what in mirrors(footing.robot).items() if what.startswith("left")), ())
    for a, b in ((a, b) for a, b in enumerate(order) if a < b and len(legs[a].joints) == len(legs[b].joints)):
        pairs = [*zip(legs[a].joints, legs[b].joints, strict=True)]
        exchange = {("effort", one): other for pair in pairs for one, other in (pair, pair[::-1])}
        swapped = footing.after(Mend("", swapped=exchange))
        now, other = _push(footing, a, b), _push(swapped, a, b)
        load = float(footing.load[:, [a, b]].mean()) * footing.weight
        if abs(now) > limits.pushing * load and abs(other) < limits.push_left * abs(now):
            yield (
                f"feet {legs[a].name} and {legs[b].name} would push against each other with {abs(now):.3g} N under "
                f"{load:.3g} N each; with their torques swapped they would not"
            )


def _push(footing: Footing, a: int, b: int) -> float:
    """Mean force of two feet against each other, along the level line between them [N]."""
    up, contact, force = footing.up.mean(axis=0), footing.contact.mean(axis=0), footing.force.mean(axis=0)
    line = contact[b] - contact[a]
    line -= up * (line @ up)
    return float((force[b] - force[a]) @ line) / (2.0 * float(np.linalg.norm(line)))


def torque_step(footing: Footing) -> tuple[Finding, float] | None:
    """The step or offset that is the clearest, and its z², if it is beyond what is needed; None if there is none, or no
    IMU.
    """
    limits, rows = footing.limits, TrunkRows.of(footing)
    spans = [] if rows is None else list(_spans(footing))
    if rows is None or not spans:
        return None
    recorded = rows.columns() @ rows.root
    landed, least = _landed(rows, recorded, spans), limits.step_gain + 2.0 * np.log(len(spans))
    every = range(len(spans))
    parts = {k: _Stretch.of(rows, recorded, landed, *spans[k]) for k in every[::2]}
    if max(float(part.tested[0].max()) for part in parts.values()) < least:
        return None
    parts |= {k: _Stretch.of(rows, recorded, landed, *spans[k]) for k in every[1::2]}
    k, kind, squares = _clearest(np.array([parts[k].tested[0] for k in every]))
    (span, at), best, sizes = spans[k], int(np.argmax(squares)), parts[k].tested[1][kind]
    alike = [j for j in np.argsort(-squares) if squares[j] > squares[best] - limits.step_alike]
    z = float(squares[best]) / max(parts[k].repeated(kind, best) / limits.order_repeated, 1.0)
    if z < least or len(alike) > limits.step_alike_most:
        return None
    size = f"{sizes[best] * rows.limit[best]:.3g} N·m"
    joints = [joint for leg in footing.robot.legs for joint in leg.joints]
    text = _said([joints[j] for j in alike], size, np.sqrt(z), lasting=bool(kind))
    return Finding("torque_step", text, at=None if kind else float(footing.blocks.time[span.start + at])), z


def _clearest(squares: Array) -> tuple[int, int, Array]:
    """The stretch of the clearest step or, with the kind 1, offset, and z² by joint, of all stretches' (spans, 2, L k).
    Another load, at yet another time, looks like an offset; what is there all the time shows in all.
    """
    steps, offsets = squares.swapaxes(0, 1)
    k, lasting = int(np.argmax(steps.max(axis=1))), offsets.min(axis=0)
    if lasting.max() > steps.max():
        return int(np.argmin(offsets[:, np.argmax(lasting)])), 1, lasting
    return k, 0, steps[k]


def _said(joints: Sequence[str], size: str, deviations: float, lasting: bool) -> str:
    how, since = (f"is {size} off all the time", "all the time") if lasting else (f"jumps by {size}", "since then")
    return (
        f"the torque of {' or '.join(map(repr, joints[:3]))} {how}, which neither the motion nor a load explains "
        f"({deviations:.1f} standard deviations); or something pushes or pulls the robot {since}, which looks alike"
    )


def _spans(footing: Footing) -> Iterator[tuple[slice, int]]:
    """Yields stretches around possible steps, without gaps, in which the robot moves before and after, and no joint is
    at its mechanical stop, which carries a torque unseen; and the first instant after the step.
    """
    limits, time, lively = footing.limits, footing.blocks.time, footing.moving
    away = np.abs(footing.blocks.position[:, :, None] - footing.robot.stops).min(axis=(1, 2))
    step = float(np.median(np.diff(time))) if len(time) > 1 else limits.instant
    half, least, every = (max(1, round(x / step)) for x in (limits.step_span, limits.step_side, limits.step_every))
    for at in range(least, len(time) - least + 1, every):
        begin, end = max(at - half, 0), min(at + half, len(time))
        whole = time[end - 1] - time[begin] < 1.1 * (end - begin) * step
        free = away[begin:end].min() > TrunkSettings.stop
        if whole and free and min(lively[begin:at].mean(), lively[at:end].mean()) > limits.step_lively:
            yield slice(begin, end), at - begin


def _landed(rows: TrunkRows, recorded: Array, spans: Sequence[tuple[slice, int]]) -> int:
    """The instant from which on a load is likeliest in a stretch around it, by b and the errors' columns, `recorded`
    (6 n, 1 + p): to where it is tested, then to an instant. A load that lands at another time than a step is tested at
    looks like a step there.
    """
    limits = rows.footing.limits

    def gain(span: slice, at: int) -> float:
        part, after = slice(6 * span.start, 6 * span.stop), (np.arange(6 * (span.stop - span.start)) >= 6 * at)[:, None]
        A, values = rows.matrix[part], recorded[part]
        without, with_load = (
            Likelihood.of(
                less(values, explained(matrix, limits.loose)), len(A) - matrix.shape[1], limits.order_repeated
            )
            for matrix in (A, np.hstack([A, A[:, :4] * after]))
        )
        return without.cost - with_load.cost

    span, at = max(spans, key=lambda each: gain(*each))
    around = round(limits.step_every / limits.instant)
    return int(span.start) + max(range(at - around, at + around + 1), key=lambda k: gain(span, k))


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Rows around a possible step, without what the trunk and its loads explain of them."""

    rows: TrunkRows
    columns: Array  # (6 n, 1 + p + 2 L k), of b, errors, a step and an offset all the time of each torque
    size: Array  # (2 L k,), squares of the steps' and offsets' own columns
    errors: int  # 1 + p
    fit: Likelihood  # without a step

    @classmethod
    def of(cls, rows: TrunkRows, recorded: Array, landed: int, span: slice, at: int) -> _Stretch:
        """Between the ends of a span, of a step at the instant `at` of it, and a load that came when one `landed`."""
        limits, part = rows.footing.limits, slice(6 * span.start, 6 * span.stop)
        A, offset = rows.matrix[part], rows.steps[part]
        after, loaded = ((np.arange(len(A)) >= 6 * k)[:, None] for k in (at, landed - span.start))
        rests = np.abs(rows.footing.blocks.rate[span][:, rows.footing.body.in_legs]) < limits.step_slides
        errors = np.hstack([recorded[part], offset * after * rows.held * np.repeat(rests, 6, axis=0)])
        columns, p = np.hstack([errors, offset * after, offset]), errors.shape[1]
        trunk = np.hstack([A, A[:, :4] * after, A[:, :4] * loaded])
        basis = explained(trunk, limits.loose)
        own = columns - basis @ (basis.T @ columns)
        fit = Likelihood.of(own[:, :p].T @ own[:, :p], len(A) - trunk.shape[1], limits.order_repeated)
        return cls(rows, own, (columns[:, p:] ** 2).sum(axis=0), p, fit)

    @cached_property
    def left(self) -> Array:
        """b, steps and offsets (6 n, 1 + 2 L k) without what errors of their usual size explain."""
        errors, fit = self.columns[:, 1 : self.errors], self.fit
        others = np.delete(self.columns, range(1, self.errors), axis=1)
        weight = (fit.vector / (fit.variance + fit.value)) @ fit.vector.T
        return np.asarray(others - errors @ (weight @ (errors.T @ others)))

    @cached_property
    def tested(self) -> tuple[Array, Array]:
        """z² (2, L k) and size (2, L k) as a share of the limit, of a step and of an offset all the time, by joint; far
        below where they are small or the rows do not tell them from a load, and for all joints if the rows fit badly.
        """
        limits, n = self.rows.footing.limits, len(self.rows.limit)
        if self.fit.variance > limits.order_repeated * limits.step_scatter**2:
            return np.full((2, n), -np.inf), np.zeros((2, n))
        steps = self.columns[:, self.errors :]
        along = steps.T @ self.left[:, 0]
        left = np.maximum((steps * self.left[:, 1:]).sum(axis=0), 1e-12)
        sizes = (along / left).reshape(2, n)
        seen = (left > limits.step_seen * self.size).reshape(2, n)
        seen &= np.abs(sizes) > np.array([[limits.step_least], [limits.offset_least]])
        squares = (along**2 / left / self.fit.variance).reshape(2, n)
        return np.where(seen, squares, -np.inf), sizes

    def repeated(self, kind: int, joint: int) -> float:
        """Number of successive instants that share one error, by what a step, or with the kind 1 an offset, leaves: one
        and twice the sum of its correlations with itself, up to where they end.
        """
        b, step = self.left[:, 0], self.left[:, 1 + kind * len(self.rows.limit) + joint]
        rest = (b - step * (step @ b) / (step @ step)).reshape(-1, 6)
        square, total = float((rest**2).sum()), 1.0
        for k in range(1, len(rest)):
            correlation = float((rest[k:] * rest[:-k]).sum()) / square
            if correlation < self.rows.footing.limits.step_alone:
                break
            total += 2.0 * correlation
        return total
