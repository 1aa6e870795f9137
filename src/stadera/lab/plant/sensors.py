"""Sensors of the plant: estimators and controllers get the true values with errors, and nothing else; logs of runs."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, Literal

import mujoco
import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from stadera.constants import ROUNDING
from stadera.errors import RecordingError
from stadera.inertia import InertialParameters
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.world import TrueState
from stadera.logs import Imu, Recording
from stadera.robot.imu import ImuMount
from stadera.robot.kinematics import foot_positions
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement, rotation_matrix
from stadera.types import Array, Bools


@dataclass(frozen=True)
class Gaussian:
    """A Gaussian error of every component, drawn once a run or for every sample."""

    mean: float = 0.0  # in the unit of the perturbed quantity
    std: float = 0.0  # likewise
    drawn: Literal["run", "sample"] = "run"  # "run" for a constant error, "sample" for a white one

    @property
    def is_zero(self) -> bool:
        """True if it adds nothing."""
        return self.mean == 0.0 and self.std == 0.0


@dataclass(frozen=True)
class SensorErrors:
    """Sizes of the errors, one standard deviation unless stated otherwise. "Constant" ones are drawn once a run."""

    position: float = 0.0  # white [rad]
    velocity: float = 0.0  # white [rad/s]
    torque: float = 0.0  # white, as a share of the joint's effort limit
    torque_constant: float = 0.0  # constant, likewise
    torque_delay: float = 0.0  # [s], of the measured torques
    gyro: float = 0.0  # white [rad/s]
    gyro_constant: float = 0.0  # constant [rad/s]
    accelerometer: float = 0.0  # white [m/s²]
    accelerometer_constant: float = 0.0  # constant [m/s²]
    orientation_constant: float = 0.0  # of each component of a rotation vector, in the IMU frame [rad]
    imu_misalignment: float = 0.0  # exact angle of the IMU's misalignment, about a random axis [rad]
    torque_offset: Gaussian = Gaussian()  # of every joint's torque [N·m] (Table IV)
    foot_position: Gaussian = Gaussian()  # of every component of the feet's positions in the trunk frame [m] (Table IV)
    friction: float = 0.0  # Coulomb friction in the plant's joints, as a share of the effort limit (exact)
    friction_known: float = 0.0  # relative error of the friction in the estimator's model
    leg_mass: float = 0.0  # relative error of the leg links' masses in the estimator's model
    leg_com: float = 0.0  # error of each component of their centres of mass [m]

    def times(self, factor: float) -> SensorErrors:
        """All sizes multiplied by a factor, except for those of a Gaussian."""
        sizes: dict[str, Any] = {name: factor * size for name, size in vars(self).items() if isinstance(size, float)}
        return replace(self, **sizes)


IDEAL = SensorErrors()
"""No errors at all."""

STANDARD = SensorErrors(
    position=2e-4,
    velocity=0.02,
    torque=0.0033,
    torque_constant=0.0033,
    gyro=0.003,
    gyro_constant=0.002,
    accelerometer=0.05,
    accelerometer_constant=0.03,
    orientation_constant=np.deg2rad(0.2),
)
"""Encoders, torque sensors and an IMU of good robots."""

HARSH = replace(
    STANDARD.times(2.0),
    torque_delay=0.003,
    imu_misalignment=np.deg2rad(0.5),
    friction=0.006,
    friction_known=0.2,
    leg_mass=0.05,
    leg_com=0.005,
)
"""Twice `STANDARD`, with late torques, joint friction, a misaligned IMU and a wrong model of the legs."""

ERROR_SETS = {"ideal": IDEAL, "standard": STANDARD, "harsh": HARSH}


_XYZW = np.array([1, 2, 3, 0])


@dataclass(frozen=True, eq=False)
class SensorReading:
    """Sensor values at one instant."""

    # time, joint_position, joint_velocity, effort: as in `Measurement`
    time: float
    joint_position: Array
    joint_velocity: Array
    effort: Array
    angular_velocity: Array  # (3,) [rad/s], IMU frame
    specific_force: Array  # (3,) [m/s²], IMU frame
    orientation: Array  # (4,) quaternion xyzw of the IMU frame in the world
    # (4, 3) [m], centres of the feet in the trunk frame from the robot's own kinematics, if these have a separate error
    # (Table IV); None if they follow from forward kinematics of `joint_position`
    foot_position: Array | None = None


class Sensors:
    """Reads a plant with errors; constant ones are drawn on construction. The same seed gives the same errors."""

    def __init__(self, errors: SensorErrors, seed: int, robot: Robot) -> None:
        self.errors, self.robot = errors, robot
        constant, self._white = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
        n = self._joint_count = len(robot.tree.joints)
        torque, torque_white = _torque_errors(errors, robot, constant)
        gyro = constant.normal(0.0, errors.gyro_constant, 3)
        accelerometer = constant.normal(0.0, errors.accelerometer_constant, 3)
        # of position, velocity, effort, gyro and accelerometer, in this order
        self._offset = np.concatenate([np.zeros(2 * n), torque, gyro, accelerometer])
        white = [errors.position, errors.velocity, *torque_white, errors.gyro, errors.accelerometer]
        self._scale = np.repeat(white, [n, n, *[1] * n, 3, 3])
        # The IMU is misaligned, r_nominal = mounting r_imu, and its orientation has a separate error.
        axis = constant.standard_normal(3)
        self._mounting = Rotation.from_rotvec(errors.imu_misalignment * axis / np.linalg.norm(axis))
        turn = Rotation.from_rotvec(constant.normal(0.0, errors.orientation_constant, 3))
        self._from_nominal = block_diag(self._mounting.as_matrix().T, self._mounting.as_matrix().T)
        self._turn = (self._mounting * turn).as_quat(scalar_first=True)
        error = errors.foot_position
        constant_error = constant.normal(error.mean, error.std, (len(robot.legs), 3))
        self._foot_offset = constant_error if error.drawn == "run" else np.zeros_like(constant_error)
        # number of samples drawn at once, many if nothing else is drawn in between
        self._block = 1 if errors.foot_position.drawn == "sample" else 64
        self._noise: Iterator[Array] = iter(())
        self._late: deque[tuple[float, Array]] = deque()

    def read(self, plant: Plant) -> SensorReading:
        """Reads a sample at the plant's present instant; to be called every step, for delayed torques are kept here."""
        n, time = self._joint_count, plant.time
        values = next(self._noise, None)
        if values is None:
            drawn = self._white.standard_normal((self._block, 3 * n + 6))
            self._noise = iter(drawn * self._scale + self._offset)
            values = next(self._noise)
        values[:n] += plant.joint_position
        values[n : 2 * n] += plant.joint_velocity
        values[2 * n : 3 * n] += self._arriving(time, plant.effort)
        values[3 * n :] += self._from_nominal.dot(plant.imu_motion)
        orientation = np.empty(4)
        mujoco.mju_mulQuat(orientation, plant.imu_quaternion_wxyz, self._turn)
        return SensorReading(
            time=time,
            joint_position=values[:n],
            joint_velocity=values[n : 2 * n],
            effort=values[2 * n : 3 * n],
            angular_velocity=values[3 * n : 3 * n + 3],
            specific_force=values[3 * n + 3 :],
            orientation=orientation[_XYZW],
            foot_position=self._feet(values[:n]),
        )

    def _arriving(self, time: float, effort: Array) -> Array:
        """Torques that arrive now: those of `torque_delay` ago, or the first ones."""
        late = self._late
        if late and time < late[-1][0]:  # the plant was reset
            late.clear()
        late.append((time, effort))
        due = time - self.errors.torque_delay + ROUNDING
        while len(late) > 1 and late[1][0] <= due:
            late.popleft()
        return late[0][1]

    def _feet(self, joint_position: Array) -> Array | None:
        error = self.errors.foot_position
        if error.is_zero:
            return None
        feet = foot_positions(self.robot, joint_position[None])[0] + self._foot_offset
        noise = self._white.normal(error.mean, error.std, feet.shape) if error.drawn == "sample" else 0.0
        return np.asarray(feet + noise)


def _torque_errors(errors: SensorErrors, robot: Robot, rng: np.random.Generator) -> tuple[Array, Array]:
    """Constant errors of joint torques, drawn for a run, and standard deviations of the white part, (n,) each [N·m]."""
    n, offset = len(robot.tree.joints), errors.torque_offset
    limit = robot.effort_limits if errors.torque or errors.torque_constant else np.zeros(n)
    constant = errors.torque_constant * limit * rng.standard_normal(n)
    if offset.drawn == "run":
        return constant + rng.normal(offset.mean, offset.std, n), errors.torque * limit
    return constant + offset.mean, np.hypot(errors.torque * limit, offset.std)


def measured(recording: Recording, robot: Robot, errors: SensorErrors, seed: int) -> Recording:
    """Adds joint sensors' errors to a recording of true joint motion and effort.

    White noise on position, velocity and effort, the constants of a run on the effort, and delayed torques (by whole
    samples, the first one repeated). Accelerations are dropped, since they are not measured. IMU and feet are
    unchanged.
    """
    constant, white = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    torque, torque_white = _torque_errors(errors, robot, constant)
    effort = np.zeros((len(recording), len(robot.tree.joints)))
    robot.tree.restricted(recording.joints)  # raises for an unknown one
    columns = [robot.tree.joints.index(joint) for joint in recording.joints]
    true_effort = recording.channel("effort", recording.joints)
    delayed = np.searchsorted(recording.time, recording.time - errors.torque_delay + ROUNDING, side="right") - 1
    effort[:, columns] = true_effort[np.maximum(delayed, 0)]
    shape = recording.position.shape
    return replace(
        recording,
        position=recording.position + errors.position * white.standard_normal(shape),
        velocity=recording.channel("velocity", recording.joints) + errors.velocity * white.standard_normal(shape),
        acceleration=None,
        effort=(effort + torque + torque_white * white.standard_normal(effort.shape))[:, columns],
        notes=(*recording.notes, f"sensor errors of seed {seed} were added"),
    )


def plant_model(robot: Robot, errors: SensorErrors) -> Robot:
    """The robot of the plant: the given one, with the errors' dry friction in its joints."""
    if not errors.friction:
        return robot
    friction = dict(zip(robot.tree.joints, errors.friction * robot.effort_limits, strict=True))
    dynamics = {
        joint: replace(given, coulomb=given.coulomb + friction[joint]) for joint, given in robot.dynamics.items()
    }
    return replace(robot, dynamics=dynamics)


def estimator_model(robot: Robot, errors: SensorErrors, seed: int) -> Robot:
    """The estimator's model: the plant's robot, from `plant_model`, with wrong legs and approximate friction.

    A leg link's ten parameters are scaled by 1 + N(0, leg_mass²), and its mass distribution is displaced by N(0,
    leg_com²) in each component. Each joint's Coulomb friction is scaled by 1 + N(0, friction_known²). The trunk is the
    plant's.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[2])
    inertias = dict(robot.inertias)
    for link in robot.tree.links[1:]:
        scale, shift = 1.0 + errors.leg_mass * rng.standard_normal(), errors.leg_com * rng.standard_normal(3)
        inertias[link] = InertialParameters(scale * inertias[link].vector).shifted(shift)
    dynamics = {
        joint: replace(given, coulomb=given.coulomb * (1.0 + errors.friction_known * rng.standard_normal()))
        for joint, given in robot.dynamics.items()
    }
    return replace(robot, inertias=inertias, dynamics=dynamics)


def recording_of(samples: Sequence[SensorReading], robot: Robot, source: str = "simulation") -> Recording:
    """The sensors' values as a log of the robot: joints and IMU, without feet and truth."""
    return Recording(
        time=_stacked(samples, "time"),
        joints=robot.tree.joints,
        position=_stacked(samples, "joint_position"),
        velocity=_stacked(samples, "joint_velocity"),
        effort=_stacked(samples, "effort"),
        imu=Imu(
            angular_velocity=_stacked(samples, "angular_velocity"),
            linear_acceleration=_stacked(samples, "specific_force"),
            orientation=_stacked(samples, "orientation"),
            frame=ImuMount.of(robot).name,
        ),
        source=source,
    )


def truth_of(states: Sequence[TrueState], robot: Robot) -> Recording:
    """The truth: joint motion with accelerations, efforts, and the forces of the ground on the feet in world axes."""
    forces, contacts = _stacked(states, "foot_force"), np.array([s.foot_contact for s in states])
    feet = [leg.foot for leg in robot.legs]
    return Recording(
        time=_stacked(states, "time"),
        joints=robot.tree.joints,
        position=_stacked(states, "joint_position"),
        velocity=_stacked(states, "joint_velocity"),
        acceleration=_stacked(states, "joint_acceleration"),
        effort=_stacked(states, "effort"),
        foot_force={foot: np.ascontiguousarray(forces[:, k]) for k, foot in enumerate(feet)},
        foot_contact={foot: np.ascontiguousarray(contacts[:, k]) for k, foot in enumerate(feet)},
        source="simulation's truth",
    )


def _stacked(instants: Sequence[SensorReading] | Sequence[TrueState], name: str) -> Array:
    return np.array([getattr(instant, name) for instant in instants], dtype=float)


def measurement_of(sample: SensorReading, mount: ImuMount, stance: Bools | None = None) -> Measurement:
    """Converts one sample of the test-bed's sensors, which are in the IMU's axes. Raises RecordingError: a value that
    is not finite.
    """
    q, qd, effort, orientation = sample.joint_position, sample.joint_velocity, sample.effort, sample.orientation
    gyro, accelerometer = sample.angular_velocity, sample.specific_force
    # a value that is not finite makes the sum of products not finite
    if not isfinite(q.dot(qd) + effort.dot(effort) + gyro.dot(accelerometer) + orientation.dot(orientation)):
        raise RecordingError(f"a sensor value is not finite at {sample.time:.6f} s")
    omega, force = mount.in_trunk_axes(gyro), mount.in_trunk_axes(accelerometer)
    rotation, lever = mount.trunk_rotation(rotation_matrix(orientation)), mount.translation
    return Measurement(sample.time, q, qd, effort, omega, force, rotation, sample.foot_position, stance, lever=lever)
