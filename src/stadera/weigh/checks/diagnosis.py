"""Consistency checks on a log, run before estimation. Each finding names the fault and the evidence for it.

Sensors that fall silent, an IMU that does not show gravity or is turned, joints in another order, torques of another
sign: each gives a robot of some weight, but not its own. So a log is compared with what is impossible for a robot on
its feet (`consistency`), and the usual mistakes are tried on it (`hypotheses`).

What cannot be seen: on a robot that stands symmetrically, left and right or front and hind legs that are swapped, and
an IMU turned about the vertical, look right until the trunk tilts. Left and right swapped may stay hidden even then,
where the hips' roll axes point the same way on both sides (Go2).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stadera.constants import GRAVITY
from stadera.logs.recording import Imu, Recording
from stadera.logs.sampling import GAP_FACTOR
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.types import Array
from stadera.weigh.checks.consistency import Consistency, ConsistencyModel, Sensed, block_means, blocks_of
from stadera.weigh.checks.hypotheses import explain
from stadera.weigh.checks.limits import CheckLimits

FATAL = ("no_torque", "imu_gravity", "imu_frame", "torque_signs", "joint_order")
"""Causes that leave nothing to weigh by."""


@dataclass(frozen=True)
class Finding:
    """Something wrong with a log.

    Attributes:
        cause: in one word: dropout, stuck, no_torque, imu_gravity, imu_frame, orientation, torque_signs, joint_order,
            not_on_feet, contradiction.
        message: the fault and the evidence for it, one sentence.
    """

    cause: str
    message: str


def diagnose(
    recording: Recording, robot: Robot, imu_frame: str | None = None, limits: CheckLimits | None = None
) -> tuple[Finding, ...]:
    """What is wrong with a log of a robot that is on its feet, standing or walking.

    Args:
        recording: with all of the robot's joints and efforts for more than dropouts to be found; without an IMU torques
            are compared with the encoders alone.
        robot: its model.
        imu_frame: frame of the IMU's values; None for the recording's own, else the model's.
        limits: None for the defaults.

    Returns:
        Findings, silent sensors first; none where no fault can be seen.

    Raises:
        UnknownNameError: no such frame.
    """
    limits = limits or CheckLimits()
    found = [*_silences(recording), *_stuck(recording, limits)]
    if not set(robot.tree.joints) <= set(recording.joints) or len(recording) < 2:
        return tuple(found)
    gravity = () if recording.imu is None else tuple(_gravity(recording.imu, limits))
    found += gravity
    if recording.effort is None or gravity:
        return tuple(found)
    if recording.imu is not None:
        found += _orientation(recording.imu, recording.time, limits)
    found += _contradictions(recording, robot, _mount(recording, robot, imu_frame), limits)
    return tuple(found)


def contradictions(recording: Recording, robot: Robot, imu_frame: str | None = None) -> tuple[str, ...]:
    """What is impossible in a log of a robot on its feet, a clause each, without a search for the cause.

    Arguments and errors as `diagnose`; the recording has all of the robot's joints and their torques.
    """
    limits = CheckLimits()
    sensed = _sensed(recording, robot, _mount(recording, robot, imu_frame), limits.samples)
    return tuple(ConsistencyModel(robot, limits).evaluate(sensed).faults())


def _mount(recording: Recording, robot: Robot, imu_frame: str | None) -> ImuMount | None:
    return None if recording.imu is None else ImuMount.of(robot, imu_frame or recording.imu.frame)


# -- silent sensors ------------------------------------------------------------------------------------------------


def _silences(recording: Recording) -> Iterator[Finding]:
    steps = np.diff(recording.time)
    if not len(steps):
        return
    period = float(np.median(steps))
    wide = np.flatnonzero(steps > GAP_FACTOR * period)
    if len(wide):
        longest = wide[np.argmax(steps[wide])]
        yield Finding(
            "dropout",
            f"{len(wide)} gap{'s' * (len(wide) > 1)} in time of more than {GAP_FACTOR:g} samples, "
            f"{steps[wide].sum():.3g} s altogether, the longest {steps[longest]:.3g} s at "
            f"{recording.time[longest]:.3f} s: sensors or the logger dropped out",
        )


def _stuck(recording: Recording, limits: CheckLimits) -> Iterator[Finding]:
    """Signals that repeat bit for bit for a while, though they do not elsewhere; torques that are zero."""
    if recording.effort is not None:
        silent = [j for j, values in zip(recording.joints, recording.effort.T, strict=True) if not values.any()]
        if silent:
            yield Finding("no_torque", f"the torque of {_listed(silent)} is zero throughout")
    groups: dict[tuple[float, float], list[str]] = {}
    for name, values in _signals(recording):
        if (span := _longest_repeat(recording.time, values, limits)) is not None:
            groups.setdefault(span, []).append(name)
    for (begin, end), names in groups.items():
        yield Finding(
            "stuck",
            f"{_listed(names)} stand{'s' * (len(names) == 1)} still bit for bit from {begin:.3f} to {end:.3f} s, and "
            f"change{'s' * (len(names) == 1)} with every sample elsewhere: a sensor that dropped out",
        )


def _signals(recording: Recording) -> Iterator[tuple[str, Array]]:
    for channel in ("position", "velocity", "effort"):
        values = getattr(recording, channel)
        if values is not None:
            yield from ((f"{joint}.{channel}", values[:, i]) for i, joint in enumerate(recording.joints))
    if recording.imu is not None:
        for quantity in ("angular_velocity", "linear_acceleration"):
            rows = getattr(recording.imu, quantity)
            yield from ((f"imu.{quantity}.{axis}", rows[:, i]) for i, axis in enumerate("xyz"))


def _longest_repeat(time: Array, values: Array, limits: CheckLimits) -> tuple[float, float] | None:
    """Begin and end of the longest repetition of a lively signal, if that is too long."""
    changes = np.flatnonzero(np.diff(values))
    edges = np.concatenate([[-1], changes, [len(values) - 1]])
    runs = np.diff(edges)  # samples of equal value
    at = int(np.argmax(runs))
    begin, end = time[edges[at] + 1], time[edges[at + 1]]
    others = len(values) - runs[at]
    lively = others > 1 and len(runs) - 1 >= limits.lively * others
    return (float(begin), float(end)) if lively and end - begin > limits.stuck and runs[at] > 5 else None


# -- the IMU by itself ----------------------------------------------------------------------------------------------


def _gravity(imu: Imu, limits: CheckLimits) -> Iterator[Finding]:
    sizes = np.linalg.norm(imu.linear_acceleration, axis=1)
    size = float(np.median(sizes))
    mean = float(np.linalg.norm(imu.linear_acceleration.mean(axis=0)))
    if min(abs(size - GRAVITY), abs(mean - GRAVITY)) < limits.gravity:
        return
    if mean < 0.5:
        why = "gravity seems to have been taken out; what an accelerometer reads itself is needed"
    elif abs(size - 1.0) < 0.1:
        why = "it seems to be in units of g; m/s² are needed"
    else:
        why = "its unit or scale is wrong"
    yield Finding("imu_gravity", f"the specific force is {size:.3g} m/s² where gravity is {GRAVITY:g} m/s²: {why}")


def _orientation(imu: Imu, time: Array, limits: CheckLimits) -> Iterator[Finding]:
    """Up by the orientation against up by the accelerometer, on average in IMU axes."""
    if imu.orientation is None:
        return
    quaternion = _thin(imu.orientation, limits.samples)
    block = blocks_of(_thin(time, limits.samples), limits.block)
    force = block_means(_thin(imu.linear_acceleration, limits.samples), block)

    def angle(xyzw: Array) -> float:
        up = block_means(_up(xyzw), block)
        across, along = np.linalg.norm(np.cross(up, force), axis=1), (up * force).sum(axis=1)
        return float(np.median(np.arctan2(across, along)))

    now = angle(quaternion)
    if now <= limits.upright:
        return
    ways = {
        "the quaternion seems to be in the order w, x, y, z": quaternion[:, [1, 2, 3, 0]],
        "the quaternion seems to be of the world in the IMU's frame, the inverse": quaternion * [-1, -1, -1, 1],
    }
    angles = {why: angle(other) for why, other in ways.items()}
    why = min(angles, key=lambda w: angles[w])
    said = f": {why}" if angles[why] < limits.upright else ""
    yield Finding("orientation", f"the IMU's orientation has up {np.degrees(now):.0f}° off its own accelerometer{said}")


def _up(xyzw: Array) -> Array:
    """The world's z axis in the body's axes, (samples, 3); NaN-free for quaternions that are not zero."""
    x, y, z, w = (xyzw / np.linalg.norm(xyzw, axis=1, keepdims=True)).T
    return np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])


# -- all sensors together -------------------------------------------------------------------------------------------


def _contradictions(
    recording: Recording, robot: Robot, mount: ImuMount | None, limits: CheckLimits
) -> Iterator[Finding]:
    model = ConsistencyModel(robot, limits)
    now = model.evaluate(_sensed(recording, robot, mount, limits.samples))
    faults = list(now.faults())
    if not faults:
        return
    if now.hangs:
        yield Finding(
            "not_on_feet",
            f"the feet carry {now.weighs:.2g} kg of {robot.mass:.3g} kg: the robot is not on its feet, or its torques "
            "are not in N·m",
        )
        return
    if (found := explain(_sensed(recording, robot, mount, limits.trial_samples), model)) is not None:
        others = "".join(f", or {other.text}" for other in found.others)
        text = f"{found.hypothesis.text}{others}: as recorded, {_listing(faults)}; otherwise {_fit(found.without)}"
        yield Finding(found.hypothesis.cause, text)
        return
    who = "encoders, torques and IMU" if now.imu else "encoders and torques"
    yield Finding("contradiction", f"{who} contradict each other: {_listing(faults)}{_outlier(now)}")


def _outlier(now: Consistency) -> str:
    """Which of the three sources of the vertical disagrees with the two others."""
    if not now.imu:
        return "; check the joints' names, and the torques' signs and units"
    close, far = np.radians(15.0), np.radians(25.0)
    if now.plane_force_angle < close and now.plane_angle > far:
        return "; the feet's plane and their forces agree, so that it is the IMU's frame that seems wrong"
    if now.plane_angle < close and now.force_angle > far:
        return "; IMU and the feet's plane agree, so that it is the torques that seem wrong"
    if max(now.plane_force_angle, now.plane_angle, now.force_angle) < close and (now.loads > 0).all():
        return "; all directions agree, so that it is the torques' unit or scale, or the model, that seems wrong"
    return "; check the joints' names, the torques' signs and units, and the IMU's frame"


def _sensed(recording: Recording, robot: Robot, mount: ImuMount | None, most: int) -> Sensed:
    joints = robot.tree.joints
    imu, force = recording.imu, None
    if imu is not None and mount is not None:
        force = mount.in_trunk_axes(_thin(imu.linear_acceleration, most))
    return Sensed(
        time=_thin(recording.time, most),
        position=_thin(recording.channel("position", joints), most),
        effort=_thin(recording.channel("effort", joints), most),
        specific_force=force,
    )


def _thin(values: Array, most: int) -> Array:
    return values[:: -(-len(values) // most)]


def _listing(faults: list[str]) -> str:
    more = f" and {len(faults) - 3} more" if len(faults) > 3 else ""
    return ", ".join(faults[:3]) + more


def _fit(figures: Consistency) -> str:
    return f"it would weigh {figures.weighs:.3g} kg, the model {figures.robot.mass:.3g} kg, and nothing contradicts"


def _listed(names: list[str], most: int = 4) -> str:
    return ", ".join(map(repr, names[:most])) + (f" and {len(names) - most} more" if len(names) > most else "")
