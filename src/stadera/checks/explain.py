"""Selects the fault hypothesis that explains contradictions, on average over a log or in its motion.

A hypothesis is confirmed if undoing the fault removes all impossible properties and reduces the cost: on average to a
small share, in motion by more than chance. Of several, the one of least cost is chosen, and those that fit equally well
are named with it.
"""

from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from stadera.checks.footing import Footing, Known
from stadera.checks.hypotheses import FaultHypothesis, hypotheses_at_rest, hypotheses_in_motion, torque_scales
from stadera.checks.instants import Instants
from stadera.checks.limits import CheckLimits
from stadera.checks.motion import Gain, MotionCosts
from stadera.checks.statics import Consistency, ConsistencyModel


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
    """The hypothesis that makes the motion more consistent, its reduction of the cost, the median speed of loaded feet
    as recorded and after undoing the fault [m/s], and at most two others with about the same gain.
    """

    hypothesis: FaultHypothesis
    gain: Gain
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
    least = limits.gain if now.lively > limits.lively_share else limits.gain_at_rest
    fitting: list[tuple[Gain, FaultHypothesis, MotionCosts]] = []
    for hypothesis in hypotheses_in_motion(robot):
        without = footing.under(hypothesis.undo)
        costs, needed = MotionCosts(without, limits), least * (limits.rare if hypothesis.rare else 1.0)
        if Gain.most(now, costs) < needed:
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
    return MotionExplanation(best, gain, _speed(now, length, limits), _speed(costs, length, limits), others)


def _speed(costs: MotionCosts, length: float, limits: CheckLimits) -> float:
    """Median sliding speed of loaded feet [m/s]."""
    middle = float(np.nanmedian(costs.feet)) if np.isfinite(costs.feet).any() else 0.0
    return float(np.sqrt(np.expm1(middle))) * limits.slide * length
