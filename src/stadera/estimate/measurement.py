"""What one instant's sensors say, brought to the trunk's axes: the input of every online estimator and controller.

The IMU at r_imu (trunk frame) reads the specific force a_imu; at the trunk's origin it is, for a rigid trunk::

    a = a_imu - ω x (ω x r_imu) - α x r_imu

The angular acceleration α is not measured; it is left out where it is not given.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.recording.recording import Recording
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot

if TYPE_CHECKING:
    from stadera.sim.sensors import Sample

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Measurement:
    """One instant, finite and in trunk axes.

    Attributes:
        time: [s].
        joint_position, joint_velocity: (n,) [rad, rad/s], in the tree's order.
        effort: (n,) [N·m], what the actuators do to the joints.
        angular_velocity: (3,) [rad/s], trunk axes.
        specific_force: (3,) [m/s²], at the trunk's origin, trunk axes: at rest 9.81 upwards.
        rotation: (3, 3), of the trunk in the world, r_world = rotation @ r_trunk; None where there is no orientation.
        foot_position: (4, 3) [m], centres of the feet in the trunk frame, where something else than the encoders says
            them; None for forward kinematics.
        stance: (4,) bool, the legs that are meant to carry; None where nobody says.
        vertical_by_forces: there is no IMU: `specific_force` is gravity along what the feet's own forces say is up
            (`stadera.estimate.vertical`), true at rest alone, and `angular_velocity` is zero.
    """

    time: float
    joint_position: Array
    joint_velocity: Array
    effort: Array
    angular_velocity: Array
    specific_force: Array
    rotation: Array | None = None
    foot_position: Array | None = None
    stance: NDArray[np.bool_] | None = None
    vertical_by_forces: bool = False

    @property
    def up(self) -> Array:
        """Unit vector of the vertical in trunk axes, (3,): by the orientation, else along the specific force."""
        if self.rotation is not None:
            return np.asarray(self.rotation[2])
        return np.asarray(self.specific_force / np.linalg.norm(self.specific_force))

    @classmethod
    def from_sample(cls, sample: Sample, mount: ImuMount, stance: NDArray[np.bool_] | None = None) -> Measurement:
        """From one sample of the test-bed's sensors, which are in the IMU's axes.

        Raises:
            RecordingError: a value that is not finite.
        """
        q, qd, effort, orientation = sample.joint_position, sample.joint_velocity, sample.effort, sample.orientation
        gyro, accelerometer = sample.angular_velocity, sample.specific_force
        # products carry a value that is not finite on to the sum
        if not isfinite(q.dot(qd) + effort.dot(effort) + gyro.dot(accelerometer) + orientation.dot(orientation)):
            raise RecordingError(f"a sensor value is not finite at {sample.time:.6f} s")
        turn = mount.rotation
        omega = turn.dot(gyro)
        force = _at_origin(turn.dot(accelerometer), omega, mount.translation)
        rotation = rotation_matrix(orientation).dot(turn.T)
        return cls(sample.time, q, qd, effort, omega, force, rotation, sample.foot_position, stance)


def measurements_of(recording: Recording, robot: Robot, imu_frame: str | None = None) -> Iterator[Measurement]:
    """A log's samples, one after the other, as an online estimator would have got them.

    Args:
        imu_frame: in which the IMU's values are; None for the recording's own, else the model's.

    Raises:
        RecordingError: the log lacks a joint's velocity or effort, or the IMU.
        UnknownNameError: a joint of the robot is not recorded, or no such frame.
    """
    joints = robot.tree.joints
    if recording.imu is None:
        raise RecordingError(f"{recording.source}: no IMU; estimators need columns imu.angular_velocity.x, ...")
    q = recording.channel("position", joints)
    qd, effort = recording.channel("velocity", joints), recording.channel("effort", joints)
    imu, named = recording.imu, imu_frame or recording.imu.frame
    mount = ImuMount.of(robot, named)
    omega = imu.angular_velocity @ mount.rotation.T
    force = imu.linear_acceleration @ mount.rotation.T - np.cross(omega, np.cross(omega, mount.translation))
    stance = meant_stance(recording, robot)
    for k, time in enumerate(recording.time):
        yield Measurement(
            time=float(time),
            joint_position=q[k],
            joint_velocity=qd[k],
            effort=effort[k],
            angular_velocity=omega[k],
            specific_force=force[k],
            rotation=None if imu.orientation is None else rotation_matrix(imu.orientation[k]) @ mount.rotation.T,
            stance=None if stance is None else stance[k],
        )


def meant_stance(recording: Recording, robot: Robot) -> NDArray[np.bool_] | None:
    """(samples, 4), the legs that a log says are on the ground; None where it does not say so of all."""
    contacts = [recording.foot_contact.get(leg.foot) for leg in robot.legs]
    return None if any(c is None for c in contacts) else np.column_stack([c for c in contacts if c is not None])


def rotation_matrix(quaternion: Array) -> Array:
    """The rotation matrix of a quaternion xyzw, normalised here, (3, 3)."""
    x, y, z, w = quaternion.tolist()
    s = 2.0 / (x * x + y * y + z * z + w * w)
    return np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
        ]
    )


def _at_origin(force: Array, omega: Array, arm: Array) -> Array:
    """a - ω x (ω x r) = a - ω (ω·r) + r (ω·ω), written out for speed."""
    (ax, ay, az), (x, y, z), (rx, ry, rz) = force.tolist(), omega.tolist(), arm.tolist()
    along, square = x * rx + y * ry + z * rz, x * x + y * y + z * z
    return np.array([ax - along * x + square * rx, ay - along * y + square * ry, az - along * z + square * rz])
