"""How a fault of a log is undone: an operation on the recordings that it is read as, for whole logs and for streams."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stadera.constants import GRAVITY
from stadera.logs.recording import Imu, Recording
from stadera.types import Array

CHANNELS = ("position", "velocity", "acceleration", "effort")
GYRO, ACCELEROMETER = "gyro", "accelerometer"


@dataclass(frozen=True)
class Mend:
    """One operation; fields that are left out change nothing.

    Attributes:
        text: what is done, for a note.
        factors: by quantity ("time", a channel of the joints, "gyro", "accelerometer"), what it is multiplied with.
        joint_factors: the same, by channel and joint.
        swapped: by channel and joint, the joint in whose columns the values of this one are.
        turn: rows of the rotation that turns the IMU's values into the axes they should be in.
        gravity: whether gravity, by the IMU's orientation, is put back into the specific force.
        quaternion: where w is first: "wxyz"; of the world in the IMU's frame: "inverse".
    """

    text: str
    factors: Mapping[str, float] = field(default_factory=dict)
    joint_factors: Mapping[tuple[str, str], float] = field(default_factory=dict)
    swapped: Mapping[tuple[str, str], str] = field(default_factory=dict)
    turn: tuple[tuple[float, float, float], ...] = ()
    gravity: bool = False
    quaternion: str = ""

    def sources(self, joints: Iterable[str]) -> tuple[str, ...]:
        """The joints whose columns are needed for these joints' values."""
        needed = dict.fromkeys(joints)
        others = [source for (_, joint), source in self.swapped.items() if joint in needed]
        return tuple(needed | dict.fromkeys(others))

    def __call__(self, recording: Recording) -> Recording:
        """The recording as it should be; joints whose columns are swapped need to be in it."""
        changed = recording.mapped(self._scaled)
        channels = {c: getattr(changed, c) for c in CHANNELS}
        kept = {c: self._joints(c, v, recording.joints) for c, v in channels.items() if v is not None}
        imu = None if changed.imu is None else self._imu(changed.imu)
        return replace(changed, **kept, imu=imu)  # type: ignore[arg-type]

    def _scaled(self, name: str, values: Array) -> Array:
        quantity = {"imu.angular_velocity": GYRO, "imu.linear_acceleration": ACCELEROMETER}.get(name, name)
        return values * self.factors[quantity] if quantity in self.factors else values

    def _joints(self, channel: str, values: Array, joints: Sequence[str]) -> Array:
        order = [joints.index(self.swapped.get((channel, joint), joint)) for joint in joints]
        factor = np.array([self.joint_factors.get((channel, joint), 1.0) for joint in joints])
        return np.asarray(values[:, order] * factor)

    def _imu(self, imu: Imu) -> Imu:
        turn, orientation = np.array(self.turn or np.eye(3)), imu.orientation
        if orientation is not None and self.quaternion:
            orientation = orientation[:, [1, 2, 3, 0]] if self.quaternion == "wxyz" else orientation * [-1, -1, -1, 1]
        force = imu.linear_acceleration
        if self.gravity and orientation is not None:
            force = force + GRAVITY * upwards(orientation)
        if self.turn and orientation is not None:
            orientation = None  # of a frame that is not the values' any more
        return replace(imu, angular_velocity=imu.angular_velocity @ turn.T, linear_acceleration=force @ turn.T,
                       orientation=orientation)  # fmt: skip


def mended(chunks: Iterable[Recording], mends: Sequence[Callable[[Recording], Recording]]) -> Iterable[Recording]:
    """Consecutive chunks of a log with all mends applied, in order; the first one's notes say so."""
    for k, chunk in enumerate(chunks):
        notes = tuple(f"mended: {mend.text}" for mend in mends if isinstance(mend, Mend)) if k == 0 else ()
        changed = chunk
        for mend in mends:
            changed = mend(changed)
        yield replace(changed, notes=(*chunk.notes, *notes))


def upwards(xyzw: Array) -> Array:
    """The world's z axis in the body's axes, (samples, 3), of orientations that are not zero."""
    x, y, z, w = (xyzw / np.linalg.norm(xyzw, axis=1, keepdims=True)).T
    return np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
