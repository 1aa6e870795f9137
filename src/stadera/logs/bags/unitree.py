"""Decodes LowState of Unitree's robots: motors without names and an IMU in one message, with a counter and no
header. unitree_go is sent by quadrupeds, unitree_hg by humanoids, of which a G1 is read.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
        at = _offsets(topic, aligned=encoding == "cdr")
        count = 1 + max(int(name.split(".")[1]) for name in at if name.startswith("motor_state."))
        self._names = motors_of(topic.kind, joints)
        motors = [f"motor_state.{k}.{name}" for name in ("q", "dq", "tau_est") for k in range(len(self._names))]
        self._mode = at.get("mode_pr") if self._names is G1_MOTORS else None
        imu = [f"imu_state.gyroscope.{k}" for k in range(3)] + [f"imu_state.accelerometer.{k}" for k in range(3)]
        quaternion = [f"imu_state.quaternion.{k}" for k in (1, 2, 3, 0)]  # w comes first in the message
        self._start = 4 if encoding == "cdr" else 0
        self._words = _byte_places([at[name] for name in (*motors, *imu, *quaternion)], 4)
        self._angles = _byte_places([at[f"motor_state.{k}.q"] for k in range(count)], 4)
        self._tick = _byte_places([at["tick"]], 4)
        self._columns = (*joint_columns(self._names), *IMU_NAMES)
        self.clock, self.motors = TickClock(settings), 0

    def __call__(self, messages: Sequence[Message]) -> list[Decoded]:
        """The values of successive messages. Raises ValueError: they are of several sizes or orders of bytes."""
        content = [uncompressed(message.data) for message in messages]
        if len(set(map(len, content))) > 1 or len({self._order_of(data) for data in content}) > 1:
            raise ValueError("messages of several layouts")
        order = self._order_of(content[0])
        body = np.frombuffer(b"".join(content), np.uint8).reshape(len(content), -1)[:, self._start :]
        if self._mode is not None and body[:, self._mode].any():
            raise ClosedLoopError(
                f"{messages[0].topic}: ankles and waist are in mode AB (mode_pr 1): their values are those of two "
                "motors in parallel, from which the joints' pitch and roll do not follow; record in mode PR"
            )

        values = _numbers_at(body, self._words, f"{order}f4").astype(np.float64)
        values[~values[:, -4:].any(axis=1), -4:] = np.nan
        ticks = _numbers_at(body, self._tick, f"{order}u4")[:, 0].tolist()
        if not self.motors:
            self.motors = 1 + int(np.flatnonzero(_numbers_at(body, self._angles, f"{order}f4")[0]).max(initial=-1))
        received = np.array([message.received for message in messages])
        stamps = [self.clock.stamp(*one) for one in zip(received.tolist(), ticks, strict=True)]
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


def _offsets(topic: Topic, *, aligned: bool) -> dict[str, int]:
    """Like `offsets`, from the definition in the log, else Unitree's."""
    usual = published(topic.kind)
    try:
        return offsets(topic.kind, topic.definition or usual, aligned=aligned)
    except RecordingError:
        raise
    except Exception:  # of many kinds, if the definition is damaged or in another language
        if not usual:
            raise RecordingError(f"the definition of {topic.kind} in this log cannot be read") from None
        return offsets(topic.kind, usual, aligned=aligned)


def motors_of(kind: str, joints: Sequence[str] | None) -> tuple[str, ...]:
    """The motors of a kind of message: a G1's if a humanoid sends it, unless another robot's joints are asked for."""
    humanoid = kind == LOW_STATES[1] and (joints is None or not set(joints).isdisjoint(G1_MOTORS))
    return G1_MOTORS if humanoid else MOTORS


def offsets(kind: str, definition: str, *, aligned: bool = True, most: int = 10_000) -> dict[str, int]:
    """Position of each number in a message's body [bytes], by path, such as "motor_state.3.q". Raises RecordingError:
    the definition lacks fields of a LowState.

    In CDR numbers are aligned to their own size (OMG CDR), in ROS 1's encoding they are not. Fields after one of
    unknown size are skipped. Names of the ROS 1 packages (motorState, tauEst, imu, footForce) are converted to those of
    ROS 2. Unitree's messages have under a thousand numbers, and `most` is a limit.
    """
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import get_types_from_msg

    types = get_types_from_msg(definition, kind)
    found: dict[str, int] = {}
    end = 0
    for path, size in _numbers(types, (Nodetype.NAME, kind), ""):
        start = -(-end // size) * size if aligned else end
        snake = re.sub(r"(?<=[a-z])([A-Z])", lambda match: f"_{match[1].lower()}", path[1:])
        found[re.sub(r"^imu\.", "imu_state.", snake)], end = start, start + size
        if len(found) > most:
            raise RecordingError(f"a {kind} in this log has more than {most} numbers: it is not Unitree's")
    if missing := [name for name in ("tick", "imu_state.quaternion.3", "motor_state.11.tau_est") if name not in found]:
        raise RecordingError(f"a {kind} in this log has no {missing[0]}: its definition is not Unitree's")
    return found


def _numbers(types: Mapping[str, Any], description: Any, path: str) -> Iterator[tuple[str, int]]:
    """Path and size [bytes] of every number of a field, in order, until a part of unknown size."""
    from rosbags.interfaces import Nodetype

    node, detail = description
    if node == Nodetype.BASE:
        yield path, np.dtype(detail[0]).itemsize
    elif node == Nodetype.NAME:
        for field, inner in types[detail][1]:
            yield from _numbers(types, inner, f"{path}.{field}")
    elif node == Nodetype.ARRAY:
        for k in range(detail[1]):
            yield from _numbers(types, detail[0], f"{path}.{k}")
    else:
        raise RecordingError(f"{path[1:]}: a field of unknown size, which a LowState does not have")


def _byte_places(offsets: Sequence[int], size: int) -> NDArray[np.int64]:
    """Positions of the bytes of some numbers, (numbers, size)."""
    return np.array(offsets, dtype=np.int64)[:, None] + np.arange(size)


def _numbers_at(rows: NDArray[np.uint8], places: NDArray[np.int64], kind: str) -> NDArray[Any]:
    """Numbers of a type at these positions of each row of bytes, (rows, numbers)."""
    return rows.take(places.ravel(), axis=1).view(kind)
