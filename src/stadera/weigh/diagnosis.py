"""What is wrong with a log, and what points to it, before anything is weighed by it.

Sensors that fall silent, an IMU that never shows gravity or is turned, joints in another order, torques of another
sign: each of these gives a robot that weighs something, only not what it does. A log is therefore held against what no
robot on its feet can do (`stadera.weigh.consistency`), and the usual mistakes are tried on it (`suspects`).

What cannot be told: on a robot that stands symmetrically, left and right or front and hind legs that are swapped, and
an IMU turned about the vertical, look right; they show once the trunk tilts. Left and right swapped may hide even then,
where the hips' roll axes point the same way on both sides (Go2).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.errors import IdentificationError
from stadera.recording.recording import Imu, Recording
from stadera.recording.sampling import GAP_FACTOR
from stadera.regressors.motion import STANDARD_GRAVITY
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.weigh.consistency import Painter, Picture, Sensed, block_means, blocks_of
from stadera.weigh.suspects import verdict

Array = NDArray[np.float64]

MOST_SAMPLES, FEWER_SAMPLES = 4000, 200
"""Samples that a log is thinned out to for a first look, and for trying out suspects."""
STUCK = 0.05
"""s; a value that repeats bit for bit for longer, in a signal that elsewhere does not, is no measurement."""
LIVELY = 0.9
"""Share of the steps at which a signal that is measured anew each time changes."""
GRAVITY_OFF = 0.6
"""m/s², that the mean specific force may be off gravity's."""
UPRIGHT_OFF = np.radians(10.0)
"""By how much orientation and accelerometer may differ on where up is [rad]."""

FATAL = ("no_torque", "imu_gravity", "imu_frame", "torque_signs", "joint_order")
"""Causes that leave nothing to weigh by."""


@dataclass(frozen=True)
class Finding:
    """Something wrong with a log.

    Attributes:
        cause: in one word: dropout, stuck, no_torque, imu_gravity, imu_frame, orientation, torque_signs, joint_order,
            not_on_feet, contradiction.
        message: what is wrong and what points to it, one sentence.
        grave: whether figures found from the log would be wrong; else what is wrong was left out.
    """

    cause: str
    message: str
    grave: bool = True


def diagnose(recording: Recording, robot: Robot, imu_frame: str | None = None) -> tuple[Finding, ...]:
    """What is wrong with a log of a robot that is on its feet, standing or walking.

    Args:
        recording: with all of the robot's joints and efforts for more than dropouts to be found; without an IMU torques
            are held against the encoders alone.
        robot: its model.
        imu_frame: in which the IMU's values are; None for the recording's own, else the model's.

    Returns:
        Findings, what is silent first; none where nothing is wrong that can be told.

    Raises:
        UnknownNameError: no such frame.
    """
    found = [*_silences(recording), *_stuck(recording)]
    if not set(robot.tree.joints) <= set(recording.joints) or len(recording) < 2:
        return tuple(found)
    gravity = tuple(_gravity(recording.imu)) if recording.imu is not None else ()
    found += gravity
    if recording.effort is None or gravity:
        return tuple(found)
    if recording.imu is None:
        found += _contradictions(recording, robot, None)
    else:
        found += _orientation(recording.imu, recording.time)
        found += _contradictions(recording, robot, ImuMount.of(robot, imu_frame or recording.imu.frame))
    return tuple(found)


def checked(recording: Recording, robot: Robot, imu_frame: str | None = None) -> tuple[str, ...]:
    """The findings as notes, for what goes on to weigh by the log. Arguments as `diagnose`.

    Raises:
        IdentificationError: signs, orders, frames or units are known to be wrong, so that nothing can be weighed by it.
    """
    findings = diagnose(recording, robot, imu_frame)
    for finding in findings:
        if finding.cause in FATAL:
            raise IdentificationError(f"{recording.source}: {finding.message}")
    return tuple(f"{finding.cause.replace('_', ' ')}: {finding.message}" for finding in findings)


# -- sensors that say nothing ---------------------------------------------------------------------------------------


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
            grave=False,
        )


def _stuck(recording: Recording) -> Iterator[Finding]:
    """Signals that stand still bit for bit for a while, though they do not elsewhere; torques that are zero."""
    if recording.effort is not None:
        silent = [j for j, values in zip(recording.joints, recording.effort.T, strict=True) if not values.any()]
        if silent:
            yield Finding("no_torque", f"the torque of {_listed(silent)} is zero throughout")
    groups: dict[tuple[float, float], list[str]] = {}
    for name, values in _signals(recording):
        if (span := _longest_repeat(recording.time, values)) is not None:
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


def _longest_repeat(time: Array, values: Array) -> tuple[float, float] | None:
    """When a lively signal repeats itself for longest, if that is too long."""
    changes = np.flatnonzero(np.diff(values))
    edges = np.concatenate([[-1], changes, [len(values) - 1]])
    runs = np.diff(edges)  # samples of equal value
    at = int(np.argmax(runs))
    begin, end = time[edges[at] + 1], time[edges[at + 1]]
    others = len(values) - runs[at]
    lively = others > 1 and len(runs) - 1 >= LIVELY * others
    return (float(begin), float(end)) if lively and end - begin > STUCK and runs[at] > 5 else None


# -- the IMU by itself ----------------------------------------------------------------------------------------------


def _gravity(imu: Imu) -> Iterator[Finding]:
    sizes = np.linalg.norm(imu.linear_acceleration, axis=1)
    size = float(np.median(sizes))
    mean = float(np.linalg.norm(imu.linear_acceleration.mean(axis=0)))
    if min(abs(size - STANDARD_GRAVITY), abs(mean - STANDARD_GRAVITY)) < GRAVITY_OFF:
        return
    if mean < 0.5:
        why = "gravity seems to have been taken out; what an accelerometer reads itself is needed"
    elif abs(size - 1.0) < 0.1:
        why = "it seems to be in units of g; m/s² are needed"
    else:
        why = "its unit or scale is wrong"
    yield Finding(
        "imu_gravity", f"the specific force is {size:.3g} m/s² where gravity is {STANDARD_GRAVITY:g} m/s²: {why}"
    )


def _orientation(imu: Imu, time: Array) -> Iterator[Finding]:
    """Where the orientation says that up is, against the accelerometer, on average in IMU axes."""
    if imu.orientation is None:
        return
    quaternion = _thin(imu.orientation)
    block = blocks_of(_thin(time))
    force = block_means(_thin(imu.linear_acceleration), block)

    def angle(xyzw: Array) -> float:
        up = block_means(_up(xyzw), block)
        across, along = np.linalg.norm(np.cross(up, force), axis=1), (up * force).sum(axis=1)
        return float(np.median(np.arctan2(across, along)))

    now = angle(quaternion)
    if now <= UPRIGHT_OFF:
        return
    ways = {
        "the quaternion seems to be in the order w, x, y, z": quaternion[:, [1, 2, 3, 0]],
        "the quaternion seems to be of the world in the IMU's frame, the inverse": quaternion * [-1, -1, -1, 1],
    }
    angles = {why: angle(other) for why, other in ways.items()}
    why = min(angles, key=lambda w: angles[w])
    said = f": {why}" if angles[why] < UPRIGHT_OFF else ""
    yield Finding("orientation", f"the IMU's orientation has up {np.degrees(now):.0f}° off its own accelerometer{said}")


def _up(xyzw: Array) -> Array:
    """The world's z axis in the body's axes, (samples, 3); NaN-free for quaternions that are not zero."""
    x, y, z, w = (xyzw / np.linalg.norm(xyzw, axis=1, keepdims=True)).T
    return np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])


# -- all sensors together -------------------------------------------------------------------------------------------


def _contradictions(recording: Recording, robot: Robot, mount: ImuMount | None) -> Iterator[Finding]:
    painter = Painter(robot)
    now = painter.paint(_sensed(recording, robot, mount, MOST_SAMPLES))
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
    sensed = _sensed(recording, robot, mount, FEWER_SAMPLES)
    if (found := verdict(sensed, painter, painter.paint(sensed))) is not None:
        others = "".join(f", or {other.text}" for other in found.others)
        said = f"{found.suspect.text}{others}: as recorded, {_told(faults)}; otherwise {_fits(found.picture)}"
        yield Finding(found.suspect.cause, said)
        return
    who = "encoders, torques and IMU" if now.imu else "encoders and torques"
    yield Finding("contradiction", f"{who} contradict each other: {_told(faults)}{_witness(now)}")


def _witness(now: Picture) -> str:
    """Which one of three witnesses of the vertical stands alone."""
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
        force = _thin(imu.linear_acceleration, most) @ mount.rotation.T
    return Sensed(
        time=_thin(recording.time, most),
        position=_thin(recording.channel("position", joints), most),
        effort=_thin(recording.channel("effort", joints), most),
        specific_force=force,
    )


def _thin(values: Array, most: int = MOST_SAMPLES) -> Array:
    return values[:: -(-len(values) // most)]


def _told(faults: list[str]) -> str:
    more = f" and {len(faults) - 3} more" if len(faults) > 3 else ""
    return ", ".join(faults[:3]) + more


def _fits(picture: Picture) -> str:
    return f"it would weigh {picture.weighs:.3g} kg, the model {picture.robot.mass:.3g} kg, and nothing contradicts"


def _listed(names: list[str], most: int = 4) -> str:
    return ", ".join(map(repr, names[:most])) + (f" and {len(names) - most} more" if len(names) > most else "")
