"""Faults of sensors and wiring, applied to a correct log, and forces other than a load, applied in its simulation.

Joint, leg and time of a fault are drawn at random.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.constants import GRAVITY
from stadera.inertia import InertialParameters
from stadera.lab.plant.payload import OutsideForce, Tray
from stadera.lab.plant.whole import whole_robot
from stadera.logs import Imu, Recording, take
from stadera.robot.limbs import Limbs, inwards
from stadera.robot.model import Leg, Robot
from stadera.types import Array

Rng = np.random.Generator
Pick = Callable[[Recording, Robot, Rng], Sequence[int]]
"""Draws the columns of the joints with the fault."""
Change = Callable[[Array, float, Rng], Array]
"""A function from a joint's values (samples,) and its effort limit to the faulty values."""
ImuChange = Callable[[Array], Array]
"""A function from an IMU's values (samples, 3) to the faulty values."""


@dataclass(frozen=True)
class Fault:
    """A fault."""

    group: str  # effort, encoder, velocity, imu, time, arms or model
    spoil: Callable[[Recording, Robot, Rng], Recording]  # applies the fault to a log, or leaves one that cannot have it
    hidden: str = ""  # why it cannot show in a log, if so; empty otherwise
    motions: tuple[str, ...] = ()  # in which it cannot show; empty for all
    model: Callable[[Robot], Robot] = lambda robot: robot  # the robot of the model file, from the right one


# -- which joints -----------------------------------------------------------------------------------------------------
def _leg(robot: Robot, rng: Rng) -> Leg:
    return robot.legs[int(rng.integers(len(robot.legs)))]


def _one_of(part: slice) -> Pick:
    """Draws one joint of a part of one leg."""

    def pick(log: Recording, robot: Robot, rng: Rng) -> Sequence[int]:
        joints = _leg(robot, rng).joints[part]
        return (log.index(joints[int(rng.integers(len(joints)))]),)

    return pick


_one, _hip_or_knee, _knee = (_one_of(part) for part in (slice(None), slice(1, None), slice(-1, None)))


def _every(log: Recording, _: Robot, __: Rng) -> Sequence[int]:
    return range(len(log.joints))


def arms_of(robot: Robot) -> list[tuple[str, ...]]:
    """Joints of two alike limbs besides the legs, or of the only one, from the trunk outwards."""
    extra, limbs = robot.extra, Limbs.of(robot)
    if extra is None:
        return []
    tips = limbs.hands[0] if limbs.hands else limbs.ends
    return [tuple(extra.joints[k] for k in reversed(list(inwards(extra, tip)))) for tip in tips]


def _of_arms(log: Recording, robot: Robot, _: Rng) -> Sequence[int]:
    return [log.index(joint) for arm in arms_of(robot) for joint in arm]


def _one_of_arms(log: Recording, robot: Robot, rng: Rng) -> Sequence[int]:
    joints = _of_arms(log, robot, rng)
    return joints and (joints[int(rng.integers(len(joints)))],)


# -- what is wrong with them ------------------------------------------------------------------------------------------
_GROUPS = {"effort": "effort", "position": "encoder", "velocity": "velocity"}


def _joint(channel: str, change: Change, pick: Pick = _one, hidden: str = "", group: str = "") -> Fault:
    """A fault of the joints drawn by `pick`, each by itself."""

    def spoil(log: Recording, robot: Robot, rng: Rng) -> Recording:
        values, limits = log.channel(channel, log.joints).copy(), whole_robot(robot).limits
        columns = pick(log, robot, rng)
        for column in columns:
            values[:, column] = change(values[:, column], limits[log.joints[column]].effort, rng)
        return _with(log, channel, values) if columns else log

    return Fault(group or _GROUPS[channel], spoil, hidden)


def _with(log: Recording, channel: str, values: Array) -> Recording:
    return replace(log, **{channel: values})  # type: ignore[arg-type]


def _scaled(factor: float) -> Change:
    return lambda values, _, __: factor * values


def _stuck(values: Array, _: float = 0.0, __: Rng | None = None) -> Array:
    """Holds the values from a third of the log on."""
    values[len(values) // 3 :] = values[len(values) // 3]
    return values


def _noise(signal: float, noise: float) -> Change:
    """A share of the signal, and white noise, as a share of the signal's size; of a dead sensor only that."""
    return lambda values, _, rng: signal * values + noise * values.std() * rng.standard_normal(len(values))


def _clipped(share: float) -> Change:
    def change(values: Array, _: float, __: Rng) -> Array:
        most = share * np.abs(values).max()
        return np.clip(values, -most, most)

    return change


def _offset(amount: float, of_limit: bool = False, jumps: bool = False) -> Change:
    """An offset to either side, as a share of the effort limit if so, and from the middle of the log on if it jumps."""

    def change(values: Array, limit: float, rng: Rng) -> Array:
        values[len(values) // 2 if jumps else 0 :] += amount * (limit if of_limit else 1.0) * rng.choice([-1.0, 1.0])
        return values

    return change


def _wild(value: float, of_limit: bool = False) -> Change:
    """Replaces five successive samples."""

    def change(values: Array, limit: float, rng: Rng) -> Array:
        at = int(rng.integers(len(values) // 4, 3 * len(values) // 4))
        values[at : at + 5] = value * (limit if of_limit else 1.0)
        return values

    return change


def _late(channel: str, seconds: float, pick: Pick = _every) -> Fault:
    def spoil(log: Recording, robot: Robot, rng: Rng) -> Recording:
        values = log.channel(channel, log.joints).copy()
        for column in pick(log, robot, rng):
            values[:, column] = np.interp(log.time - seconds, log.time, values[:, column])
        return _since(seconds, _with(log, channel, values))

    return Fault(_GROUPS[channel], spoil)


def _since(seconds: float, log: Recording) -> Recording:
    """The log without its beginning, for which late signals have no values."""
    return take(log, log.time > log.time[0] + seconds)


Pairs = Callable[[Robot], Sequence[tuple[Sequence[str], Sequence[str]]]]
"""Joints of limbs that are swapped, the first of one with the first of the other and so on; none on some robots."""


def _legs(*pairs: tuple[int, int]) -> Pairs:
    """Pairs of legs, by their places; of a robot with two legs the first pair only, if it is of these."""
    return lambda robot: [(robot.legs[a].joints, robot.legs[b].joints) for a, b in pairs if max(a, b) < len(robot.legs)]


def _legs_with_arms(robot: Robot) -> Sequence[tuple[Sequence[str], Sequence[str]]]:
    return [(leg.joints, arm) for leg, arm in zip(robot.legs, arms_of(robot), strict=False)]


def _two_arms(robot: Robot) -> Sequence[tuple[Sequence[str], Sequence[str]]]:
    arms = arms_of(robot)
    return [(arms[0], arms[1])] if len(arms) == 2 else []


def _swapped(group: str, channels: Sequence[str], pairs: Pairs, mirror: bool = False) -> Fault:
    """Limbs swapped; `mirror`: left with right legs."""

    def spoil(log: Recording, robot: Robot, _: Rng) -> Recording:
        order = np.arange(len(log.joints))
        if not (limbs := pairs(robot)):
            return log
        for one, other in limbs:
            for a, b in zip(one, other, strict=False):
                order[[log.index(a), log.index(b)]] = log.index(b), log.index(a)
        for channel in channels:
            log = _with(log, channel, log.channel(channel, log.joints)[:, order])
        return log

    return Fault(group, spoil, _MIRROR, ("stand", "squat")) if mirror else Fault(group, spoil)


def _hip_and_knee_swapped(log: Recording, robot: Robot, rng: Rng) -> Recording:
    joints, values = _leg(robot, rng).joints, log.channel("effort", log.joints).copy()
    pair = [log.index(joints[1]), log.index(joints[2])]
    values[:, pair] = values[:, pair[::-1]]
    return _with(log, "effort", values)


# -- IMU and time -----------------------------------------------------------------------------------------------------
def _imu(which: str, change: ImuChange, hidden: str = "") -> Fault:
    """Changes the gyro's values, the accelerometer's ("force"), or both; the orientation is lost."""

    def spoil(log: Recording, _: Robot, __: Rng) -> Recording:
        if (imu := log.imu) is None:
            return log
        gyro = imu.angular_velocity if which == "force" else change(imu.angular_velocity.copy())
        force = imu.linear_acceleration if which == "gyro" else change(imu.linear_acceleration.copy())
        return replace(log, imu=Imu(gyro, force, None, imu.frame))

    return Fault("imu", spoil, hidden)


def _turned(axis: str, degrees: float) -> ImuChange:
    return lambda values: np.asarray(Rotation.from_euler(axis, degrees, degrees=True).apply(values))


def _imu_late(log: Recording, robot: Robot, rng: Rng, seconds: float = 0.08) -> Recording:
    def late(values: Array) -> Array:
        return np.column_stack([np.interp(log.time - seconds, log.time, column) for column in values.T])

    return _since(seconds, _imu("both", late).spoil(log, robot, rng))


# -- arms and model ---------------------------------------------------------------------------------------------------
def _without_arms(log: Recording, robot: Robot, _: Rng) -> Recording:
    gone = [joint for arm in arms_of(robot) for joint in arm]
    return log.of_joints(tuple(joint for joint in log.joints if joint not in gone))


def _armless(robot: Robot) -> Robot:
    """The model whose joints outside the legs were cut off, with all that is beyond them."""
    if (extra := robot.extra) is None:
        return robot
    trunk = robot.inertias[robot.trunk] - extra.lumped
    return replace(robot, inertias={**robot.inertias, robot.trunk: trunk}, extra=None)


def _larger(robot: Robot, by: float = 1.15) -> Robot:
    """The model of a robot of another size whose joints have the same names; outside its legs as it is."""
    powers = by ** np.array([3.0, *[4.0] * 3, *[5.0] * 6])
    scaled = {link: InertialParameters(powers * robot.inertias[link].vector) for link in robot.tree.links[1:]}
    legs = tuple(replace(leg, foot_position=tuple(by * np.array(leg.foot_position))) for leg in robot.legs)
    tree = replace(robot.tree, translations=by * robot.tree.translations)
    return replace(robot, tree=tree, legs=legs, inertias={**robot.inertias, **scaled})


_SIDES, _ENDS, _DIAGONAL = _legs((0, 1), (2, 3)), _legs((0, 2), (1, 3)), _legs((0, 3))
_MIRROR = "sides swapped on a robot that stands symmetrically are the mirror image of its load, and nothing moves"
_ALL_LARGER = "legs that are larger all over carry another weight by the same torques and move alike"
_COMMON = "a common factor of all torques, or of the accelerometer, is the same as another weight"

SIGNAL_FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        "efforts of left and right legs swapped": _swapped("effort", ("effort",), _SIDES, mirror=True),
        "efforts of front and hind legs swapped": _swapped("effort", ("effort",), _ENDS),
        "efforts of two legs swapped": _swapped("effort", ("effort",), _DIAGONAL),
        "efforts of a leg's hip and knee swapped": Fault("effort", _hip_and_knee_swapped),
        "one torque x2": _joint("effort", _scaled(2.0)),
        "one torque x0.5": _joint("effort", _scaled(0.5)),
        "one torque's sign": _joint("effort", _scaled(-1.0)),
        "all torques x2": _joint("effort", _scaled(2.0), _every),
        "all torques x1.15": _joint("effort", _scaled(1.15), _every, _COMMON),
        "one torque zero": _joint("effort", _scaled(0.0)),
        "one torque stuck": _joint("effort", _stuck),
        "one torque only noise": _joint("effort", _noise(0.0, 0.1), _hip_or_knee),
        "a leg's torques only noise": _joint(
            "effort", _noise(0.0, 0.1), lambda log, *drawn: [log.index(j) for j in _leg(*drawn).joints]
        ),
        "a knee clipped at 80 %": _joint("effort", _clipped(0.8), _knee),
        "a knee clipped at 50 %": _joint("effort", _clipped(0.5), _knee),
        "one torque 20 % of its limit off": _joint("effort", _offset(0.2, of_limit=True)),
        "one torque jumps by 10 % of its limit": _joint("effort", _offset(0.1, of_limit=True, jumps=True)),
        "five samples of 1e4 N·m": _joint("effort", _wild(1e4)),
        "five samples of three times the limit": _joint("effort", _wild(3.0, of_limit=True)),
        "torques 60 ms late": _late("effort", 0.06),
        "one torque 60 ms late": _late("effort", 0.06, _one),
        "one encoder 10° off": _joint("position", _offset(np.radians(10.0))),
        "one encoder jumps by 5°": _joint("position", _offset(np.radians(5.0), jumps=True)),
        "one encoder's sign": _joint("position", _scaled(-1.0)),
        "one encoder stuck": _joint("position", _stuck),
        "one encoder noisy": _joint("position", _noise(1.0, 0.3)),
        "legs' positions and velocities swapped": _swapped("encoder", ("position", "velocity"), _SIDES, mirror=True),
        "whole left and right legs swapped": _swapped(
            "encoder", ("position", "velocity", "effort"), _SIDES, mirror=True
        ),
        "velocities' sign": _joint("velocity", _scaled(-1.0), _every),
        "one velocity's sign": _joint("velocity", _scaled(-1.0)),
        "velocities x2": _joint("velocity", _scaled(2.0), _every),
        "velocities in deg/s": _joint("velocity", _scaled(float(np.degrees(1.0))), _every),
        "one velocity zero": _joint("velocity", _scaled(0.0)),
        "velocities 60 ms late": _late("velocity", 0.06),
        "IMU yawed 90°": _imu("both", _turned("z", 90.0)),
        "IMU yawed 180°": _imu("both", _turned("z", 180.0)),
        "IMU upside down": _imu("both", _turned("x", 180.0)),
        "IMU rolled 20°": _imu("both", _turned("x", 20.0)),
        "gyro yawed 90°": _imu("gyro", _turned("z", 90.0)),
        "gyro's sign": _imu("gyro", np.negative),
        "gyro in deg/s": _imu("gyro", np.degrees),
        "gyro zero": _imu("gyro", np.zeros_like),
        "gyro stuck": _imu("gyro", _stuck),
        "accelerometer in g": _imu("force", lambda values: values / 9.81),
        "accelerometer x1.05": _imu("force", lambda values: 1.05 * values, _COMMON),
        "accelerometer 1 m/s² off aside": _imu("force", lambda values: values + np.array([0.0, 1.0, 0.0])),
        "accelerometer stuck": _imu("force", _stuck),
        "IMU 80 ms late": Fault("imu", _imu_late),
        "clock 10 % slow": Fault(
            "time", lambda log, *_: replace(log, time=log.time[0] + 1.1 * (log.time - log.time[0]))
        ),
        "a fifth of the samples lost": Fault("time", lambda log, _, rng: take(log, rng.random(len(log)) > 0.2)),
        "stamps jump by 0.5 s": Fault(
            "time", lambda log, *_: replace(log, time=log.time + 0.5 * (np.arange(len(log)) > 0.6 * len(log)))
        ),
        "efforts of legs and arms swapped": _swapped("arms", ("effort",), _legs_with_arms),
        "whole legs and arms swapped": _swapped("arms", ("position", "velocity", "effort"), _legs_with_arms),
        "efforts of two arms swapped": _swapped("arms", ("effort",), _two_arms),
        "whole left and right arms swapped": _swapped("arms", ("position", "velocity", "effort"), _two_arms),
        "one torque's sign in an arm": _joint("effort", _scaled(-1.0), _one_of_arms, group="arms"),
        "arms' torques zero": _joint("effort", _scaled(0.0), _of_arms, group="arms"),
        "one torque stuck in an arm": _joint("effort", _stuck, _one_of_arms, group="arms"),
        "one encoder 10° off in an arm": _joint("position", _offset(np.radians(10.0)), _one_of_arms, group="arms"),
        "arms not in the log": Fault("arms", _without_arms),
        "model without arms": Fault("model", lambda log, *_: log, model=_armless),
        "model of legs 15 % larger": Fault("model", lambda log, *_: log, _ALL_LARGER, model=_larger),
    }
)
"""By name."""


# -- forces -----------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Force:
    """An external force, relative to the robot's weight and size."""

    share: float  # of the weight
    direction: tuple[float, float, float]
    place: tuple[float, float]  # on the back, in half sizes of the tray
    lasts: float = float("inf")  # [s]
    gives: float = 0.0  # distance over which it drops to zero or doubles, in half lengths of the tray; 0 if constant
    hidden: str = ""  # why a log cannot distinguish it from a load, if so; empty otherwise

    def make(self, robot: Robot, begin: float) -> OutsideForce:
        """The force on a robot from a time [s] on."""
        tray, size = Tray.of(robot), self.share * robot.mass * GRAVITY
        x, y = tray.centre[:2] + tray.half_size[:2] * self.place
        stiffness = size / (self.gives * float(tray.half_size[0])) if self.gives else 0.0
        at = (float(x), float(y), float(tray.top))
        return OutsideForce(size, self.direction, at, begin, begin + self.lasts, stiffness)


_ALIKE = "a vertical force at one place is what a weight at that place does to a robot that is hardly accelerated"

FORCES: Mapping[str, Force] = MappingProxyType(
    {
        "a person pushes from the side": Force(0.10, (0.0, 1.0, 0.0), (0.0, -1.0), lasts=1.5),
        "a person pushes from behind": Force(0.10, (1.0, 0.0, 0.0), (-1.0, 0.0)),
        "a person carries a tenth": Force(0.10, (0.0, 0.0, 1.0), (1.0, 0.0), hidden=_ALIKE),
        "a rope to the rear": Force(0.10, (-1.0, 0.0, 0.3), (-1.0, 0.0), gives=2.0),
        "leaning on a wall": Force(0.08, (0.0, 1.0, 0.0), (0.0, -1.0), gives=0.1),
    }
)
"""By name."""
