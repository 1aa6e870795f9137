"""Reduces a log for the checks: means and slopes over instants of 40 ms, thinned out evenly by whole seconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stadera.checks.limits import CheckLimits
from stadera.logs.mend import ACCELEROMETER, GYRO, Mend
from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount
from stadera.types import Array

_CHANNELS = {"position": "position", "velocity": "rate", "effort": "effort"}
_VECTORS = {ACCELEROMETER: "specific_force", GYRO: "angular_velocity"}


@dataclass(frozen=True, eq=False)
class Instants:
    """Instants of a log, joints in the requested order."""

    joints: tuple[str, ...]
    time: Array  # (instants,) [s], midpoints
    # (instants,), index of the stretch without gaps, of up to a second, that contains each instant
    group: NDArray[np.int64]
    # position, effort: (instants, n) [rad, N·m], means
    position: Array
    rate: Array  # (instants, n) [rad/s], slopes of the positions; NaN where an instant has too few samples
    effort: Array
    # (instants, n) [rad/s], slopes of ∫ q̇ dt of the recorded velocities, which equal `rate` however fast a joint shakes
    # within an instant; None if there are none
    velocity: Array | None = None
    # specific_force, angular_velocity: (instants, 3) [m/s², rad/s], trunk axes, means; None without an IMU
    specific_force: Array | None = None
    angular_velocity: Array | None = None
    lever: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m], of the IMU, trunk frame

    def __len__(self) -> int:
        return len(self.time)

    @classmethod
    def of(cls, recording: Recording, joints: Sequence[str], mount: ImuMount | None, limits: CheckLimits) -> Instants:
        """The instants of a recording that has these joints; missing efforts are zero. Without a mount, vectors are in
        the IMU's own axes.
        """
        chosen = [recording.index(joint) for joint in joints]
        steps = np.diff(recording.time)
        period = float(np.median(steps)) if len(steps) else limits.instant
        resolved = limits.instant_samples * period <= 2.0 * limits.instant
        n = max(round(limits.instant / period), limits.instant_samples) if resolved else 1
        rows = _thinned(len(recording) // n, limits.instants, limits)

        def cut(values: Array) -> Array:
            return np.asarray(values[: len(values) // n * n].reshape(-1, n, *values.shape[1:])[rows])

        def mean(values: Array) -> Array:
            return np.asarray(cut(values).mean(axis=1))

        def slope(values: Array) -> Array:
            with np.errstate(invalid="ignore", divide="ignore"):
                return np.asarray((centred * values).sum(axis=1) / (centred**2).sum(axis=1))

        def way(velocity: Array) -> Array:
            steps = 0.5 * (velocity[:, 1:] + velocity[:, :-1]) * np.diff(time, axis=1)[..., None]
            return np.concatenate([np.zeros_like(velocity[:, :1]), np.cumsum(steps, axis=1)], axis=1)

        imu, time = recording.imu, cut(recording.time)
        whole = np.ptp(time, axis=1) < limits.whole * n * period
        rows, time = rows[whole], time[whole]
        centred = (time - time.mean(axis=1, keepdims=True))[..., None]
        effort = np.zeros_like(recording.position) if recording.effort is None else recording.effort
        vectors: dict[str, Array] = {}
        if imu is not None:
            vectors = {"specific_force": mean(imu.linear_acceleration), "angular_velocity": mean(imu.angular_velocity)}
        turn = np.eye(3) if mount is None else mount.rotation.T
        return cls(
            joints=tuple(joints),
            time=time.mean(axis=1),
            group=_groups(time.mean(axis=1), n * period, limits),
            position=mean(recording.position[:, chosen]),
            rate=slope(cut(recording.position[:, chosen])),
            effort=mean(effort[:, chosen]),
            velocity=None if recording.velocity is None else slope(way(cut(recording.velocity[:, chosen]))),
            **{name: values @ turn for name, values in vectors.items()},
            lever=np.zeros(3) if mount is None else mount.translation,
        )

    @property
    def complete(self) -> bool:
        """True with an IMU and the rates of all joints."""
        return self.angular_velocity is not None and bool(np.isfinite(self.rate).all())

    def thinned(self, most: int, limits: CheckLimits) -> Instants:
        """Thinned out evenly to at most `most` instants, by whole seconds."""
        rows = _thinned(len(self), most, limits)
        return self if len(rows) == len(self) else self.at(rows)

    def at(self, rows: NDArray[np.int64]) -> Instants:
        """A selection of the instants."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("joints", "lever")}
        return replace(self, **{name: v[rows] for name, v in values.items() if v is not None})

    def after(self, mend: Mend) -> Instants:
        """The instants of the log after a correction, whose turn of the IMU is in trunk axes."""
        touched = {channel for channel, _ in (*mend.swapped, *mend.joint_factors)}
        new: dict[str, Any] = {
            name: mend.of_joints(c, getattr(self, name), self.joints) for c, name in _CHANNELS.items() if c in touched
        }
        for quantity, name in _VECTORS.items():
            if (values := getattr(self, name)) is not None:
                new[name] = mend.of_imu(quantity, values)
        return replace(self, **new)

    def shifted(self, by: int) -> tuple[Instants, Instants]:
        """The instants `by` before others of their stretch, and the same with the IMU's values of these others."""
        here = np.arange(max(-by, 0), len(self) - max(by, 0))
        here = here[self.group[here] == self.group[here + by]]
        now, other = self.at(here), self.at(here + by)
        return now, replace(now, specific_force=other.specific_force, angular_velocity=other.angular_velocity)

    def slopes(self, values: Array) -> Array:
        """Derivatives of values (instants, ...) [1/s], by central differences within each stretch, one-sided at its
        ends; zero for an instant alone.
        """
        inside, each = np.diff(self.group) == 0, values.reshape(len(self), int(np.prod(values.shape[1:])))
        step, slope = np.zeros((len(self) + 1, 1)), np.zeros((len(self) + 1, each.shape[1]))  # before each, and after
        step[1:-1, 0] = np.where(inside, np.diff(self.time), 0.0)
        slope[1:-1][inside] = np.diff(each, axis=0)[inside] / step[1:-1][inside]
        before, after = step[:-1], step[1:]
        central = (after * slope[:-1] + before * slope[1:]) / np.where(before + after > 0.0, before + after, 1.0)
        found = np.where((before > 0.0) & (after > 0.0), central, slope[:-1] + slope[1:])
        return np.asarray(found.reshape(values.shape))


def _thinned(count: int, most: int, limits: CheckLimits) -> NDArray[np.int64]:
    """Indices of at most `most` instants, in whole groups spread evenly."""
    if count <= most:
        return np.arange(count)
    groups = np.unique(np.linspace(0, count // limits.second - 1, max(most // limits.second, 1)).astype(np.int64))
    return np.asarray((groups[:, None] * limits.second + np.arange(limits.second)).ravel())


def _groups(time: Array, length: float, limits: CheckLimits) -> NDArray[np.int64]:
    """Splits the log into stretches without gaps, of up to a second, of instants of this length [s]."""
    new = np.append(True, np.diff(time) > limits.whole * length)[: len(time)]
    start = np.maximum.accumulate(np.where(new, np.arange(len(time)), 0))
    new |= (np.arange(len(time)) - start) % limits.second == 0
    return np.cumsum(new, dtype=np.int64) - 1
