"""Cuts samples of a moving robot into blocks, and skips samples that are not finite or out of order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf, isfinite, nan

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement, extra_states, not_finite
from stadera.trunk.settings import TrunkSettings
from stadera.types import Array, Bools

_SLACK = 1e-6  # s, of rounding in stamps
_ROOM = 32  # samples for which there is room at first

_NONE = np.zeros((0, 0))
_NAMES = ("time", "position", "velocity", "effort", "angular_velocity", "specific_force", "extra")
_OF_ONE = ("time", "joint_position", "joint_velocity", *_NAMES[3:])  # the same of a `Measurement`


@dataclass(frozen=True, eq=False)
class Samples:
    """Consecutive samples, IMU values in the trunk's axes.

    Attributes:
        time: (n,) [s].
        position, velocity, effort: (n, joints) [rad, rad/s, N·m], in the tree's order.
        angular_velocity: (n, 3) [rad/s].
        specific_force: (n, 3) [m/s²], at the IMU's place.
        extra: (n, 3 k), positions, velocities and efforts of the k joints outside the legs, zero efforts where not
            known; (n, 0) if they do not move.

    Raises:
        RecordingError: shapes that do not fit together.
    """

    time: Array
    position: Array
    velocity: Array
    effort: Array
    angular_velocity: Array
    specific_force: Array
    extra: Array = field(default_factory=lambda: _NONE)

    def __post_init__(self) -> None:
        n, joints = len(self.time), self.position.shape[-1]
        if self.extra is _NONE:
            object.__setattr__(self, "extra", np.zeros((n, 0)))
        shapes = ((n,), *[(n, joints)] * 3, *[(n, 3)] * 2, (n, self.extra.shape[-1]))
        for name, shape in zip(_NAMES, shapes, strict=True):
            if getattr(self, name).shape != shape:
                raise RecordingError(f"samples' {name} need shape {shape}, got {getattr(self, name).shape}")

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, which: slice | Bools) -> Samples:
        return Samples(*(getattr(self, name)[which] for name in _NAMES))

    def __iter__(self) -> Iterator[Measurement]:
        for time, q, qd, effort, omega, force, extra in zip(*(getattr(self, name) for name in _NAMES), strict=True):
            yield Measurement(float(time), q, qd, effort, omega, force, extra=extra)

    def __add__(self, later: Samples) -> Samples:
        return Samples(*(np.concatenate([getattr(self, name), getattr(later, name)]) for name in _NAMES))

    @property
    def table(self) -> Array:
        """All values, (n, 7 + 3 joints + ...): time, positions, velocities, efforts, angular velocity, specific force,
        other joints.
        """
        return np.column_stack([getattr(self, name) for name in _NAMES])

    @classmethod
    def of(cls, measurements: Sequence[Measurement]) -> Samples:
        """From measurements, at least one."""
        return cls(*(np.array([getattr(m, name) for m in measurements]) for name in _OF_ONE))

    @classmethod
    def of_table(cls, table: Array, joints: int) -> Samples:
        """From a `table`, as views, for a robot with so many joints in its tree."""
        edges = [1, 1 + joints, 1 + 2 * joints, 1 + 3 * joints, 4 + 3 * joints, 7 + 3 * joints, table.shape[1]]
        return cls(table[:, 0], *(table[:, begin:end] for begin, end in pairwise(edges)))

    @classmethod
    def of_recording(cls, recording: Recording, robot: Robot, imu_frame: str | None = None) -> Samples:
        """A whole log.

        Args:
            imu_frame: in which the IMU's values are; None for the recording's own, else the model's.

        Raises:
            RecordingError: the log lacks a joint's velocity or effort, or the IMU.
            UnknownNameError: a joint of the robot is not recorded, or no such frame.
        """
        if recording.imu is None:
            raise RecordingError(
                f"{recording.source}: no IMU; weighing while walking needs columns imu.angular_velocity.x, ..."
            )
        mount = ImuMount.of(robot, imu_frame, recording.imu.frame)
        omega = mount.in_trunk_axes(recording.imu.angular_velocity)
        force = mount.in_trunk_axes(recording.imu.linear_acceleration)
        q, qd, effort = (recording.channel(kind, robot.tree.joints) for kind in ("position", "velocity", "effort"))
        return cls(recording.time, q, qd, effort, omega, force, extra_states(recording, robot))


@dataclass(frozen=True, eq=False)
class Stretch:
    """Result of gathering some samples.

    Attributes:
        table: `Samples.table` of complete blocks, with one more sample before and after them. edges: (blocks + 1,),
            where they begin, counted without the sample before; empty if there are none.
        reason: why a sample was skipped, one sentence; else empty.
        gap: time without samples before them [s]; 0 if they follow on.
        begin: time of the first of them, or of the last one before a sample that was skipped [s].
    """

    table: Array = field(default_factory=lambda: _NONE)
    edges: Sequence[int] = ()
    reason: str = ""
    gap: float = 0.0
    begin: float = nan


class SampleBuffer:
    """Collects samples until a block is full.

    Args:
        joints: names, for messages.
        settings: length of a block, and what is a gap.

    Attributes:
        due: [s], the time of the sample that completes the next block.
    """

    def __init__(self, joints: tuple[str, ...], settings: TrunkSettings) -> None:
        self._joints, self._settings = joints, settings
        self._waiting, self._filled = np.empty((0, 0)), 0
        self._pending: Array | None = None
        self._last, self._step, self._first_steps = -inf, inf, np.empty(0)
        self._latest = -inf  # time of the last measurement that waits
        self.due = -inf

    def gather(self, m: Measurement) -> Array | None:
        """Stores one measurement. Returns the table of all stored ones, for `take`, when a block is full or the
        sequence is broken.
        """
        k, waiting = self._filled, self._waiting
        if k == len(waiting):
            more = np.empty((max(k, _ROOM), 7 + 3 * len(self._joints) + len(m.extra)))
            self._waiting = waiting = np.concatenate([waiting, more]) if k else more
        time, channels = m.time, (m.joint_position, m.joint_velocity, m.effort, m.angular_velocity, m.specific_force)
        finite = _stored(waiting, k, time, *channels, m.extra)
        follows = max(self._latest, self._last) < time < self.due
        self._filled, self._latest = k + 1, time
        if follows and finite:
            return None
        self._waiting, self._filled, self._latest = np.empty_like(waiting), 0, -inf
        return waiting[: k + 1]

    def take(self, table: Array) -> Iterator[Stretch]:
        """Yields the blocks that these samples (n, ...) complete, stretch by stretch."""
        begin = 0
        for bad in (*self._unusable(table), len(table)):
            if begin < bad:
                yield from self._stretches(table[begin:bad])
            if bad < len(table):
                yield Stretch(reason=self._reason(table[bad]), begin=self._last)
            begin = bad + 1

    def _stretches(self, good: Array) -> Iterator[Stretch]:
        time, settings = good[:, 0], self._settings
        steps = np.diff(np.append(self._last if self._last > -inf else time[0], time))
        if len(self._first_steps) < settings.first_steps:
            followed = (steps > 0.0) & (steps <= settings.slow)
            self._first_steps = np.concatenate([self._first_steps, steps[followed]])
            self._step = float(np.median(self._first_steps)) if len(self._first_steps) else inf
        longest = min(max(settings.lost * self._step, settings.bridged), settings.slow)
        cuts = np.flatnonzero(steps > longest).tolist()
        edges = sorted({0, *cuts, len(good)})
        self._last = float(time[-1])
        for start, stop in pairwise(edges):
            gap = float(steps[start]) if start in cuts else 0.0
            reason = ""
            if gap:
                self._pending = None
                if self._step == inf:
                    reason = f"samples are {gap:.3g} s apart, which shows no motion: time is needed in seconds"
            yield Stretch(*self._completed(good[start:stop]), reason=reason, gap=gap, begin=float(time[start]))

    def _completed(self, table: Array) -> tuple[Array, list[int]]:
        pending = table if self._pending is None else np.concatenate([self._pending, table])
        start, edges, time = 0, [0], np.ascontiguousarray(pending[:, 0])
        while True:
            first = float(time[start + 1]) if start + 1 < len(time) else inf
            step = self._step if self._step < inf else 0.0
            self.due = first + max(self._settings.block, step) - _SLACK
            end = max(int(time.searchsorted(self.due)), start + 2)
            if end >= len(time):
                break
            start = end - 1
            edges.append(start)
        self._pending = pending[start:]
        if self.due == inf:
            self.due = -inf
        return pending[: start + 2], edges

    def _unusable(self, table: Array) -> list[int]:
        """The samples that are not finite or not in order."""
        time: Array = table[:, 0]
        in_order = len(time) and time[0] > self._last and (time[1:] > time[:-1]).all()
        values = table.ravel()
        if in_order and isfinite(values.dot(values)):  # a sum of squares shows any value that is not finite
            return []
        finite: Bools = np.asarray(np.isfinite(table).all(axis=1))
        known = np.where(finite, time, -inf)
        before: Array = np.maximum.accumulate(np.concatenate([[self._last], known]))[:-1]
        return np.flatnonzero(~(finite & (known > before))).tolist()

    def _reason(self, sample: Array) -> str:
        """Why a sample is not used."""
        if np.isfinite(sample).all():
            return f"time must increase, got {sample[0]:.6f} s after {self._last:.6f} s"
        return not_finite(next(iter(Samples.of_table(sample[None], len(self._joints)))), self._joints)


def _stored(table: Array, k: int, time: float, *channels: Array) -> bool:
    """Writes a sample into row k of a table. Returns whether all values are finite."""
    row = table[k]
    row[0] = time
    np.concatenate(channels, out=row[1:])
    return isfinite(row.dot(row))  # a value that is not finite makes the sum of squares not finite
