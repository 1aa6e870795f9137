"""Checks of single sensors: gaps in time, signals that stop, and an orientation that contradicts its accelerometer."""

from collections.abc import Iterator

import numpy as np

from stadera.checks.finding import Finding
from stadera.checks.limits import CheckLimits
from stadera.checks.statics import block_means, blocks_of
from stadera.errors import listed
from stadera.logs.mend import Mend, upwards
from stadera.logs.recording import Imu, Recording
from stadera.logs.sampling import GAP_FACTOR
from stadera.types import Array


def sensor_findings(recording: Recording, limits: CheckLimits) -> Iterator[Finding]:
    """Finds gaps in time, torques that are zero, and signals that repeat bit for bit for a while but not elsewhere."""
    steps = np.diff(recording.time)
    wide = np.flatnonzero(steps > GAP_FACTOR * np.median(steps)) if len(steps) else np.empty(0, dtype=np.int64)
    if len(wide):
        longest = wide[np.argmax(steps[wide])]
        yield Finding(
            "dropout",
            f"{len(wide)} gap{'s' * (len(wide) > 1)} in time of more than {GAP_FACTOR:g} samples, "
            f"{steps[wide].sum():.3g} s altogether, the longest {steps[longest]:.3g} s at "
            f"{recording.time[longest] - recording.time[0]:.3f} s: sensors or the logger dropped out",
        )
    if recording.effort is not None:
        silent = [j for j, values in zip(recording.joints, recording.effort.T, strict=True) if not values.any()]
        if silent:
            yield Finding("no_torque", f"the torque of {listed([*map(repr, silent)], 4)} is zero throughout")
    groups: dict[tuple[float, float], list[str]] = {}
    for name, values in _signals(recording):
        span = _longest_repeat(recording.time, values, limits)
        if span is not None and not _rests(recording, name, span, limits):
            groups.setdefault(span, []).append(repr(name))
    for (begin, end), names in groups.items():
        first, s = float(recording.time[0]), "s" * (len(names) == 1)
        yield Finding(
            "stuck",
            f"{listed(names, 4)} stand{s} still bit for bit from {begin - first:.3f} to {end - first:.3f} s, and "
            f"change{s} with every sample elsewhere: a sensor that dropped out",
            span=(begin, end),
        )


def _rests(recording: Recording, name: str, span: tuple[float, float], limits: CheckLimits) -> bool:
    """True for a signal of a joint that rests meanwhile by its other signals: drives report a rest as zero velocity,
    and a torque that is computed from a position that stands is as still.
    """
    joint, _, channel = name.rpartition(".")
    if joint not in recording.joints or recording.velocity is None:
        return False
    inside, at = (recording.time >= span[0]) & (recording.time <= span[1]), recording.index(joint)
    moved = float(np.ptp(recording.position[inside, at]))
    if channel == "effort":
        return moved == 0.0
    silent = recording.velocity[:, at] == 0.0
    return moved < limits.rests and bool(silent[inside].all() and not silent.all())


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
    """Begin and end of the longest repetition of a lively signal, if it is too long."""
    edges = np.concatenate([[-1], np.flatnonzero(np.diff(values)), [len(values) - 1]])
    runs = np.diff(edges)  # samples of equal value
    at = int(np.argmax(runs))
    begin, end = time[edges[at] + 1], time[edges[at + 1]]
    others = len(values) - runs[at]
    lively = others > 1 and len(runs) - 1 >= limits.lively * others
    return (float(begin), float(end)) if lively and end - begin > limits.stuck and runs[at] > 5 else None


def orientation_findings(imu: Imu, time: Array, limits: CheckLimits) -> Iterator[Finding]:
    """Compares the vertical from the orientation with that from the accelerometer, on average in IMU axes."""
    if imu.orientation is None:
        return
    every = slice(None, None, -(-len(time) // limits.samples))
    quaternion, block = imu.orientation[every], blocks_of(time[every], limits.block)
    force = block_means(imu.linear_acceleration[every], block)

    def angle(xyzw: Array) -> float:
        up = block_means(upwards(xyzw), block)
        across, along = np.linalg.norm(np.cross(up, force), axis=1), (up * force).sum(axis=1)
        return float(np.median(np.arctan2(across, along)))

    now = angle(quaternion)
    if now <= limits.upright:
        return
    wxyz, inverse = angle(quaternion[:, [1, 2, 3, 0]]), angle(quaternion * [-1, -1, -1, 1])
    text = f"the IMU's orientation has up {np.degrees(now):.0f}° off its own accelerometer"
    kind, why = "wxyz", "the quaternion seems to be in the order w, x, y, z"
    if inverse < wxyz:
        kind, why = "inverse", "the quaternion seems to be of the world in the IMU's frame, the inverse"
    if min(wxyz, inverse) < limits.upright:
        yield Finding("orientation", f"{text}: {why}", mend=Mend(f"{why}, and put right", quaternion=kind))
    else:
        yield Finding("orientation", text)
