"""What is usually wrong with a log whose sensors contradict each other, each as the way to undo it.

A suspect is confirmed if, undone, nothing is impossible any more, and everything fits far better than before. Where
several are, the likeliest counts, and those that fit about as well are named beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from stadera.robot.model import Robot
from stadera.weigh.consistency import Painter, Picture, Sensed

Array = NDArray[np.float64]
Places = NDArray[np.int64]

MUCH_BETTER = 0.25
"""Share of the cost that may be left where a suspect is confirmed."""
_SAME, _ABOUT_AS_GOOD = 0.02, 0.3
"""Costs by which suspects are told apart: below the first the simpler one counts, below the second both are named."""
_KINDS = ("HAA", "HFE", "KFE")
_ALL = ("position", "effort")


@dataclass(frozen=True, eq=False)
class Suspect:
    """Something that may be wrong.

    Attributes:
        cause: in one word: imu_frame, torque_signs, joint_order.
        text: what is wrong, a clause.
        undo: what the sensors would have said without it.
    """

    cause: str
    text: str
    undo: Callable[[Sensed], Sensed]


@dataclass(frozen=True, eq=False)
class Verdict:
    """The suspect that explains the contradictions best.

    Attributes:
        suspect: it.
        picture: without it.
        others: that explain them about as well, at most two.
    """

    suspect: Suspect
    picture: Picture
    others: tuple[Suspect, ...]


def verdict(sensed: Sensed, painter: Painter, now: Picture) -> Verdict | None:
    """Which suspect explains the contradictions; None where none does."""
    fitting: list[tuple[float, Suspect, Picture]] = []
    for suspect in suspects(painter.robot, imu=now.imu):
        picture = painter.paint(suspect.undo(sensed))
        if picture.cost <= MUCH_BETTER * now.cost and not any(picture.faults()):
            fitting.append((picture.cost, suspect, picture))
    if not fitting:
        return None
    least = min(cost for cost, _, _ in fitting)
    _, best, picture = next(entry for entry in fitting if entry[0] <= least + _SAME)
    near = sorted((cost, k) for k, (cost, suspect, _) in enumerate(fitting) if suspect is not best)
    others = tuple(fitting[k][1] for cost, k in near if cost < least + _ABOUT_AS_GOOD)[:2]
    return Verdict(best, picture, others)


def suspects(robot: Robot, *, imu: bool = True) -> Iterator[Suspect]:
    """All suspects, simpler ones first; those of the IMU where there is one."""
    yield from _signs(robot)
    yield from _orders(robot)
    if imu:
        yield from _turns()


def _signs(robot: Robot) -> Iterator[Suspect]:
    place = _places(robot)
    n = len(robot.tree.joints)

    def flipped(text: str, chosen: Places) -> Suspect:
        sign = np.ones(n)
        sign[chosen.ravel()] = -1.0
        return Suspect("torque_signs", text, lambda s: replace(s, effort=s.effort * sign))

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


def _orders(robot: Robot) -> Iterator[Suspect]:
    place = _places(robot)
    n = len(robot.tree.joints)

    def reordered(what: str, taken: Places) -> Iterator[Suspect]:
        order = np.arange(n, dtype=np.int64)
        order[place.ravel()] = taken.ravel()
        for which, channels in (("", _ALL), ("the torques of ", _ALL[1:]), ("the positions of ", _ALL[:1])):
            yield Suspect(
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


def _turns() -> Iterator[Suspect]:
    """The accelerometer's sign, and the rotations that take axes to axes."""
    yield Suspect(
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
        yield Suspect(
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
