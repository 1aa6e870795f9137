"""Finds a step of one joint's torque sensor on a robot that moves.

An offset c of joint k that begins at t₀ adds E_k(t) c to the trunk's rows from then on (`torque_order.InstantRows`). A
load that comes then adds A(t) δ instead, δ its mass and first moment. Within some seconds around t₀,

    A θ + [t > t₀] A δ + C p + [t > t₀] E_k c = b,

θ and δ are eliminated, p has its usual size, and c is as large as its standard deviation z times; z² is compared for
all joints and times. Legs that swing tell c from a load: no foot in the air carries. A robot must move all the time: as
it begins to move, friction lets go of all joints, which looks like a step. A push from outside that begins at t₀ adds a
nearly constant force and moment, which an offset imitates: the two look alike.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stadera.checks.footing import Footing
from stadera.checks.limits import CheckLimits
from stadera.checks.motion import moving
from stadera.checks.torque_order import InstantRows, Likelihood, sums
from stadera.types import Array, Bools


@dataclass(frozen=True)
class TorqueStep:
    """A step of a torque sensor."""

    joints: tuple[str, ...]  # the joint that explains it best, and those that explain it about as well
    time: float  # [s], to within about half a second
    size: float  # of the first joint [N·m], later minus earlier offset of the recorded torque
    deviations: float  # z of the first joint


def torque_step(footing: Footing, limits: CheckLimits) -> TorqueStep | None:
    """The step with the largest z, if it is beyond chance and no small one; None if there is none."""
    blocks = footing.blocks
    if not blocks.complete:
        return None
    spans = list(_spans(blocks.time, moving(footing, limits), limits))
    if not spans:
        return None
    rows = InstantRows.of(footing, recorded=True)
    (squares, sizes), (span, at) = _likeliest(rows, spans, limits)
    best = int(np.argmax(squares))
    if squares[best] < limits.step_gain or abs(sizes[best]) < limits.step_least:
        return None
    names = [joint for leg in footing.robot.legs for joint in leg.joints]
    alike = [k for k in np.argsort(-squares) if squares[k] > squares[best] - limits.step_alike]
    if len(alike) > limits.step_alike_most:
        return None
    size = float(sizes[best] * rows.limit[best])
    return TorqueStep(
        tuple(names[k] for k in alike), float(blocks.time[span.start + at]), size, float(np.sqrt(squares[best]))
    )


def _likeliest(
    rows: InstantRows, spans: Sequence[tuple[slice, int]], limits: CheckLimits
) -> tuple[tuple[Array, Array], tuple[slice, int]]:
    """z² and size by joint, where z is largest among every second stretch and its neighbours; and that stretch."""
    recorded = rows.both @ sums(rows.both.shape[1], rows.fixed)
    recorded[:, 1:] = recorded[:, 1:] @ rows.root
    found = {k: _tested(rows, recorded, *spans[k], limits) for k in range(0, len(spans), 2)}
    near = max(found, key=lambda k: float(found[k][0].max()))
    found |= {k: _tested(rows, recorded, *spans[k], limits) for k in (near - 1, near + 1) if 0 <= k < len(spans)}
    k = max(found, key=lambda k: float(found[k][0].max()))
    return found[k], spans[k]


def _spans(time: Array, lively: Bools, limits: CheckLimits) -> Iterator[tuple[slice, int]]:
    """Yields stretches around possible steps, without gaps, in which the robot moves before and after; and the first
    instant after the step.
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else limits.instant
    half, least, every = (max(1, round(x / step)) for x in (limits.step_span, limits.step_side, limits.step_every))
    for at in range(least, len(time) - least + 1, every):
        begin, end = max(at - half, 0), min(at + half, len(time))
        whole = time[end - 1] - time[begin] < 1.1 * (end - begin) * step
        if whole and min(lively[begin:at].mean(), lively[at:end].mean()) > limits.step_lively:
            yield slice(begin, end), at - begin


def _tested(rows: InstantRows, recorded: Array, span: slice, at: int, limits: CheckLimits) -> tuple[Array, Array]:
    """z² (12,) and size (12,) as a share of the limit, by joint; z² is 0 where the rows do not tell it from a load, and
    for all joints if the rows fit badly.
    """
    part = slice(6 * span.start, 6 * span.stop)
    A, both = rows.matrix[part], recorded[part]
    after = (np.arange(len(A)) >= 6 * at)[:, None]
    trunk = np.hstack([A, A[:, :4] * after])
    basis = np.linalg.qr(np.vstack([trunk, limits.loose * np.eye(trunk.shape[1])]))[0][: len(A)]
    columns = np.hstack([both, rows.by_offset[part] * after])
    explained = basis.T @ columns
    products, p = columns.T @ columns - explained.T @ explained, both.shape[1]
    fit = Likelihood.of(products[:p, :p], len(A) - trunk.shape[1], limits.order_repeated)
    if fit.variance > limits.order_repeated * limits.step_scatter**2:
        return np.zeros(12), np.zeros(12)
    # what p, of its usual size, explains is taken out of b and of the steps
    weight = (fit.vector / (fit.variance + fit.value)) @ fit.vector.T
    by_errors = products[p:, 1:p] @ weight
    along = products[p:, 0] - by_errors @ products[1:p, 0]
    left = np.maximum(np.diagonal(products)[p:] - (by_errors * products[p:, 1:p]).sum(axis=1), 1e-12)
    seen = left > limits.step_seen * (columns[:, p:] ** 2).sum(axis=0)
    return np.where(seen, along**2 / left / fit.variance, 0.0), along / left
