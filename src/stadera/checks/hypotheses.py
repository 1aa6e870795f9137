"""Fault hypotheses: common mistakes in logs whose sensors contradict each other, each with the way to undo it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from stadera.checks.instants import Instants
from stadera.checks.units import DEGREE
from stadera.logs.columns import CHANNELS
from stadera.logs.mend import GYRO, Mend
from stadera.robot.model import Robot
from stadera.types import Array

Places = NDArray[np.int64]

KINDS = ("HAA", "HFE", "KFE")
_MOTION = CHANNELS[:3]
_WHICH = {"": CHANNELS, "the torques of ": CHANNELS[3:], "the positions of ": _MOTION}
_BY_NAMES = "--columns MAP.toml with the right names"
_BY_SIGN = "--columns MAP.toml with factor = -1"
_BY_FRAME = "--imu-frame NAME"
_TORQUE_UNITS = (("mNm", 1e-3), ("kNm", 1e3))
_SIDES: dict[tuple[int, ...], str] = {
    (1, 0, 3, 2): "left and right legs",
    (2, 3, 0, 1): "front and hind legs",
    (3, 2, 1, 0): "diagonal legs, LF with RH and RF with LH,",
}
"""By the order of LF, RF, LH, RH."""


@dataclass(frozen=True, eq=False)
class FaultHypothesis:
    """A possible fault of a log."""

    cause: str  # one word: imu_frame, torque_signs, torque_unit, joint_order, joint_signs, gyro_unit
    text: str  # description of the fault, a clause
    undo: Callable[[Instants], Instants]  # makes the log without the fault, joints in the tree's order
    option: str = ""  # command-line option that corrects it
    mend: Mend | None = None  # correction of the recordings; None if it needs more information
    rare: bool = False  # True if it needs more gain in motion, see `CheckLimits.rare`

    @property
    def torques_alone(self) -> bool:
        """True if only torques are those of other joints."""
        return isinstance(self.undo, _Taken) and self.undo.channels == _WHICH["the torques of "]


def hypotheses_at_rest(robot: Robot, *, imu: bool = True) -> Iterator[FaultHypothesis]:
    """Yields hypotheses that show on average, simpler ones first; those of the IMU only with `imu`."""
    yield from _torque_signs(robot)
    yield from _orders(robot)
    if imu:
        yield from _turns()


def hypotheses_in_motion(robot: Robot) -> Iterator[FaultHypothesis]:
    """Yields hypotheses that show in motion, for logs with an IMU."""
    names, place = [leg.name for leg in robot.legs], places(robot)
    for order in _orders_of_four():
        which = tuple(_WHICH) if order in _SIDES or sum(a != b for a, b in enumerate(order)) == 2 else ("",)
        for name, found in zip(which, _reordered(robot, _legs(order, names), place[list(order)], which), strict=True):
            yield replace(found, rare=True) if name and order not in _SIDES else found
    yield from _joint_signs(robot)
    for quarters in (1, 2, 3):
        turn = np.round(_about_z(quarters * np.pi / 2))
        yield _turned(turn, f"the IMU is turned by {90 * quarters}° about the vertical")
    yield _gyro(-1.0, "the gyro's sign is reversed", "")
    yield _gyro(DEGREE, "the gyro seems to be in deg/s", "--units gyro=deg/s")


def torque_scales(robot: Robot, loads: Array, lightest: float, heaviest: float) -> Iterator[FaultHypothesis]:
    """Yields hypotheses of scaled torques, of all legs, of pairs or of one: of motors before the gear, or in another
    unit.

    Args:
        loads: (4,), mean upward load of each foot as a share of the robot's weight.
        lightest, heaviest: shares of its weight that a robot may have; factors within them cannot be detected.
    """
    place, names = places(robot), [leg.name for leg in robot.legs]
    for count in (4, 2, 1):
        for chosen in combinations(range(4), count):
            factor = _factor(float(loads[list(chosen)].sum()), float(loads.sum()), count)
            if factor <= 0 or lightest < 1.0 / factor < heaviest:
                continue
            whose = "" if count == 4 else f" of {' and '.join(names[k] for k in chosen)}"
            yield _scaled(robot, place[list(chosen)].ravel(), factor, whose)


def places(robot: Robot) -> Places:
    """Index of each leg's joints in the tree, (4, 3)."""
    return np.array([[robot.tree.joints.index(joint) for joint in leg.joints] for leg in robot.legs], dtype=np.int64)


# -- torques ---------------------------------------------------------------------------------------------------------


def _factor(carried: float, total: float, count: int) -> float:
    """Factor on the torques of so many legs with which they carry as much as the others, all four the robot's weight;
    -1 where they carry nothing.
    """
    if not carried:
        return -1.0
    return (total - carried) / (4 - count) * count / carried if count < 4 else (1.0 - total + carried) / carried


def _scaled(robot: Robot, chosen: Places, factor: float, whose: str) -> FaultHypothesis:
    scale = np.ones(len(robot.tree.joints))
    unit, factor = next(((u, f) for u, f in _TORQUE_UNITS if 0.5 < f / factor < 2.0), ("", factor))
    scale[chosen] = factor
    joints = [robot.tree.joints[k] for k in chosen]
    mend = None
    if unit:
        text = f"the torques{whose} seem to be in {unit}"
        mend = Mend(f"torques{whose} taken to be in {unit}", joint_factors={("effort", j): factor for j in joints})
        option = f"--units {unit}"
    else:
        size = f"{factor:.3g} times too small" if factor > 1 else f"{1 / factor:.3g} times too large"
        text = f"the torques{whose} are about {size}, as those of motors before the gear, or in another unit"
        option = "--gear RATIO"
    if whose:
        option = f"--columns MAP.toml with factor = {factor:.3g}"
    return FaultHypothesis("torque_unit", text, lambda b: replace(b, effort=b.effort * scale), option, mend)


def _torque_signs(robot: Robot) -> Iterator[FaultHypothesis]:
    place = places(robot)
    n = len(robot.tree.joints)

    def flipped(text: str, chosen: Places) -> FaultHypothesis:
        sign = np.ones(n)
        sign[chosen.ravel()] = -1.0
        joints = [robot.tree.joints[k] for k in chosen.ravel()]
        mend = Mend(f"{text}, and turned back", joint_factors={("effort", joint): -1.0 for joint in joints})
        return FaultHypothesis("torque_signs", text, lambda b: replace(b, effort=b.effort * sign), _BY_SIGN, mend)

    yield flipped("the signs of all torques are reversed", place)
    for count in (1, 2, 3):
        for legs in combinations(range(4), count):
            names = " and ".join(robot.legs[k].name for k in legs)
            yield flipped(f"the signs of the torques of {names} are reversed", place[list(legs)])
    for count in (1, 2):
        for kinds in combinations(range(3), count):
            names = " and ".join(KINDS[k] for k in kinds)
            yield flipped(f"the signs of all {names} torques are reversed", place[:, list(kinds)])
    for leg, kind in product(range(4), range(3)):
        joint = robot.tree.joints[int(place[leg, kind])]
        yield flipped(f"the sign of the torque of {joint!r} is reversed", place[leg, kind])


# -- joints ----------------------------------------------------------------------------------------------------------


def _orders(robot: Robot) -> Iterator[FaultHypothesis]:
    place = places(robot)
    for kinds in list(permutations(range(3)))[1:]:
        yield from _reordered(robot, f"joints {_cycle(kinds, KINDS)} of all legs", place[:, list(kinds)], tuple(_WHICH))
    names = [leg.name for leg in robot.legs]
    for order in _orders_of_four():
        yield from _reordered(robot, _legs(order, names), place[list(order)], tuple(_WHICH))
    by_kind, by_leg = place.T.reshape(4, 3), place.reshape(3, 4).T
    yield from _reordered(robot, "joints by kind and joints by leg", by_kind, tuple(_WHICH))
    yield from _reordered(robot, "joints by leg and joints by kind", by_leg, tuple(_WHICH))
    yield from _joint_signs(robot)


def torque_orders(robot: Robot) -> Iterator[tuple[tuple[int, ...], FaultHypothesis]]:
    """Yields every other order of the legs' torques, and the hypothesis that they are recorded in it."""
    place, names = places(robot), [leg.name for leg in robot.legs]
    for order in _orders_of_four():
        for found in _reordered(robot, _legs(order, names), place[list(order)], ("the torques of ",)):
            yield order, found


def _orders_of_four() -> list[tuple[int, ...]]:
    """Orders of the legs other than the right one, those with the fewest changes first."""
    return sorted(permutations(range(4)), key=lambda order: sum(a != b for a, b in enumerate(order)))[1:]


def _reordered(robot: Robot, what: str, taken: Places, which: Sequence[str]) -> Iterator[FaultHypothesis]:
    joints, order = robot.tree.joints, np.arange(len(robot.tree.joints), dtype=np.int64)
    order[places(robot).ravel()] = taken.ravel()
    moved = [(joints[k], joints[source]) for k, source in enumerate(order) if k != source]
    for name in which:
        channels, text = _WHICH[name], f"{name}{what} are swapped"
        mend = Mend(f"{text}, and put back", swapped={(c, joint): source for c in channels for joint, source in moved})
        yield FaultHypothesis("joint_order", text, _Taken(order, channels), _BY_NAMES, mend)


@dataclass(frozen=True, eq=False)
class _Taken:
    """Takes the values of other joints, in some channels."""

    order: Places
    channels: tuple[str, ...]

    def __call__(self, blocks: Instants) -> Instants:
        moved = ("position", "rate") if "position" in self.channels else ()
        names = (*moved, "effort") if "effort" in self.channels else moved
        return replace(blocks, **{name: getattr(blocks, name)[:, self.order] for name in names})


def _joint_signs(robot: Robot) -> Iterator[FaultHypothesis]:
    """Yields hypotheses of joints with the opposite sign, as if both sides of the robot were mirrored."""
    place = places(robot)
    sides = {"right legs": (1, 3), "left legs": (0, 2), "all legs": (0, 1, 2, 3)}
    for (side, legs), kinds in product(sides.items(), ((0,), (1,), (2,), (1, 2), (0, 1, 2))):
        chosen = place[np.ix_(legs, kinds)].ravel()
        sign = np.ones(len(robot.tree.joints))
        sign[chosen] = -1.0
        joints = [robot.tree.joints[k] for k in chosen]
        what = f"{' and '.join(KINDS[k] for k in kinds)} of the {side}"
        for whole in (True, False):
            channels = CHANNELS if whole else _MOTION
            text = f"{'' if whole else 'the positions of '}{what} have the other sign"
            mend = Mend(f"{text}, turned", joint_factors={(c, joint): -1.0 for c in channels for joint in joints})
            yield FaultHypothesis("joint_signs", text, _Mirrored(sign, whole), _BY_SIGN, mend)


@dataclass(frozen=True, eq=False)
class _Mirrored:
    """Reverses joints, with or without their torques."""

    sign: Array
    torques: bool

    def __call__(self, blocks: Instants) -> Instants:
        effort = blocks.effort * self.sign if self.torques else blocks.effort
        return replace(blocks, position=blocks.position * self.sign, rate=blocks.rate * self.sign, effort=effort)


# -- the IMU ---------------------------------------------------------------------------------------------------------


def _turns() -> Iterator[FaultHypothesis]:
    """Yields the accelerometer's sign, and the rotations that map axes to axes."""
    yield FaultHypothesis(
        "imu_frame",
        "the accelerometer's sign is reversed, gravity instead of the specific force",
        lambda b: b if b.specific_force is None else replace(b, specific_force=-b.specific_force),
        mend=Mend("sign of the accelerometer turned", factors={"accelerometer": -1.0}),
    )
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.zeros((3, 3))
        turn[range(3), order] = signs
        if np.linalg.det(turn) < 0 or np.array_equal(turn, np.eye(3)):
            continue
        axes = ", ".join(("" if sign > 0 else "-") + "xyz"[k] for k, sign in zip(order, signs, strict=True))
        yield _turned(turn, f"the IMU's frame is wrong: its axes ({axes}) are what is taken for (x, y, z) of the trunk")


def _turned(turn: Array, text: str) -> FaultHypothesis:
    rows = tuple(tuple(float(x) for x in row) for row in turn)
    return FaultHypothesis("imu_frame", text, _Turn(turn), _BY_FRAME, Mend(f"{text}; turned", turn=rows))  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class _Turn:
    """Rotates the IMU's values."""

    turn: Array

    def __call__(self, blocks: Instants) -> Instants:
        names = ("specific_force", "angular_velocity")
        values = {name: getattr(blocks, name) for name in names}
        return replace(blocks, **{name: v @ self.turn.T for name, v in values.items() if v is not None})


def _gyro(factor: float, text: str, option: str) -> FaultHypothesis:
    return FaultHypothesis(
        "gyro_unit",
        text,
        lambda b: b if b.angular_velocity is None else replace(b, angular_velocity=factor * b.angular_velocity),
        option,
        Mend(f"{text}, converted", factors={GYRO: factor}),
    )


def _about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _legs(order: tuple[int, ...], names: Sequence[str]) -> str:
    return _SIDES.get(order) or f"legs {_cycle(order, names)}"


def _cycle(order: Sequence[int], names: Sequence[str]) -> str:
    moved = [names[k] for k, other in enumerate(order) if k != other]
    return " and ".join([", ".join(moved[:-1]), moved[-1]])
