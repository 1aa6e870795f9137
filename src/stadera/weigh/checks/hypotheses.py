"""Fault hypotheses: the usual mistakes in logs whose sensors contradict each other, each as the way to undo it.

A hypothesis is confirmed if, undone, nothing is impossible any more and the cost falls to a small share. Of several,
the one of least cost counts, and those that fit about as well are named with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from stadera.robot.model import Robot
from stadera.types import Array
from stadera.weigh.checks.consistency import Consistency, ConsistencyModel, Sensed

Places = NDArray[np.int64]

_KINDS = ("HAA", "HFE", "KFE")
_ALL = ("position", "effort")


@dataclass(frozen=True, eq=False)
class FaultHypothesis:
    """Something that may be wrong.

    Attributes:
        cause: in one word: imu_frame, torque_signs, joint_order.
        text: what is wrong, a clause.
        undo: the sensor data as they would be without it.
    """

    cause: str
    text: str
    undo: Callable[[Sensed], Sensed]


@dataclass(frozen=True, eq=False)
class Explanation:
    """The hypothesis that explains the contradictions best.

    Attributes:
        hypothesis: it.
        without: the figures once it is undone.
        others: that explain them about as well, at most two.
    """

    hypothesis: FaultHypothesis
    without: Consistency
    others: tuple[FaultHypothesis, ...]


def explain(sensed: Sensed, model: ConsistencyModel) -> Explanation | None:
    """The hypothesis that explains the contradictions of sensor data; None where none does."""
    now, limits = model.evaluate(sensed), model.limits
    fitting: list[tuple[float, FaultHypothesis, Consistency]] = []
    for hypothesis in hypotheses(model.robot, imu=now.imu):
        without = model.evaluate(hypothesis.undo(sensed))
        if without.cost <= limits.much_better * now.cost and not any(without.faults()):
            fitting.append((without.cost, hypothesis, without))
    if not fitting:
        return None
    least = min(cost for cost, _, _ in fitting)
    _, best, without = next(entry for entry in fitting if entry[0] <= least + limits.same)
    near = sorted((cost, k) for k, (cost, other, _) in enumerate(fitting) if other is not best)
    others = tuple(fitting[k][1] for cost, k in near if cost < least + limits.similar)[:2]
    return Explanation(best, without, others)


def hypotheses(robot: Robot, *, imu: bool = True) -> Iterator[FaultHypothesis]:
    """All hypotheses, simpler ones first; those of the IMU if there is one."""
    yield from _signs(robot)
    yield from _orders(robot)
    if imu:
        yield from _turns()


def _signs(robot: Robot) -> Iterator[FaultHypothesis]:
    place = _places(robot)
    n = len(robot.tree.joints)

    def flipped(text: str, chosen: Places) -> FaultHypothesis:
        sign = np.ones(n)
        sign[chosen.ravel()] = -1.0
        return FaultHypothesis("torque_signs", text, lambda s: replace(s, effort=s.effort * sign))

    yield flipped("the signs of all torques are reversed", place)
    for count in (1, 2, 3):
        for legs in combinations(range(4), count):
            names = " and ".join(robot.legs[k].name for k in legs)
            yield flipped(f"the signs of the torques of {names} are reversed", place[list(legs)])
    for count in (1, 2):
        for kinds in combinations(range(3), count):
            names = " and ".join(_KINDS[k] for k in kinds)
            yield flipped(f"the signs of all {names} torques are reversed", place[:, list(kinds)])
    for leg, kind in product(range(4), range(3)):
        joint = robot.tree.joints[int(place[leg, kind])]
        yield flipped(f"the sign of the torque of {joint!r} is reversed", place[leg, kind])


def _orders(robot: Robot) -> Iterator[FaultHypothesis]:
    place = _places(robot)
    n = len(robot.tree.joints)

    def reordered(what: str, taken: Places) -> Iterator[FaultHypothesis]:
        order = np.arange(n, dtype=np.int64)
        order[place.ravel()] = taken.ravel()
        for which, channels in (("", _ALL), ("the torques of ", _ALL[1:]), ("the positions of ", _ALL[:1])):
            yield FaultHypothesis(
                "joint_order",
                f"{which}{what} are swapped",
                lambda s, channels=channels: _taken(s, order, channels),  # type: ignore[misc]
            )

    for kinds in list(permutations(range(3)))[1:]:
        yield from reordered(f"joints {_cycle(kinds, _KINDS)} of all legs", place[:, list(kinds)])
    legs = [leg.name for leg in robot.legs]
    for order in sorted(permutations(range(4)), key=lambda o: sum(a != b for a, b in enumerate(o)))[1:]:
        yield from reordered(f"legs {_cycle(order, legs)}", place[list(order)])
    by_kind, by_leg = place.T.reshape(4, 3), place.reshape(3, 4).T
    yield from reordered("joints by kind and joints by leg", by_kind)
    yield from reordered("joints by leg and joints by kind", by_leg)


def _taken(sensed: Sensed, order: Places, channels: tuple[str, ...]) -> Sensed:
    return replace(sensed, **{channel: getattr(sensed, channel)[:, order] for channel in channels})


def _turns() -> Iterator[FaultHypothesis]:
    """The accelerometer's sign, and the rotations that take axes to axes."""
    yield FaultHypothesis(
        "imu_frame",
        "the accelerometer's sign is reversed, gravity instead of the specific force",
        lambda s: _turned(s, -np.eye(3)),
    )
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.zeros((3, 3))
        turn[range(3), order] = signs
        if np.linalg.det(turn) < 0 or np.array_equal(turn, np.eye(3)):
            continue
        axes = ", ".join(("" if sign > 0 else "-") + "xyz"[k] for k, sign in zip(order, signs, strict=True))
        yield FaultHypothesis(
            "imu_frame",
            f"the IMU's frame is wrong: its axes ({axes}) are what is taken for (x, y, z) of the trunk",
            lambda s, turn=turn: _turned(s, turn),  # type: ignore[misc]
        )


def _turned(sensed: Sensed, turn: Array) -> Sensed:
    force = sensed.specific_force
    return sensed if force is None else replace(sensed, specific_force=force @ turn.T)


def _cycle(order: tuple[int, ...], names: tuple[str, ...] | list[str]) -> str:
    moved = [names[k] for k, other in enumerate(order) if k != other]
    return " and ".join([", ".join(moved[:-1]), moved[-1]])


def _places(robot: Robot) -> Places:
    """(4, 3), where each leg's joints are in the tree."""
    return np.array([[robot.tree.joints.index(joint) for joint in leg.joints] for leg in robot.legs], dtype=np.int64)
