"""One sample of all sensors, in trunk axes: input of all online estimators and controllers.

The IMU's values refer to the IMU's position. With a known angular acceleration α, move the specific force to the
trunk's origin with `stadera.robot.imu.force_at_origin`; without it, use `Measurement.force_at_origin`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import RecordingError
from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount, force_at_origin
from stadera.robot.model import Robot
from stadera.types import Array, Bools

_SPOKEN = {
    "time": "time",
    "joint_position": "joint position",
    "joint_velocity": "joint velocity",
    "effort": "effort",
    "angular_velocity": "angular velocity",
    "specific_force": "specific force",
    "rotation": "orientation",
    "foot_position": "foot position",
    "extra": "other joints",
}
"""Channels of a measurement, as they are named to people."""

_OF_JOINTS = ("joint_position", "joint_velocity", "effort")  # with one value for each joint of the legs


@dataclass(frozen=True, eq=False)
class Measurement:
    """Sensor values at one instant, finite and in trunk axes.

    Attributes:
        time: [s].
        joint_position, joint_velocity: (n,) [rad, rad/s], in the tree's order.
        effort: (n,) [N·m], what the actuators do to the joints.
        angular_velocity: (3,) [rad/s], trunk axes.
        specific_force: (3,) [m/s²], at the IMU, trunk axes; at rest 9.81 upwards.
        rotation: (3, 3), of the trunk in the world, r_world = rotation @ r_trunk; None without an orientation.
        foot_position: (legs, 3) [m], centres of the feet in the trunk frame, if known from other sources than the
            encoders; None for forward kinematics.
        stance: (legs,) bool, those that are meant to be in stance; None if unknown.
        vertical_by_forces: True if there is no IMU. Then `specific_force` is gravity along the vertical estimated from
            the feet's forces (`stadera.trunk.standing.forces`), valid at rest only, and `angular_velocity` is zero.
        lever: (3,) [m], position of the IMU in the trunk frame.
        extra: (3 k,), positions, velocities and efforts of the robot's k joints outside the legs; empty if they rest
            at the robot's reference.
    """

    time: float
    joint_position: Array
    joint_velocity: Array
    effort: Array
    angular_velocity: Array
    specific_force: Array
    rotation: Array | None = None
    foot_position: Array | None = None
    stance: Bools | None = None
    vertical_by_forces: bool = False
    lever: Array = field(default_factory=lambda: np.zeros(3))
    extra: Array = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def force_at_origin(self) -> Array:
        """Specific force at the trunk's origin without the α x lever term, (3,) [m/s²]: centripetal acceleration
        removed.
        """
        return force_at_origin(self.specific_force, self.angular_velocity, self.lever)

    @property
    def up(self) -> Array:
        """Unit vector of the vertical in trunk axes, (3,): from the orientation if known, else along the specific
        force.
        """
        if self.rotation is not None:
            return np.asarray(self.rotation[2])
        return np.asarray(self.force_at_origin / np.linalg.norm(self.force_at_origin))


def measurements_of(
    recording: Recording, robot: Robot, imu_frame: str | None = None, vertical: Array | None = None
) -> Iterator[Measurement]:
    """Yields a log's samples one by one, as an online estimator would receive them.

    Args:
        imu_frame: frame of the IMU's values; None for the recording's own, else the model's.
        vertical: (samples, 3), unit vectors in trunk axes by the feet's forces, which stand in for the IMU.

    Raises:
        RecordingError: the log lacks a joint's velocity or effort, or the IMU.
        UnknownNameError: a joint of the robot is not recorded, or no such frame.
    """
    imu, n, lever, rotations = recording.imu, len(recording), np.zeros(3), None
    kinds = ("position", "velocity", "effort")
    q, qd, effort = (np.ascontiguousarray(recording.channel(kind, robot.tree.joints)) for kind in kinds)
    if vertical is not None:
        omega, force = np.zeros((n, 3)), GRAVITY * vertical
    elif imu is None:
        raise RecordingError(f"{recording.source}: no IMU; estimators need columns imu.angular_velocity.x, ...")
    else:
        mount = ImuMount.of(robot, imu_frame or imu.frame)
        omega, force = mount.in_trunk_axes(imu.angular_velocity), mount.in_trunk_axes(imu.linear_acceleration)
        lever = mount.translation
        if imu.orientation is not None:
            rotations = (mount.trunk_rotation(rotation_matrix(each)) for each in imu.orientation)
    stance, extra = meant_stance(recording, robot), extra_states(recording, robot)
    for k, time in enumerate(recording.time.tolist()):
        yield Measurement(
            time=time,
            joint_position=q[k],
            joint_velocity=qd[k],
            effort=effort[k],
            angular_velocity=omega[k],
            specific_force=force[k],
            rotation=None if rotations is None else next(rotations),
            stance=None if stance is None else stance[k],
            vertical_by_forces=vertical is not None,
            lever=lever,
            extra=extra[k],
        )


def not_finite(m: Measurement, joints: tuple[str, ...]) -> str:
    """Describes the values of a measurement that are not finite; empty if all are finite."""
    values = {name: getattr(m, name) for name in _SPOKEN if getattr(m, name) is not None}
    if isfinite(sum(float(np.sum(value)) for value in values.values())):
        return ""
    for name, value in values.items():
        finite = np.isfinite(value)
        if not finite.all():
            joint = f" of joint {joints[int(np.argmin(finite))]!r}" if name in _OF_JOINTS else ""
            return f"not finite: {_SPOKEN[name]}{joint}"
    return ""  # too large to be summed up


def extra_states(recording: Recording, robot: Robot) -> Array:
    """Positions, velocities and efforts of the joints outside the legs, (samples, 3 k), or (samples, 0)."""
    if robot.extra is None:
        return np.zeros((len(recording), 0))
    return robot.extra.states(recording.others, len(recording))


def meant_stance(recording: Recording, robot: Robot) -> Bools | None:
    """Legs that a log marks as in stance, (samples, legs); None unless it does so for all legs."""
    contacts = [recording.foot_contact.get(leg.foot) for leg in robot.legs]
    return None if any(c is None for c in contacts) else np.column_stack([c for c in contacts if c is not None])


def rotation_matrix(quaternion: Array) -> Array:
    """Rotation matrix of a quaternion xyzw, which is normalised here, (3, 3)."""
    x, y, z, w = quaternion.tolist()
    s = 2.0 / (x * x + y * y + z * z + w * w)
    return np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
        ]
    )
