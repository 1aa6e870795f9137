"""Fault hypotheses: common mistakes in logs, each with a correction, a sentence and the option that applies it."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np

from stadera.checks.signals import DEGREE
from stadera.logs.columns import CHANNELS
from stadera.logs.mend import ACCELEROMETER, GYRO, Mend
from stadera.robot.limbs import Limbs, inwards
from stadera.robot.model import Leg, Robot
from stadera.types import Array

Order = tuple[int, ...]
"""For each leg, or joint of a leg, the one whose values are recorded as its own."""

_MOTION, _TORQUES = CHANNELS[:3], CHANNELS[3:]
_WHICH = {"": CHANNELS, "the torques of ": _TORQUES, "the positions of ": _MOTION}
_BY_NAMES = "--columns MAP.toml with the right names"
_BY_SIGN = "--columns MAP.toml with factor = -1"
_BY_FACTOR = "--columns MAP.toml with factor = 0.0174533"
_TORQUE_UNITS = {"mNm": 1e-3, "kNm": 1e3}


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A possible fault of a log."""

    cause: str  # one word: imu_frame, torque_signs, torque_unit, joint_order, joint_signs, gyro_unit
    text: str  # description of the fault, a clause
    undo: Mend  # correction of the log, with a turn of the IMU in trunk axes
    option: str = ""  # command-line option that corrects it
    known: bool = True  # False if the correction is estimated, and needs more information to be applied

    @property
    def by_torques(self) -> bool:
        """True if the trunk's rows tell it from another order or sign of torques."""
        torques = bool(self.undo.swapped) and {channel for channel, _ in self.undo.swapped} == set(_TORQUES)
        return torques or self.cause == "joint_signs"


def hypotheses_at_rest(robot: Robot, most: int, *, imu: bool = True) -> Iterator[Hypothesis]:
    """Yields hypotheses that show on average, simpler ones first; those of the IMU only with `imu`. Orders of more than
    `most` legs or joints are exchanges of two.
    """
    yield from _torque_signs(robot)
    legs, alike = [leg.joints for leg in robot.legs], len({len(leg.joints) for leg in robot.legs}) == 1
    if alike:
        for order in _orders(len(robot.kinds), most):
            taken = [[leg[k] for k in order] for leg in legs]
            yield from _reordered(robot, f"joints {_cycle(order, robot.kinds)} of all legs", taken, _WHICH)
    for order, what in leg_orders(robot, most).items():
        yield from _reordered(robot, what, [legs[k] for k in order], _WHICH)
    if alike:
        flat = np.array(legs)
        yield from _reordered(robot, "joints by kind and joints by leg", flat.T.reshape(flat.shape).tolist(), _WHICH)
        by_leg = flat.reshape(flat.shape[::-1]).T.tolist()
        yield from _reordered(robot, "joints by leg and joints by kind", by_leg, _WHICH)
    yield from _joint_signs(robot)
    if imu:
        yield from _turns()


def hypotheses_in_motion(robot: Robot, most: int) -> Iterator[Hypothesis]:
    """Yields hypotheses that show in motion, for logs with an IMU; orders as `hypotheses_at_rest`."""
    legs, mirrored = [leg.joints for leg in robot.legs], mirrors(robot)
    for order, what in leg_orders(robot, most).items():
        whole, *parts = _reordered(robot, what, [legs[k] for k in order], _WHICH)
        yield whole
        if order in mirrored or sum(a != b for a, b in enumerate(order)) == 2:
            yield from parts
    yield from _joint_signs(robot)
    yield from (whole for _, whole in joint_signs(robot.tree.joints))
    for quarters in (1, 2, 3):
        c, s = round(np.cos(quarters * np.pi / 2)), round(np.sin(quarters * np.pi / 2))
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        imu = _turned(turn, f"the IMU is turned by {90 * quarters}° about the vertical")
        text = f"the gyro is turned by {90 * quarters}° about the vertical, but not the accelerometer"
        yield from (imu, replace(imu, text=text, undo=replace(imu.undo, text=f"{text}; turned", gyro_alone=True)))
    yield _gyro(-1.0, "the gyro's sign is reversed", "")
    yield _gyro(DEGREE, "the gyro seems to be in deg/s", "--units gyro=deg/s")


def torque_orders(robot: Robot, most: int) -> Iterator[Hypothesis]:
    """Yields hypotheses of torques that are recorded in another order of the legs, all orders."""
    for order, what in leg_orders(robot, most).items():
        yield from _reordered(robot, what, [robot.legs[k].joints for k in order], ("the torques of ",))


def joint_signs(joints: Iterable[str]) -> Iterator[tuple[Hypothesis, Hypothesis]]:
    """Yields hypotheses of one joint's torque with the other sign, and of all of that joint's values."""
    for joint in joints:
        yield (
            _flipped(f"the sign of the torque of {joint!r} is reversed", [joint]),
            _flipped(f"the signs of all values of {joint!r} are reversed", [joint], "joint_signs", CHANNELS),
        )


def limb_faults(robot: Robot, *, degrees: bool) -> Iterator[Hypothesis]:
    """Yields hypotheses of limbs besides the legs: alike ones exchanged, their joints in another order, with the other
    sign, and positions in `degrees`.
    """
    extra, limbs = robot.extra, Limbs.of(robot)
    if extra is None:
        return
    for one, other in limbs.hands:
        arms = [[extra.joints[k] for k in inwards(extra, end)][::-1] for end in (one, other)]
        by_kind, by_arm = [joint for pair in zip(*arms, strict=True) for joint in pair], [*arms[0], *arms[1]]
        swapped = zip(by_arm, [*arms[1], *arms[0]], strict=True)
        yield from _exchanged(f"the arms of {extra.links[one]} and {extra.links[other]}", [*swapped], _WHICH)
        rest = [extra.joints[k] for k in limbs.joints if extra.joints[k] not in by_arm]  # of a waist, of a head
        orders = {"joints by kind and by arm": (by_kind, by_arm)}
        if rest:
            orders["joints of the arms and others outside the legs"] = [*by_arm, *rest], [*rest, *by_arm]
        for what, (order, another) in orders.items():
            for pairs in (zip(order, another, strict=True), zip(another, order, strict=True)):
                yield from _exchanged(what, [*pairs], _WHICH)
    for pair in joint_signs(extra.joints[k] for k in limbs.joints):
        yield from pair
    if degrees:
        text = "the positions of the joints outside the legs are in degrees"
        joints = [extra.joints[k] for k in limbs.joints if not extra.sliding[k]]
        yield Hypothesis("position_unit", text, _factored(joints, _MOTION, DEGREE, f"{text}, converted"), _BY_FACTOR)


def torque_scales(robot: Robot, loads: Array, lightest: float, heaviest: float) -> Iterator[Hypothesis]:
    """Yields hypotheses of scaled torques, of all legs, of half of them or of one: of motors before the gear, or in
    another unit.

    Args:
        loads: (L,), mean upward load of each foot as a share of the robot's weight.
        lightest, heaviest: shares of its weight that a robot may have; factors within them cannot be detected.
    """
    n, total = len(loads), float(loads.sum())
    for count in dict.fromkeys((n, n // 2, 1)):
        for chosen in combinations(range(n), count):
            carried = float(loads[list(chosen)].sum())
            # with it these legs carry as much as the others, and all together the robot's weight
            wanted = (total - carried) / (n - count) * count if count < n else 1.0
            if carried and (factor := wanted / carried) > 0 and not lightest < 1.0 / factor < heaviest:
                names = " and ".join(robot.legs[k].name for k in chosen)
                joints = [joint for k in chosen for joint in robot.legs[k].joints]
                yield _scaled(joints, factor, "" if count == n else f" of {names}")


def leg_orders(robot: Robot, most: int) -> dict[Order, str]:
    """Orders of the legs other than the right one, those with the fewest changes first, and which are swapped."""
    names, sizes, known = [leg.name for leg in robot.legs], [len(leg.joints) for leg in robot.legs], mirrors(robot)
    orders = dict.fromkeys([*_orders(len(names), most), *known])
    fitting = [order for order in orders if [sizes[k] for k in order] == sizes]
    return {order: known.get(order) or f"legs {_cycle(order, names)}" for order in fitting}


def mirrors(robot: Robot) -> dict[Order, str]:
    """Orders in which each leg is exchanged with its mirror image, by the places of the hips."""
    hips, names = robot.hips[:, :2] - robot.hips[:, :2].mean(axis=0), [leg.name for leg in robot.legs]
    found: dict[Order, str] = {}
    for sign, what in (((1, -1), "left and right legs"), ((-1, 1), "front and hind legs"), ((-1, -1), "")):
        off = np.linalg.norm(hips * sign - hips[:, None], axis=2)
        order = tuple(off.argmin(axis=0).tolist())
        near = bool((off.min(axis=0) < 0.2 * np.ptp(hips, axis=0).max()).all())
        if near and sorted(order) == list(range(len(hips))) != list(order):
            pairs = " and ".join(f"{names[k]} with {names[other]}" for k, other in enumerate(order) if k < other)
            found.setdefault(order, what or f"diagonal legs, {pairs},")
    return found


def _orders(count: int, most: int) -> list[Order]:
    """Orders other than the right one, those with the fewest changes first; of more than `most` exchanges of two."""
    if count <= most:
        return sorted(permutations(range(count)), key=lambda order: sum(a != b for a, b in enumerate(order)))[1:]
    pairs = combinations(range(count), 2)
    return [tuple({a: b, b: a}.get(k, k) for k in range(count)) for a, b in pairs]


def _cycle(order: Sequence[int], names: Sequence[str]) -> str:
    *first, last = [names[k] for k, other in enumerate(order) if k != other]
    return f"{', '.join(first)} and {last}"


def _factored(joints: Sequence[str], channels: Sequence[str], factor: float, text: str) -> Mend:
    return Mend(text, joint_factors={(channel, joint): factor for channel in channels for joint in joints})


def _scaled(joints: Sequence[str], factor: float, whose: str) -> Hypothesis:
    unit, factor = next(((u, f) for u, f in _TORQUE_UNITS.items() if 0.5 < f / factor < 2.0), ("", factor))
    size = f"{factor:.3g} times too small" if factor > 1 else f"{1 / factor:.3g} times too large"
    text = f"the torques{whose} are about {size}, as those of motors before the gear, or in another unit"
    option = f"--units {unit}" if unit else "--gear RATIO"
    option = f"--columns MAP.toml with factor = {factor:.3g}" if whose else option
    undo = _factored(joints, _TORQUES, factor, f"torques{whose} taken to be in {unit}")
    text = f"the torques{whose} seem to be in {unit}" if unit else text
    return Hypothesis("torque_unit", text, undo, option, known=bool(unit))


def _flipped(
    text: str, joints: Sequence[str], cause: str = "torque_signs", channels: Sequence[str] = _TORQUES
) -> Hypothesis:
    return Hypothesis(cause, text, _factored(joints, channels, -1.0, f"{text}, and turned back"), _BY_SIGN)


def _torque_signs(robot: Robot) -> Iterator[Hypothesis]:
    yield _flipped("the signs of all torques are reversed", robot.tree.joints)
    for count in range(1, len(robot.legs)):
        for legs in combinations(robot.legs, count):
            names = " and ".join(leg.name for leg in legs)
            joints = [joint for leg in legs for joint in leg.joints]
            yield _flipped(f"the signs of the torques of {names} are reversed", joints)
    for count in (1, 2):
        for kinds in combinations(range(len(robot.kinds)), count):
            names = " and ".join(robot.kinds[k] for k in kinds)
            yield _flipped(f"the signs of all {names} torques are reversed", _of_kinds(robot.legs, kinds))
    for joint in robot.tree.joints:
        yield _flipped(f"the sign of the torque of {joint!r} is reversed", [joint])


def _of_kinds(legs: Sequence[Leg], kinds: Sequence[int]) -> list[str]:
    return [leg.joints[k] for leg in legs for k in kinds if k < len(leg.joints)]


def _reordered(robot: Robot, what: str, taken: Sequence[Sequence[str]], which: Iterable[str]) -> Iterator[Hypothesis]:
    """The values of joints are recorded as those of others, `taken`, by leg."""
    pairs = [(a, b) for leg, own in zip(robot.legs, taken, strict=True) for a, b in zip(leg.joints, own, strict=True)]
    yield from _exchanged(what, pairs, which)


def _exchanged(what: str, pairs: Sequence[tuple[str, str]], which: Iterable[str]) -> Iterator[Hypothesis]:
    """The values of the first joint of each pair are recorded as those of the second."""
    for name in which:
        text = f"{name}{what} are swapped"
        swapped = {(channel, joint): source for channel in _WHICH[name] for joint, source in pairs if joint != source}
        yield Hypothesis("joint_order", text, Mend(f"{text}, and put back", swapped=swapped), _BY_NAMES)


def _joint_signs(robot: Robot) -> Iterator[Hypothesis]:
    """Yields hypotheses of joints with the opposite sign, as if both sides of the robot were mirrored."""
    y, kinds = dict(zip(robot.legs, robot.hips[:, 1], strict=True)), range(len(robot.kinds))
    sides = {"the right legs": [leg for leg in y if y[leg] < 0], "the left legs": [leg for leg in y if y[leg] > 0]}
    sides["all legs"] = list(y)
    for (side, legs), chosen in product(sides.items(), (*((k,) for k in kinds), tuple(kinds[1:]), tuple(kinds))):
        what = f"{' and '.join(robot.kinds[k] for k in chosen)} of {side}"
        for name, channels in (("", CHANNELS), ("the positions of ", _MOTION)):
            text = f"{name}{what} have the other sign"
            undo = _factored(_of_kinds(legs, chosen), channels, -1.0, f"{text}, turned")
            yield Hypothesis("joint_signs", text, undo, _BY_SIGN)


def _turns() -> Iterator[Hypothesis]:
    """Yields the accelerometer's sign, and the rotations that map axes to axes."""
    text = "the accelerometer's sign is reversed, gravity instead of the specific force"
    undo = Mend("sign of the accelerometer turned", factors={ACCELEROMETER: -1.0})
    yield Hypothesis("imu_frame", text, undo)
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.zeros((3, 3))
        turn[range(3), order] = signs
        if np.linalg.det(turn) > 0 and not np.array_equal(turn, np.eye(3)):
            axes = ", ".join(("" if sign > 0 else "-") + "xyz"[k] for k, sign in zip(order, signs, strict=True))
            said = f"the IMU's frame is wrong: its axes ({axes}) are what is taken for (x, y, z) of the trunk"
            yield _turned(turn, said)


def _turned(turn: Array, text: str) -> Hypothesis:
    rows: tuple[tuple[float, float, float], ...] = tuple(map(tuple, turn.tolist()))
    return Hypothesis("imu_frame", text, Mend(f"{text}; turned", turn=rows), "--imu-frame NAME")


def _gyro(factor: float, text: str, option: str) -> Hypothesis:
    return Hypothesis("gyro_unit", text, Mend(f"{text}, converted", factors={GYRO: factor}), option)
