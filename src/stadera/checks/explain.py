"""Selects the fault hypothesis that explains contradictions, on average over a log or in its motion.

A hypothesis is confirmed if undoing the fault removes all impossible properties and reduces the cost: on average to a
small share, in motion by more than chance. Of several, the one of least cost is chosen, and those that fit equally well
are named with it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import Self

import numpy as np

from stadera.checks.footing import Footing, Known
from stadera.checks.hypotheses import FaultHypothesis, hypotheses_at_rest, hypotheses_in_motion, torque_scales
from stadera.checks.instants import Instants
from stadera.checks.limits import CheckLimits
from stadera.checks.motion import Gain, MotionCosts
from stadera.checks.statics import Consistency, ConsistencyModel
from stadera.types import Array, Bools


@dataclass(frozen=True, eq=False)
class Explanation:
    """The hypothesis that best explains the contradictions, the figures after undoing its fault, and at most two others
    that explain them about as well.
    """

    hypothesis: FaultHypothesis
    without: Consistency
    others: tuple[FaultHypothesis, ...]


def explain(blocks: Instants, model: ConsistencyModel) -> Explanation | None:
    """The hypothesis that explains what is impossible on average; None if none does."""
    robot, limits = model.robot, model.limits
    footing = Footing(robot, blocks.thinned(limits.trial_instants, limits))
    now = model.evaluate(footing)
    scales = torque_scales(robot, now.loads / now.weight, limits.lightest, limits.heaviest)
    fitting: list[tuple[float, FaultHypothesis, Consistency]] = []
    for hypothesis in chain(hypotheses_at_rest(robot, imu=now.imu), scales):
        without = model.evaluate(footing.under(hypothesis.undo))
        if without.cost <= limits.much_better * now.cost and not any(without.faults()):
            fitting.append((without.cost, hypothesis, without))
    if not fitting:
        return None
    least = min(cost for cost, _, _ in fitting)
    _, best, without = next(entry for entry in fitting if entry[0] <= least + limits.same)
    near = sorted((cost, k) for k, (cost, other, _) in enumerate(fitting) if other is not best)
    others = tuple(fitting[k][1] for cost, k in near if cost < least + limits.similar)[:2]
    return Explanation(best, without, others)


@dataclass(frozen=True, eq=False)
class MotionExplanation:
    """The hypothesis that makes the motion more consistent, its reduction of the cost, whether it then fits, the median
    speed of loaded feet as recorded and after undoing the fault [m/s], and at most two others with about the same gain.
    """

    hypothesis: FaultHypothesis
    gain: Gain
    fits: bool
    slides: float
    would_slide: float
    others: tuple[FaultHypothesis, ...]


def explain_motion(footing: Footing, model: ConsistencyModel) -> MotionExplanation | None:
    """The hypothesis that makes the motion of a log with an IMU, possible on average, more consistent; None if none
    does.
    """
    robot, limits, blocks = model.robot, model.limits, footing.blocks
    if blocks.angular_velocity is None or not np.isfinite(blocks.rate).any():
        return None
    footing = replace(footing, known=Known())  # what is known of other hypotheses is not kept
    now = MotionCosts(footing, limits)
    excerpt = Excerpt.of(footing, limits)
    fitting: list[tuple[Gain, FaultHypothesis, MotionCosts]] = []
    for hypothesis in hypotheses_in_motion(robot):
        without = footing.under(hypothesis.undo)
        costs, needed = MotionCosts(without, limits), _needed(hypothesis, now, limits)
        if any(Gain.most(now, balance) < needed for balance in _balances(hypothesis, excerpt, costs)):
            continue
        gain = Gain.of(now, costs)
        if gain.mean >= needed and gain.deviations >= limits.deviations and not any(model.evaluate(without).faults()):
            fitting.append((gain, hypothesis, costs))
    if not fitting:
        return None
    fitting.sort(key=lambda entry: -entry[0].mean)
    gain, best, costs = fitting[0]
    others = tuple(other for g, other, _ in fitting[1:3] if g.mean > limits.alike * gain.mean)
    length = footing.legs.length
    fits, slides = costs.mean < limits.better * now.mean, _speed(now, length, limits)
    return MotionExplanation(best, gain, fits, slides, _speed(costs, length, limits), others)


@dataclass(frozen=True)
class LateImu:
    """The IMU's values arrive later than the joints' by `late` [s], earlier if negative; `gain` of undoing that."""

    late: float
    gain: Gain


def late_imu(footing: Footing, limits: CheckLimits) -> LateImu | None:
    """The delay of the IMU against the joints that makes the motion most consistent; None if none does."""
    b = footing.blocks
    omega, force = b.angular_velocity, b.specific_force
    if omega is None or force is None or len(b) < limits.order_fewest:
        return None
    step, found = float(np.median(np.diff(b.time))), []
    for k in range(-limits.late_instants, limits.late_instants + 1):
        here = np.arange(max(-k, 0), len(b) - max(k, 0))
        here = here[b.group[here] == b.group[here + k]]
        if k and len(here):
            shifted = replace(b.at(here), angular_velocity=omega[here + k], specific_force=force[here + k])
            now, then = (MotionCosts(Footing(footing.robot, each), limits) for each in (b.at(here), shifted))
            found.append(LateImu(k * step, Gain.of(now, then)))
    best = max(found, key=lambda each: each.gain.mean, default=None)
    if best is None or best.gain.mean < limits.gain or best.gain.deviations < limits.deviations:
        return None
    return best


def _needed(hypothesis: FaultHypothesis, now: MotionCosts, limits: CheckLimits) -> float:
    """The gain that confirms a hypothesis."""
    least = limits.gain if now.lively > limits.lively_share else limits.gain_at_rest
    return least * limits.rare if hypothesis.rare else least


@dataclass(frozen=True, eq=False)
class Excerpt:
    """A few of the seconds of a log with an IMU, which suffice to rule out most hypotheses."""

    footing: Footing  # at these instants
    limits: CheckLimits
    chosen: Bools  # (instants,) of the whole log, those that are in it

    @classmethod
    def of(cls, footing: Footing, limits: CheckLimits) -> Self:
        """Every `limits.excerpt`-th second."""
        chosen = footing.blocks.group % limits.excerpt == 0
        return cls(Footing(footing.robot, footing.blocks.at(np.flatnonzero(chosen))), limits, chosen)

    def balance(self, hypothesis: FaultHypothesis) -> Array:
        """Costs of torques that do not balance the trunk under a hypothesis, (instants,); zero elsewhere."""
        out = np.zeros(len(self.chosen))
        out[self.chosen] = MotionCosts(self.footing.under(hypothesis.undo), self.limits).balance
        return out


def _balances(hypothesis: FaultHypothesis, excerpt: Excerpt, costs: MotionCosts) -> Iterator[Array]:
    """Lower bounds of the costs of balance under a hypothesis, the tighter the more they take."""
    yield np.zeros(len(excerpt.chosen))
    yield excerpt.balance(hypothesis)
    yield costs.balance


def _speed(costs: MotionCosts, length: float, limits: CheckLimits) -> float:
    """Median sliding speed of loaded feet [m/s]."""
    middle = float(np.nanmedian(costs.feet)) if np.isfinite(costs.feet).any() else 0.0
    return float(np.sqrt(np.expm1(middle))) * limits.slide * length
