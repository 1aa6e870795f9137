"""Reduces a log for the checks: means and slopes over instants of 40 ms, thinned out evenly by whole seconds."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from stadera.checks.limits import CheckLimits
from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class Instants:
    """Instants of a log, joints in the requested order."""

    time: Array  # (instants,) [s], midpoints
    # (instants,), index of the stretch without gaps, of up to a second, that contains each instant
    group: NDArray[np.int64]
    # position, effort: (instants, n) [rad, N·m], means
    position: Array
    rate: Array  # (instants, n) [rad/s], slopes of the positions; NaN where an instant has too few samples
    effort: Array
    velocity: Array | None = None  # (instants, n) [rad/s], means of the recorded velocities; None if there are none
    # specific_force, angular_velocity: (instants, 3) [m/s², rad/s], trunk axes, means; None without an IMU
    specific_force: Array | None = None
    angular_velocity: Array | None = None

    def __len__(self) -> int:
        return len(self.time)

    @classmethod
    def of(cls, recording: Recording, joints: Sequence[str], mount: ImuMount | None, limits: CheckLimits) -> Self:
        """Computes the instants of a recording that has these joints; missing efforts are zero."""
        chosen = [recording.index(joint) for joint in joints]
        steps = np.diff(recording.time)
        period = float(np.median(steps)) if len(steps) else limits.instant
        n = max(round(limits.instant / period), limits.instant_samples) if 2.0 * period <= limits.instant else 1
        count = len(recording) // n
        rows = _thinned(count, limits.instants, limits)
        time = recording.time[: count * n].reshape(count, n)[rows]
        whole = np.ptp(time, axis=1) < limits.whole * n * period
        rows, time = rows[whole], time[whole]

        def cut(values: Array) -> Array:
            return np.asarray(values[: count * n].reshape(count, n, values.shape[1])[rows])

        def mean(values: Array | None) -> Array | None:
            return None if values is None else cut(values).mean(axis=1)

        position = cut(recording.position[:, chosen])
        centred = (time - time.mean(axis=1, keepdims=True))[..., None]
        with np.errstate(invalid="ignore", divide="ignore"):
            rate = (centred * position).sum(axis=1) / (centred**2).sum(axis=1)
        imu = recording.imu
        force = omega = None
        if imu is not None and mount is not None:
            force = mean(mount.in_trunk_axes(imu.linear_acceleration))
            omega = mean(mount.in_trunk_axes(imu.angular_velocity))
        effort = np.zeros_like(recording.position) if recording.effort is None else recording.effort
        middle = time.mean(axis=1)
        return cls(
            time=middle,
            group=_groups(middle, n * period, limits),
            position=position.mean(axis=1),
            rate=rate,
            effort=cut(effort[:, chosen]).mean(axis=1),
            velocity=None if recording.velocity is None else mean(recording.velocity[:, chosen]),
            specific_force=force,
            angular_velocity=omega,
        )

    @property
    def complete(self) -> bool:
        """True with an IMU and the rates of all joints."""
        return (
            self.angular_velocity is not None and self.specific_force is not None and bool(np.isfinite(self.rate).all())
        )

    def thinned(self, most: int, limits: CheckLimits) -> Self:
        """Thinned out evenly to at most `most` instants, by whole seconds."""
        rows = _thinned(len(self), most, limits)
        return self if len(rows) == len(self) else self.at(rows)

    def at(self, rows: NDArray[np.int64]) -> Self:
        """A selection of the instants."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{name: v[rows] for name, v in values.items() if v is not None})


def _thinned(count: int, most: int, limits: CheckLimits) -> NDArray[np.int64]:
    """Indices of at most `most` instants, in whole groups spread evenly."""
    if count <= most:
        return np.arange(count)
    kept = max(most // limits.second, 1)
    groups = np.unique(np.linspace(0, count // limits.second - 1, kept).astype(np.int64))
    return np.asarray((groups[:, None] * limits.second + np.arange(limits.second)).ravel())


def _groups(time: Array, length: float, limits: CheckLimits) -> NDArray[np.int64]:
    """Splits the log into stretches without gaps, of up to a second, of instants of this length [s]."""
    if not len(time):
        return np.empty(0, dtype=np.int64)
    gap = np.concatenate([[0], np.cumsum(np.diff(time) > limits.whole * length)])
    start = np.concatenate([[0], np.flatnonzero(np.diff(gap)) + 1])
    place = np.arange(len(time)) - start[gap]
    second = np.column_stack([gap, place // limits.second])
    return np.unique(second, axis=0, return_inverse=True)[1].ravel().astype(np.int64)
