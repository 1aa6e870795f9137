"""Faults of sensors and wiring, applied to a correct log; joint, leg and time are drawn at random."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.logs import Imu, Recording, take
from stadera.robot.model import Robot
from stadera.types import Array

Rng = np.random.Generator
Spoil = Callable[[Recording, Robot, Rng], Recording]


@dataclass(frozen=True)
class Fault:
    """A fault."""

    group: str  # effort, encoder, velocity, imu, time, or force for external forces
    spoil: Spoil  # applies the fault to a log
    hidden: str = ""  # why it cannot show in a log, if so; empty otherwise
    motions: tuple[str, ...] = ()  # in which it cannot show; empty for all


# -- joints -----------------------------------------------------------------------------------------------------------
def _with(log: Recording, channel: str, values: Array) -> Recording:
    return replace(log, **{channel: values})  # type: ignore[arg-type]


def _values(log: Recording, channel: str) -> Array:
    return log.channel(channel, log.joints).copy()


def _a_joint(robot: Robot, log: Recording, rng: Rng, kind: int | None = None) -> int:
    """Column of a joint: 0 HAA, 1 HFE, 2 KFE, or any."""
    leg = robot.legs[int(rng.integers(4))]
    return log.index(leg.joints[int(rng.integers(3)) if kind is None else kind])


def _scaled(channel: str, factor: float, one: bool, log: Recording, robot: Robot, rng: Rng) -> Recording:
    values = _values(log, channel)
    if one:
        values[:, _a_joint(robot, log, rng)] *= factor
    else:
        values *= factor
    return _with(log, channel, values)


def _legs_swapped(
    channels: Sequence[str], pairs: Sequence[tuple[str, str]], log: Recording, robot: Robot, _: Rng
) -> Recording:
    order = np.arange(len(log.joints))
    for one, other in pairs:
        for a, b in zip(robot.leg(one).joints, robot.leg(other).joints, strict=True):
            order[[log.index(a), log.index(b)]] = log.index(b), log.index(a)
    for channel in channels:
        log = _with(log, channel, _values(log, channel)[:, order])
    return log


def _kinds_swapped(channels: Sequence[str], log: Recording, robot: Robot, rng: Rng) -> Recording:
    """Swaps hip and knee of one leg."""
    leg = robot.legs[int(rng.integers(4))]
    a, b = log.index(leg.joints[1]), log.index(leg.joints[2])
    for channel in channels:
        values = _values(log, channel)
        values[:, [a, b]] = values[:, [b, a]]
        log = _with(log, channel, values)
    return log


def _constant(channel: str, held: bool, log: Recording, robot: Robot, rng: Rng) -> Recording:
    """Sets one joint's value to zero, or holds it from a third of the log on."""
    values, joint = _values(log, channel), _a_joint(robot, log, rng)
    start = len(log) // 3 if held else 0
    values[start:, joint] = values[start, joint] if held else 0.0
    return _with(log, channel, values)


def _noise_only(whole_leg: bool, log: Recording, robot: Robot, rng: Rng) -> Recording:
    """Replaces torques by noise of a tenth of their size, as from a dead sensor."""
    values, leg = _values(log, "effort"), robot.legs[int(rng.integers(4))]
    joints = leg.joints if whole_leg else (leg.joints[int(rng.integers(1, 3))],)
    for joint in map(log.index, joints):
        values[:, joint] = 0.1 * values[:, joint].std() * rng.standard_normal(len(log))
    return _with(log, "effort", values)


def _clipped(share: float, log: Recording, robot: Robot, rng: Rng) -> Recording:
    values, knee = _values(log, "effort"), _a_joint(robot, log, rng, 2)
    most = share * np.abs(values[:, knee]).max()
    values[:, knee] = np.clip(values[:, knee], -most, most)
    return _with(log, "effort", values)


def _offset(
    channel: str, amount: float, of_limit: bool, from_middle: bool, log: Recording, robot: Robot, rng: Rng
) -> Recording:
    values, joint = _values(log, channel), _a_joint(robot, log, rng)
    if of_limit:
        amount *= robot.limits[log.joints[joint]].effort
    values[len(log) // 2 if from_middle else 0 :, joint] += amount * rng.choice([-1.0, 1.0])
    return _with(log, channel, values)


def _wild(count: int, value: float, of_limit: bool, log: Recording, robot: Robot, rng: Rng) -> Recording:
    """Replaces a few successive samples of one joint's torque."""
    values, joint = _values(log, "effort"), _a_joint(robot, log, rng)
    if of_limit:
        value *= robot.limits[log.joints[joint]].effort
    at = int(rng.integers(len(log) // 4, 3 * len(log) // 4))
    values[at : at + count, joint] = value
    return _with(log, "effort", values)


def _late(channel: str, seconds: float, one: bool, log: Recording, robot: Robot, rng: Rng) -> Recording:
    values = _values(log, channel)
    columns = [_a_joint(robot, log, rng)] if one else range(values.shape[1])
    for column in columns:
        values[:, column] = np.interp(log.time - seconds, log.time, values[:, column])
    return _since(seconds, _with(log, channel, values))


def _since(seconds: float, log: Recording) -> Recording:
    """The log without its beginning, for which late signals have no values."""
    return take(log, log.time > log.time[0] + seconds)


def _noisy(channel: str, factor: float, log: Recording, robot: Robot, rng: Rng) -> Recording:
    """Adds noise of `factor` times the signal's own variation to one joint's value."""
    values, joint = _values(log, channel), _a_joint(robot, log, rng)
    values[:, joint] += factor * values[:, joint].std() * rng.standard_normal(len(log))
    return _with(log, channel, values)


# -- IMU --------------------------------------------------------------------------------------------------------------
Change = Callable[[Array, Recording], Array]
"""A function from a copy of an IMU's values (samples, 3) and the log to the faulty values."""


def _imu(which: str, change: Change, log: Recording, _: Robot | None = None, __: Rng | None = None) -> Recording:
    """Changes the gyro's values, the accelerometer's ("force"), or both; the orientation is lost."""
    if (imu := log.imu) is None:
        return log
    gyro = imu.angular_velocity if which == "force" else change(imu.angular_velocity.copy(), log)
    force = imu.linear_acceleration if which == "gyro" else change(imu.linear_acceleration.copy(), log)
    return replace(log, imu=Imu(gyro, force, None, imu.frame))


def _turned(axis: str, degrees: float) -> Change:
    turn = Rotation.from_euler(axis, degrees, degrees=True)
    return lambda values, _: turn.apply(values)


def _held(values: Array, _: Recording) -> Array:
    values[len(values) // 3 :] = values[len(values) // 3]
    return values


def _imu_late(seconds: float, log: Recording, _: Robot, __: Rng) -> Recording:
    def late(values: Array, log: Recording) -> Array:
        return np.column_stack([np.interp(log.time - seconds, log.time, column) for column in values.T])

    return _since(seconds, _imu("both", late, log))


# -- time -------------------------------------------------------------------------------------------------------------
def _stretched(factor: float, log: Recording, _: Robot, __: Rng) -> Recording:
    return replace(log, time=log.time[0] + factor * (log.time - log.time[0]))


_SIDES = (("LF", "RF"), ("LH", "RH"))
_ENDS = (("LF", "LH"), ("RF", "RH"))
_MIRROR = "sides swapped on a robot that stands symmetrically are the mirror image of its load, and nothing moves"
_COMMON = "a common factor of all torques, or of the accelerometer, is the same as another weight"

SIGNAL_FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        "efforts of left and right legs swapped": Fault(
            "effort", partial(_legs_swapped, ("effort",), _SIDES), _MIRROR, ("stand",)
        ),
        "efforts of front and hind legs swapped": Fault("effort", partial(_legs_swapped, ("effort",), _ENDS)),
        "efforts of two legs swapped": Fault("effort", partial(_legs_swapped, ("effort",), (("LF", "RH"),))),
        "efforts of a leg's hip and knee swapped": Fault("effort", partial(_kinds_swapped, ("effort",))),
        "one torque x2": Fault("effort", partial(_scaled, "effort", 2.0, True)),
        "one torque x0.5": Fault("effort", partial(_scaled, "effort", 0.5, True)),
        "one torque's sign": Fault("effort", partial(_scaled, "effort", -1.0, True)),
        "all torques x2": Fault("effort", partial(_scaled, "effort", 2.0, False)),
        "all torques x1.15": Fault("effort", partial(_scaled, "effort", 1.15, False), _COMMON),
        "one torque zero": Fault("effort", partial(_constant, "effort", False)),
        "one torque stuck": Fault("effort", partial(_constant, "effort", True)),
        "one torque only noise": Fault("effort", partial(_noise_only, False)),
        "a leg's torques only noise": Fault("effort", partial(_noise_only, True)),
        "a knee clipped at 80 %": Fault("effort", partial(_clipped, 0.8)),
        "a knee clipped at 50 %": Fault("effort", partial(_clipped, 0.5)),
        "one torque 20 % of its limit off": Fault("effort", partial(_offset, "effort", 0.2, True, False)),
        "one torque jumps by 10 % of its limit": Fault("effort", partial(_offset, "effort", 0.1, True, True)),
        "five samples of 1e4 N·m": Fault("effort", partial(_wild, 5, 1e4, False)),
        "five samples of three times the limit": Fault("effort", partial(_wild, 5, 3.0, True)),
        "torques 60 ms late": Fault("effort", partial(_late, "effort", 0.06, False)),
        "one torque 60 ms late": Fault("effort", partial(_late, "effort", 0.06, True)),
        "one encoder 10° off": Fault("encoder", partial(_offset, "position", np.radians(10.0), False, False)),
        "one encoder jumps by 5°": Fault("encoder", partial(_offset, "position", np.radians(5.0), False, True)),
        "one encoder's sign": Fault("encoder", partial(_scaled, "position", -1.0, True)),
        "one encoder stuck": Fault("encoder", partial(_constant, "position", True)),
        "one encoder noisy": Fault("encoder", partial(_noisy, "position", 0.3)),
        "legs' positions and velocities swapped": Fault(
            "encoder", partial(_legs_swapped, ("position", "velocity"), _SIDES), _MIRROR, ("stand",)
        ),
        "whole left and right legs swapped": Fault(
            "encoder", partial(_legs_swapped, ("position", "velocity", "effort"), _SIDES), _MIRROR, ("stand",)
        ),
        "velocities' sign": Fault("velocity", partial(_scaled, "velocity", -1.0, False)),
        "one velocity's sign": Fault("velocity", partial(_scaled, "velocity", -1.0, True)),
        "velocities x2": Fault("velocity", partial(_scaled, "velocity", 2.0, False)),
        "velocities in deg/s": Fault("velocity", partial(_scaled, "velocity", float(np.degrees(1.0)), False)),
        "one velocity zero": Fault("velocity", partial(_constant, "velocity", False)),
        "velocities 60 ms late": Fault("velocity", partial(_late, "velocity", 0.06, False)),
        "IMU yawed 90°": Fault("imu", partial(_imu, "both", _turned("z", 90.0))),
        "IMU yawed 180°": Fault("imu", partial(_imu, "both", _turned("z", 180.0))),
        "IMU upside down": Fault("imu", partial(_imu, "both", _turned("x", 180.0))),
        "IMU rolled 20°": Fault("imu", partial(_imu, "both", _turned("x", 20.0))),
        "gyro yawed 90°": Fault("imu", partial(_imu, "gyro", _turned("z", 90.0))),
        "gyro's sign": Fault("imu", partial(_imu, "gyro", lambda v, _: -v)),
        "gyro in deg/s": Fault("imu", partial(_imu, "gyro", lambda v, _: np.degrees(v))),
        "gyro zero": Fault("imu", partial(_imu, "gyro", lambda v, _: 0.0 * v)),
        "gyro stuck": Fault("imu", partial(_imu, "gyro", _held)),
        "accelerometer in g": Fault("imu", partial(_imu, "force", lambda v, _: v / 9.81)),
        "accelerometer x1.05": Fault("imu", partial(_imu, "force", lambda v, _: 1.05 * v), _COMMON),
        "accelerometer 1 m/s² off aside": Fault(
            "imu", partial(_imu, "force", lambda v, _: v + np.array([0.0, 1.0, 0.0]))
        ),
        "accelerometer stuck": Fault("imu", partial(_imu, "force", _held)),
        "IMU 80 ms late": Fault("imu", partial(_imu_late, 0.08)),
        "clock 10 % slow": Fault("time", partial(_stretched, 1.1)),
        "a fifth of the samples lost": Fault("time", lambda log, _, rng: take(log, rng.random(len(log)) > 0.2)),
    }
)
"""By name."""
