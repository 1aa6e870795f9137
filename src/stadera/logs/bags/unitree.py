"""Decodes LowState of Unitree's robots: motors without names and an IMU in one message, with a counter and no
header. unitree_go is sent by quadrupeds, unitree_hg by humanoids, of which a G1 is read.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from stadera.errors import ClosedLoopError, RecordingError
from stadera.logs.bags.container import BagSettings, Decoded, Message, Topic
from stadera.logs.bags.decode import IMU_NAMES, joint_columns, published, uncompressed

LOW_STATES = ("unitree_go/msg/LowState", "unitree_hg/msg/LowState")
MOTORS = tuple(f"{leg}_{part}_joint" for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf"))
"""Unitree's order of the motors, and the joints' names in its models."""
_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
G1_MOTORS = (
    *(f"{side}_{part}_joint" for side in ("left", "right") for part in _LEG),
    *(f"waist_{part}_joint" for part in ("yaw", "roll", "pitch")),
    *(f"{side}_{part}_joint" for side in ("left", "right") for part in _ARM),
)
"""The same of a G1 with 29 joints, as its developers' guide numbers them."""


class LowStates:
    """Decoder of one topic's messages, with the clock that repairs their stamps, and the number of motors with values
    in the first message.
    """

    def __init__(
        self, topic: Topic, encoding: str, joints: Sequence[str] | None, settings: BagSettings | None = None
    ) -> None:
        self._start, self._record = 4 if encoding == "cdr" else 0, _record_of(topic, aligned=encoding == "cdr")
        self._names = motors_of(topic.kind, joints)
        motors = [f"motor_state.{k}.{name}" for name in ("q", "dq", "tau_est") for k in range(len(self._names))]
        imu = [f"imu_state.gyroscope.{k}" for k in range(3)] + [f"imu_state.accelerometer.{k}" for k in range(3)]
        quaternion = [f"imu_state.quaternion.{k}" for k in (1, 2, 3, 0)]  # w comes first in the message
        self._values = (*motors, *imu, *quaternion)
        self._columns = (*joint_columns(self._names), *IMU_NAMES)
        self.clock, self.motors = TickClock(settings), 0

    def __call__(self, messages: Sequence[Message]) -> list[Decoded]:
        """The values of successive messages. Raises ValueError: they are of several sizes or orders of bytes."""
        content = [uncompressed(message.data) for message in messages]
        if len(set(map(len, content))) > 1 or len({self._order_of(data) for data in content}) > 1:
            raise ValueError("messages of several layouts")
        record = self._record if self._order_of(content[0]) == "<" else self._record.newbyteorder()
        records = np.ndarray(len(content), record, b"".join(content), self._start, len(content[0]))
        names = record.names or ()
        if self._names is G1_MOTORS and "mode_pr" in names and records["mode_pr"].any():
            raise ClosedLoopError(
                f"{messages[0].topic}: ankles and waist are in mode AB (mode_pr 1): their values are those of two "
                "motors in parallel, from which the joints' pitch and roll do not follow; record in mode PR"
            )
        values = np.stack([records[name] for name in self._values], axis=1).astype(np.float64)
        values[~values[:, -4:].any(axis=1), -4:] = np.nan
        if not self.motors:
            angles = [name for name in names if re.fullmatch(r"motor_state\.\d+\.q", name)]
            self.motors = 1 + max((k for k, name in enumerate(angles) if records[name][0] != 0.0), default=-1)
        received = np.array([message.received for message in messages])
        stamps = [self.clock.stamp(*one) for one in zip(received.tolist(), records["tick"].tolist(), strict=True)]
        return [Decoded(messages[0].topic, received, np.array(stamps), "", self._columns, values)]

    def _order_of(self, data: bytes) -> str:
        """Order of the bytes, which CDR states."""
        return "<" if not self._start or data[1] & 1 else ">"

    def notes(self, topic: str) -> Iterator[str]:
        """Yields notes on the messages, one sentence each."""
        yield from self.clock.notes(topic)
        if self.motors > len(self._names) == len(MOTORS):
            yield f"{topic} has {self.motors} motors: the legs' twelve are read, {', '.join(MOTORS[:3])} and so on"


class TickClock:
    """Stamps for messages without any: the times of recording, corrected by the robot's millisecond counter.

    A stamp more than `counter_late` after the least delay is a late message or a step of the recorder's clock, and gets
    the counter's time. Messages of a burst stay a quarter of the counter's steps apart. A counter that stands still or
    restarts is ignored. `repaired` stamps were changed, the `furthest` by [s].
    """

    def __init__(self, settings: BagSettings | None = None) -> None:
        settings = settings or BagSettings()
        self._late, self._jump = round(1e9 * settings.counter_late), round(1e9 * settings.counter_jump)
        self._drift = settings.counter_drift
        self.repaired, self.furthest = 0, 0.0
        self._offset, self._tick, self._wraps, self._last = 0, -1, 0, 0

    def stamp(self, received: int, tick: int) -> int:
        """The stamp [ns] of a message recorded at `received` [ns] with the counter at `tick` [ms, 32 bits]."""
        passed = (tick - self._tick) % (1 << 32) if self._tick >= 0 else 0
        anew = self._tick < 0 or passed == 0 or passed > 1 << 31
        self._wraps += not anew and tick < self._tick
        counted = (tick + (self._wraps << 32)) * 1_000_000
        offset = received - counted
        if anew:
            self._offset, self._last = offset, -(1 << 62)
        elif abs(offset - self._offset) < self._jump:
            self._offset = min(offset, self._offset + round(self._drift * passed * 1e6))
        stamp = max(counted + min(max(offset, self._offset), self._offset + self._late), self._last + passed * 250_000)
        self._tick, self._last = tick, stamp
        self.repaired += stamp != received
        self.furthest = max(self.furthest, 1e-9 * abs(stamp - received))
        return stamp

    def notes(self, topic: str) -> Iterator[str]:
        """Yields notes on the corrections, one sentence each."""
        if self.repaired:
            yield f"{self.repaired} stamps of {topic} corrected by its counter, by at most {1e3 * self.furthest:.3g} ms"


def _record_of(topic: Topic, *, aligned: bool) -> np.dtype[np.void]:
    """Like `record_of`, from the definition in the log, else Unitree's."""
    usual = published(topic.kind)
    try:
        return record_of(topic.kind, topic.definition or usual, aligned=aligned)
    except RecordingError:
        raise
    except Exception:  # of many kinds, if the definition is damaged or in another language
        if not usual:
            raise RecordingError(f"the definition of {topic.kind} in this log cannot be read") from None
        return record_of(topic.kind, usual, aligned=aligned)


def motors_of(kind: str, joints: Sequence[str] | None) -> tuple[str, ...]:
    """The motors of a kind of message: a G1's if a humanoid sends it, unless another robot's joints are asked for."""
    humanoid = kind == LOW_STATES[1] and (joints is None or not set(joints).isdisjoint(G1_MOTORS))
    return G1_MOTORS if humanoid else MOTORS


def record_of(kind: str, definition: str, *, aligned: bool = True, most: int = 10_000) -> np.dtype[np.void]:
    """The numbers in a message's body, little-endian, by path, such as "motor_state.3.q". Raises RecordingError: the
    definition lacks fields of a LowState.

    In CDR numbers are aligned to their own size (OMG CDR), in ROS 1's encoding they are not. A field of
    unknown size is refused. Names of the ROS 1 packages (motorState, tauEst, imu, footForce) are converted to those of
    ROS 2. Unitree's messages have under a thousand numbers, and `most` is a limit.
    """
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import get_types_from_msg

    types = get_types_from_msg(definition, kind)
    found: dict[str, tuple[np.dtype[Any], int]] = {}
    end = 0
    for path, number in _numbers(types, (Nodetype.NAME, kind), ""):
        start = -(-end // number.itemsize) * number.itemsize if aligned else end
        snake = re.sub(r"(?<=[a-z])([A-Z])", lambda match: f"_{match[1].lower()}", path[1:])
        found[re.sub(r"^imu\.", "imu_state.", snake)], end = (number, start), start + number.itemsize
        if len(found) > most:
            raise RecordingError(f"a {kind} in this log has more than {most} numbers: it is not Unitree's")
    if missing := [name for name in ("tick", "imu_state.quaternion.3", "motor_state.11.tau_est") if name not in found]:
        raise RecordingError(f"a {kind} in this log has no {missing[0]}: its definition is not Unitree's")
    kinds, places = zip(*found.values(), strict=True)
    return np.dtype({"names": list(found), "formats": kinds, "offsets": places}).newbyteorder("<")


def _numbers(types: Mapping[str, Any], description: Any, path: str) -> Iterator[tuple[str, np.dtype[Any]]]:
    """Path and type of every number of a field, in order. RecordingError: a part of unknown size."""
    from rosbags.interfaces import Nodetype

    node, detail = description
    if node == Nodetype.BASE:
        yield path, np.dtype(detail[0])
    elif node == Nodetype.NAME:
        for field, inner in types[detail][1]:
            yield from _numbers(types, inner, f"{path}.{field}")
    elif node == Nodetype.ARRAY:
        for k in range(detail[1]):
            yield from _numbers(types, detail[0], f"{path}.{k}")
    else:
        raise RecordingError(f"{path[1:]}: a field of unknown size, which a LowState does not have")
