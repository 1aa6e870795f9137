"""LowState of Unitree's robots: motors without names and an IMU in one message, with a counter and no header."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.logs.bags.container import Message, Topic
from stadera.logs.bags.decode import IMU_NAMES, Sample, joint_columns, uncompressed
from stadera.logs.bags.settings import DEFAULTS, BagSettings

LOW_STATES = ("unitree_go/msg/LowState", "unitree_hg/msg/LowState")
MOTORS = tuple(f"{leg}_{part}_joint" for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf"))
"""Unitree's order, and the joints' names in its models."""
_PARTS = {"hip": ("hip", "haa", "abad", "hx"), "thigh": ("thigh", "hfe", "hy"), "calf": ("calf", "kfe", "knee", "kn")}
_LEGS = {"FR": ("fr", "rf"), "FL": ("fl", "lf"), "RR": ("rr", "rh", "hr"), "RL": ("rl", "lh", "hl")}
_SEPARATOR = f"{'=' * 80}\nMSG: "
_IMU = "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\n"
PUBLISHED = {
    LOW_STATES[0]: "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\n"
    "uint16 bandwidth\nIMUState imu_state\nMotorState[20] motor_state\nBmsState bms_state\nint16[4] foot_force\n"
    f"int16[4] foot_force_est\nuint32 tick\n{_SEPARATOR}unitree_go/IMUState\n{_IMU}int8 temperature\n"
    f"{_SEPARATOR}unitree_go/MotorState\nuint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\n"
    "float32 q_raw\nfloat32 dq_raw\nfloat32 ddq_raw\nint8 temperature\nuint32 lost\nuint32[2] reserve\n"
    f"{_SEPARATOR}unitree_go/BmsState\nuint8 version_high\nuint8 version_low\nuint8 status\nuint8 soc\n"
    "int32 current\nuint16 cycle\nint8[2] bq_ntc\nint8[2] mcu_ntc\nuint16[15] cell_vol\n",
    LOW_STATES[1]: "uint32[2] version\nuint8 mode_pr\nuint8 mode_machine\nuint32 tick\nIMUState imu_state\n"
    f"MotorState[35] motor_state\n{_SEPARATOR}unitree_hg/IMUState\n{_IMU}int16 temperature\n"
    f"{_SEPARATOR}unitree_hg/MotorState\nuint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\n"
    "int16[2] temperature\nfloat32 vol\nuint32[2] sensor\nuint32 motorstate\nuint32[4] reserve\n",
}
"""Unitree's definitions (https://github.com/unitreerobotics/unitree_ros2), as far as they are read here."""


class LowStates:
    """Decoder of one topic's messages.

    Attributes:
        clock: that repairs their stamps.
    """

    def __init__(self, topic: Topic, joints: Sequence[str] | None, settings: BagSettings = DEFAULTS) -> None:
        published = PUBLISHED[topic.kind]
        try:
            at = offsets(topic.kind, topic.definition or published)
        except RecordingError:
            raise
        except Exception:  # of many kinds: a definition that is damaged or in another language
            at = offsets(topic.kind, published)
        motors = [f"motor_state.{k}.{name}" for name in ("q", "dq", "tau_est") for k in range(len(MOTORS))]
        imu = [f"imu_state.gyroscope.{k}" for k in range(3)] + [f"imu_state.accelerometer.{k}" for k in range(3)]
        quaternion = [f"imu_state.quaternion.{k}" for k in (1, 2, 3, 0)]  # w comes first in the message
        self._words = np.array([at[name] for name in (*motors, *imu, *quaternion)]) // 4
        self._tick = at["tick"] // 4
        self._columns = (*joint_columns(motor_names(joints)), *IMU_NAMES)
        self.clock = TickClock(settings)

    def __call__(self, message: Message) -> Sample:
        data = uncompressed(message.data)
        order = "<" if data[1] & 1 else ">"
        words: NDArray[Any] = np.frombuffer(data, f"{order}f4", count=len(data) // 4 - 1, offset=4)
        values = words[self._words].astype(np.float64)
        if not values[-4:].any():
            values[-4:] = np.nan
        tick = int(words[self._tick : self._tick + 1].view(f"{order}u4")[0])
        stamp = self.clock.stamp(message.received, tick)
        return Sample(message.topic, message.received, stamp, "", self._columns, values)

    def notes(self, topic: str) -> Iterator[str]:
        """What was done to its messages, one sentence each."""
        if self.clock.repaired:
            yield (
                f"{self.clock.repaired} stamps of {topic} corrected by its counter, by at most "
                f"{1e3 * self.clock.furthest:.3g} ms"
            )
        yield f"foot_force of {topic} is left out: counts of a sensor, not newtons"


class TickClock:
    """Stamps for messages without any: when they were recorded, corrected by the robot's counter of milliseconds.

    A message cannot be recorded before it was sent, so the least delay seen so far is the offset of the recorder's
    clock from the robot's. A stamp more than `counter_late` after that is a late message or a step of the recorder's
    clock, and gets the counter's time. A counter that stands still or starts anew corrects nothing.

    Attributes:
        repaired: stamps that were changed.
        furthest: the largest change [s].
    """

    def __init__(self, settings: BagSettings = DEFAULTS) -> None:
        self._late, self._jump = round(1e9 * settings.counter_late), round(1e9 * settings.counter_jump)
        self._drift = settings.counter_drift
        self.repaired, self.furthest = 0, 0.0
        self._offset, self._tick, self._wraps = 0, -1, 0

    def stamp(self, received: int, tick: int) -> int:
        """The stamp [ns] of a message recorded at `received` [ns] with the counter at `tick` [ms, 32 bits]."""
        passed = (tick - self._tick) % (1 << 32) if self._tick >= 0 else 0
        anew = self._tick < 0 or passed == 0 or passed > 1 << 31
        self._wraps += not anew and tick < self._tick
        counted = (tick + (self._wraps << 32)) * 1_000_000
        offset = received - counted
        if anew:
            self._offset = offset
        elif abs(offset - self._offset) < self._jump:
            self._offset = min(offset, self._offset + round(self._drift * passed * 1e6))
        self._tick = tick
        stamp = counted + min(max(offset, self._offset), self._offset + self._late)
        self.repaired += stamp != received
        self.furthest = max(self.furthest, 1e-9 * abs(stamp - received))
        return stamp


def motor_names(joints: Sequence[str] | None) -> tuple[str, ...]:
    """The motors' names: among the joints asked for, those of the same leg and part; else Unitree's own."""
    return tuple(_match(motor, joints or ()) for motor in MOTORS)


def _match(motor: str, joints: Sequence[str]) -> str:
    leg, part, _ = motor.split("_")
    fitting = [
        joint
        for joint in joints
        if joint.lower().lstrip("_").startswith(_LEGS[leg]) and any(p in joint.lower()[2:] for p in _PARTS[part])
    ]
    return motor if motor in joints or len(fitting) != 1 else fitting[0]


def offsets(kind: str, definition: str) -> dict[str, int]:
    """Where each number of a message is in its CDR body [bytes], by path, such as "motor_state.3.q".

    Numbers are aligned to their own size (OMG CDR). What comes after a field of unknown size is left out.

    Raises:
        RecordingError: a definition without the fields of a LowState.
    """
    from rosbags.typesys import get_types_from_msg

    types = get_types_from_msg(definition, kind)
    found: dict[str, int] = {}
    end = 0
    for path, size in _numbers(types, kind, ""):
        start = -(-end // size) * size
        found[path], end = start, start + size
    if missing := [name for name in ("tick", "imu_state.quaternion.3", "motor_state.11.tau_est") if name not in found]:
        raise RecordingError(f"a {kind} in this log has no {missing[0]}: its definition is not Unitree's")
    return found


def _numbers(types: Mapping[str, Any], kind: str, path: str) -> Iterator[tuple[str, int]]:
    """Path and size [bytes] of every number of a type, in order, until a field of unknown size."""
    for field, description in types[kind][1]:
        yield from _described(types, description, f"{path}{field}")


def _described(types: Mapping[str, Any], description: Any, path: str) -> Iterator[tuple[str, int]]:
    from rosbags.interfaces import Nodetype

    node, detail = description
    if node == Nodetype.BASE:
        yield path, np.dtype(detail[0]).itemsize
    elif node == Nodetype.NAME:
        yield from _numbers(types, detail, f"{path}.")
    elif node == Nodetype.ARRAY:
        for k in range(detail[1]):
            yield from _described(types, detail[0], f"{path}.{k}")
    else:
        raise RecordingError(f"{path}: a field of unknown size, which a LowState does not have")
