"""Small bags: folders and ROS 1 files written by rosbags, .mcap files by mcap's writer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as FolderWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stadera.logs import Recording
from stadera.logs.bags.decode import published
from stadera.logs.bags.unitree import LOW_STATES

JOINT_STATE, IMU, STRING = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu", "std_msgs/msg/String"
TYPES = get_typestore(Stores.ROS2_JAZZY)
ROS1_TYPES = get_typestore(Stores.ROS1_NOETIC)
OLD_LOW_STATE = "unitree_legged_msgs/msg/LowState"
_LINE = "=" * 80
OTHERS = {
    OLD_LOW_STATE: "uint8 levelFlag\nuint16 bandWidth\nunitree_legged_msgs/IMU imu\n"
    "unitree_legged_msgs/MotorState[20] motorState\nint16[4] footForce\nuint32 tick\n"
    f"{_LINE}\nMSG: unitree_legged_msgs/IMU\nfloat32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\n"
    f"int8 temperature\n{_LINE}\nMSG: unitree_legged_msgs/MotorState\nuint8 mode\nfloat32 q\nfloat32 dq\n"
    "float32 ddq\nfloat32 tauEst\nint8 temperature\nuint32[2] reserve\n",
    "anymal_msgs/msg/AnymalState": "std_msgs/Header header\nint8 state\nany_msgs/ExtendedJointState joints\n"
    f"{_LINE}\nMSG: any_msgs/ExtendedJointState\nstd_msgs/Header header\nstring[] name\nfloat64[] position\n"
    "float64[] velocity\nfloat64[] acceleration\nfloat64[] effort\n",
    "whole_body_state_msgs/msg/WholeBodyState": "std_msgs/Header header\nfloat64 time\n"
    f"whole_body_state_msgs/JointState[] joints\n{_LINE}\nMSG: whole_body_state_msgs/JointState\nstring name\n"
    "float64 position\nfloat64 velocity\nfloat64 acceleration\nfloat64 effort\n",
    "control_msgs/msg/JointTrajectoryControllerState": "std_msgs/Header header\nstring[] joint_names\n"
    "trajectory_msgs/JointTrajectoryPoint reference\ntrajectory_msgs/JointTrajectoryPoint feedback\n",
}
"""Definitions of types that other packages have, shortened."""
STATES = ("control_msgs/msg/DynamicJointState", "pal_statistics_msgs/msg/Statistics")
for _kind, _definition in ({kind: published(kind) for kind in (*LOW_STATES, *STATES)} | OTHERS).items():
    TYPES.register({k: v for k, v in get_types_from_msg(_definition, _kind).items() if k not in TYPES.types})
ROS1_TYPES.register(get_types_from_msg(OTHERS[OLD_LOW_STATE], OLD_LOW_STATE))
NS = 1_000_000_000


class Sent(NamedTuple):
    """A message as it goes into a bag: recorded at `received` [ns]."""

    topic: str
    kind: str
    received: int
    data: bytes


def nanoseconds(seconds: float) -> int:
    return round(seconds * NS)


def joints(
    time: float,
    names: Sequence[str],
    position: Any = (),
    velocity: Any = (),
    effort: Any = (),
    topic: str = "/joint_states",
    received: float | None = None,
) -> Sent:
    channels = (np.ascontiguousarray(values, dtype=float) for values in (position, velocity, effort))
    message = TYPES.types[JOINT_STATE](_header(time, ""), list(names), *channels)
    return _sent(topic, JOINT_STATE, time if received is None else received, message)


def imu(
    time: float,
    gyro: Any = (0.0, 0.0, 0.0),
    force: Any = (0.0, 0.0, 9.81),
    orientation: Any = (0.0, 0.0, 0.0, 1.0),
    topic: str = "/imu/data",
    frame: str = "imu_link",
    known: Sequence[bool] = (True, True, True),
    received: float | None = None,
) -> Sent:
    vector, quaternion = TYPES.types["geometry_msgs/msg/Vector3"], TYPES.types["geometry_msgs/msg/Quaternion"]
    covariances = [np.r_[0.0 if there else -1.0, np.zeros(8)] for there in known]  # orientation, gyro, acceleration
    message = TYPES.types[IMU](
        _header(time, frame),
        quaternion(*map(float, orientation)),
        covariances[0],
        vector(*map(float, gyro)),
        covariances[1],
        vector(*map(float, force)),
        covariances[2],
    )
    return _sent(topic, IMU, time if received is None else received, message)


def text(time: float, topic: str = "/chatter") -> Sent:
    return _sent(topic, STRING, time, TYPES.types[STRING]("hello"))


def low_state(
    received: float,
    position: Any,
    velocity: Any,
    effort: Any,
    tick: int | None = None,
    kind: str = "unitree_go/msg/LowState",
    topic: str = "/lowstate",
    imu: tuple[Any, Any] = ((1, 2, 3), (4, 5, 6)),
    mode_pr: int = 0,
) -> Sent:
    """Of twelve motors and more; the IMU says gyro and specific force, and the quaternion wxyz (0.5, 0.1, 0.7, 0.5)."""
    package = kind.split("/")[0]
    message = _zeros(kind)
    for motor, q, dq, tau in zip(message.motor_state, position, velocity, effort, strict=False):
        motor.q, motor.dq, motor.tau_est = float(q), float(dq), float(tau)
    assert type(message.imu_state).__name__.startswith(package)
    for name, values in (("gyroscope", imu[0]), ("accelerometer", imu[1]), ("quaternion", (0.5, 0.1, 0.7, 0.5))):
        setattr(message.imu_state, name, np.array(values, dtype=np.float32))
    message.tick = (round(1e3 * received) if tick is None else tick) % 2**32
    if hasattr(message, "mode_pr"):
        message.mode_pr = mode_pr
    if hasattr(message, "foot_force"):
        message.foot_force = np.arange(4, dtype=np.int16)
    return _sent(topic, kind, received, message)


def old_low_state(received: float, position: Any, tick: int) -> Sent:
    """Of the ROS 1 packages, torques by one more than the positions; the IMU says what `low_state`'s does."""
    message = _zeros(OLD_LOW_STATE)
    for motor, q in zip(message.motorState, position, strict=False):
        motor.q, motor.tauEst = float(q), float(q) + 1.0
    for name, values in (("gyroscope", (1, 2, 3)), ("accelerometer", (4, 5, 6)), ("quaternion", (0.5, 0.1, 0.7, 0.5))):
        setattr(message.imu, name, np.array(values, dtype=np.float32))
    message.tick = tick
    return _sent("/low_state", OLD_LOW_STATE, received, message)


def states(
    kind: str, time: float, names: Sequence[str], position: Any, velocity: Any, effort: Any, topic: str = "/state"
) -> Sent:
    """Joints' states in a message of another type."""
    make, header, rows = TYPES.types, _header(time, ""), (position, velocity, effort)
    arrays = [np.asarray(row, dtype=float) for row in rows]
    message: Any
    if kind.endswith("AnymalState"):
        part = make["any_msgs/msg/ExtendedJointState"](header, list(names), *arrays[:2], np.empty(0), arrays[2])
        message = make[kind](header, 1, part)
    elif kind.endswith("WholeBodyState"):
        joint = make["whole_body_state_msgs/msg/JointState"]
        message = make[kind](header, 0.0, [joint(n, q, v, 0.0, t) for n, q, v, t in zip(names, *rows, strict=True)])
    elif kind.endswith("DynamicJointState"):
        value = make["control_msgs/msg/InterfaceValue"]
        mixed = [(["effort", "position", "velocity"], [t, q, v]) for q, v, t in zip(*rows, strict=True)]
        message = make[kind](header, list(names), [value(n, np.array(v, dtype=float)) for n, v in mixed])
    elif kind.endswith("Statistics"):
        number = make["pal_statistics_msgs/msg/Statistic"]
        said = [
            ("state_interface", "position", 0),
            ("state_interface", "effort", 2),
            ("command_interface", "effort", 1),
        ]
        listed = [number(f"{a}.{n}/{b}", float(rows[c][k])) for k, n in enumerate(names) for a, b, c in said]
        message = make[kind](header, [number("controller_manager.rate", 1000.0), *listed])
    else:
        duration = make["builtin_interfaces/msg/Duration"](0, 0)
        point = make["trajectory_msgs/msg/JointTrajectoryPoint"]
        wanted, measured = (point(p, v, np.empty(0), t, duration) for p, v, t in (3 * [0 * arrays[0]], arrays))
        message = make[kind](header, list(names), wanted, measured)
    return _sent(topic, kind, time, message)


def _zeros(kind: str) -> Any:
    """A message of this type with all numbers zero."""

    def zero(description: Any) -> Any:
        node, detail = description
        if node == Nodetype.BASE:
            return np.dtype(detail[0]).type(0).item()
        if node == Nodetype.NAME:
            return _zeros(detail)
        element, count = detail
        if element[0] == Nodetype.BASE:
            return np.zeros(count, dtype=element[1][0])
        return [zero(element) for _ in range(count)]

    return TYPES.types[kind](*(zero(description) for _, description in TYPES.fielddefs[kind][1]))


def of_recording(recording: Recording, frame: str = "") -> Iterator[Sent]:
    """A recording's samples as messages with the same stamps."""
    for k, time in enumerate(recording.time):
        values = (getattr(recording, channel) for channel in ("position", "velocity", "effort"))
        yield joints(float(time), recording.joints, *(() if v is None else v[k] for v in values))
        if (unit := recording.imu) is not None:
            turned = unit.orientation is not None
            yield imu(
                float(time),
                unit.angular_velocity[k],
                unit.linear_acceleration[k],
                unit.orientation[k] if unit.orientation is not None else (0, 0, 0, 0),
                frame=unit.frame or frame,
                known=(turned, True, True),
            )


def write_mcap(
    sent: Iterable[Sent],
    path: Path,
    *,
    chunk: int = 1 << 14,
    compression: CompressionType = CompressionType.ZSTD,
    encoding: str = "cdr",
) -> Path:
    """A bare .mcap."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk, compression=compression)
        writer.start(profile="ros2")
        channels: dict[str, int] = {}
        for message in sent:
            if message.topic not in channels:
                definition = TYPES.generate_msgdef(message.kind)[0].encode()
                schema = writer.register_schema(message.kind, "ros2msg", definition)
                channels[message.topic] = writer.register_channel(message.topic, encoding, schema)
            writer.add_message(channels[message.topic], message.received, message.data, message.received)
        writer.finish()
    return path


def write_folder(sent: Iterable[Sent], path: Path, storage: StoragePlugin = StoragePlugin.SQLITE3) -> Path:
    """A rosbag2 folder."""
    with FolderWriter(path, version=9, storage_plugin=storage) as writer:
        connections: dict[str, Any] = {}
        for message in sent:
            if message.topic not in connections:
                connections[message.topic] = writer.add_connection(message.topic, message.kind, typestore=TYPES)
            writer.write(connections[message.topic], message.received, message.data)
    return path


def write_ros1(sent: Iterable[Sent], path: Path, *, chunk: int = 1 << 14, compression: Any = None) -> Path:
    """A ROS 1 .bag."""
    writer = Ros1Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        writer.chunk_threshold = chunk
        connections: dict[str, Any] = {}
        for message in sent:
            if message.topic not in connections:
                connections[message.topic] = writer.add_connection(message.topic, message.kind, typestore=ROS1_TYPES)
            decoded = _as_ros1(TYPES.deserialize_cdr(message.data, message.kind))
            said = ROS1_TYPES.serialize_ros1(decoded, message.kind)
            writer.write(connections[message.topic], message.received, bytes(said))
    return path


def _as_ros1(message: Any) -> Any:
    """The same message with ROS 1's header, which has a sequence number."""
    if hasattr(message, "header"):
        stamp = message.header.stamp
        time = ROS1_TYPES.types["builtin_interfaces/msg/Time"](stamp.sec, stamp.nanosec)
        message.header = ROS1_TYPES.types["std_msgs/msg/Header"](0, time, message.header.frame_id)
    return message


def _header(time: float, frame: str) -> Any:
    stamp = nanoseconds(time)
    return TYPES.types["std_msgs/msg/Header"](TYPES.types["builtin_interfaces/msg/Time"](*divmod(stamp, NS)), frame)


def _sent(topic: str, kind: str, received: float, message: Any) -> Sent:
    return Sent(topic, kind, nanoseconds(received), bytes(TYPES.serialize_cdr(message, kind)))
