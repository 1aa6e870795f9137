"""Log of a drawn robot's sensors: the true motion at 1 kHz, with all drawn errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, lfilter, lfilter_zi
from scipy.spatial.transform import Rotation

from stadera.body.torques import JointMotion, JointTorqueRegressor
from stadera.constants import GRAVITY
from stadera.lab.plant.sensors import STANDARD
from stadera.lab.plant.world import TrueState
from stadera.lab.reality.draw import DrawnRobot
from stadera.logs import Imu, Recording
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.types import Array

_MOTION = ("position", "velocity", "acceleration")


@dataclass(frozen=True)
class SpikeSizes:
    """Sizes of single outliers that are plausible in a log: limit of a uniform draw, for torques times the limit."""

    position: float = 1.0  # rad
    velocity: float = 20.0  # rad/s
    effort: float = 1.0
    angular_velocity: float = 5.0  # rad/s
    specific_force: float = 50.0  # m/s²


@dataclass(frozen=True, eq=False)
class TrueMotion:
    """True motion at every millisecond of a run, for n joints."""

    joints: tuple[str, ...]
    time: Array  # (samples,) [s]
    position: Array  # (samples, n) [rad]
    velocity: Array  # (samples, n) [rad/s]
    effort: Array  # (samples, n) [N·m], of the motors
    carried: Array  # (samples, n) [N·m], by the gears
    orientation: Array  # (samples, 4) quaternion xyzw of the trunk in the world
    angular_velocity: Array  # (samples, 3) [rad/s], trunk axes
    angular_acceleration: Array  # (samples, 3) [rad/s²], trunk axes
    linear_acceleration: Array  # (samples, 3) [m/s²], of the trunk's origin, world axes

    @classmethod
    def of(cls, states: Sequence[TrueState], robot: Robot) -> TrueMotion:
        """The motion of a robot on the ground."""
        joints = ("joint_position", "joint_velocity", "effort", "carried")
        trunk = ("orientation", "angular_velocity", "angular_acceleration", "linear_acceleration")
        values = [np.array([getattr(state, name) for state in states]) for name in joints + trunk]
        return cls(robot.tree.joints, np.array([state.time for state in states]), *values)

    @classmethod
    def held(cls, recording: Recording, robot: Robot) -> TrueMotion:
        """The motion of the true robot's legs on a trunk that is held level and still, from an exact recording. Gears
        carry what the links' inverse dynamics ask for.
        """
        velocity, effort = (recording.channel(name, recording.joints) for name in ("velocity", "effort"))
        links = {f"{link}.{name}": v for link, body in robot.inertias.items() for name, v in body.to_dict().items()}
        carried = np.empty_like(effort)
        for leg in (leg for leg in robot.legs if leg.joints[0] in recording.joints):
            at, tree = [recording.index(joint) for joint in leg.joints], robot.leg_tree(leg.name)
            moving = JointMotion(*(recording.channel(name, leg.joints) for name in _MOTION))
            carried[:, at] = JointTorqueRegressor(tree).predict(moving, links)
        level, still = np.tile([0.0, 0.0, 0.0, 1.0], (len(recording), 1)), np.zeros((len(recording), 3))
        position = recording.position
        return cls(recording.joints, recording.time, position, velocity, effort, carried, level, still, still, still)


def measured_log(
    motion: TrueMotion, robot: Robot, draw: DrawnRobot, seed: int, rate: float | None = None, source: str = ""
) -> Recording:
    """Makes the log of a true motion, known at every millisecond.

    Torques are delayed, then scaled and offset; the IMU is misaligned and displaced; positions get their zero errors.
    Motor and rotor turn before an elastic gear of compliance c, and so do friction and the encoder: of the motor's
    torque τ the gear carries what is left for the link, τ - friction - I_rotor q̈, and gives way by c times that. The
    encoder reads q + c (τ - friction - I_rotor q̈), so a joint that turns round does not make it jump, though τ does.
    The motion itself is that of stiff gears.
    All channels are sampled at `rate` (1000 Hz over an integer; None for the drawn one), get white noise, and are
    quantised if the draw includes this; then what varies over the log is applied, single outliers are added, and
    samples removed. `robot` is the model file's.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(4)[3])
    time, columns = motion.time, [robot.tree.joints.index(joint) for joint in motion.joints]
    period = (time[-1] - time[0]) / (len(time) - 1)
    kept = slice(None, None, round(1.0 / (rate or draw.rate) / period))
    noise, limit = STANDARD.times(draw.noise), robot.effort_limits[columns]
    gears = motion.carried * draw.compliance[columns]
    encoder = motion.position + draw.encoder_zero[columns] + gears
    shape = encoder[kept].shape
    position = encoder[kept] + noise.position * rng.standard_normal(shape)
    moving = motion.velocity + np.gradient(gears, period, axis=0)
    velocity = moving[kept] + noise.velocity * rng.standard_normal(shape)
    if draw.quantum is not None:
        position, velocity = _encoded(encoder, draw, period, noise.position, rng, kept)
    effort = _late(motion.effort, time, draw.delay)[kept] * draw.torque_gain[columns]
    effort += draw.torque_offset[columns] + noise.torque * limit * rng.standard_normal(shape)
    imu = _imu(motion, robot, draw, kept)
    gyro = imu.angular_velocity + draw.gyro_offset + noise.gyro * rng.standard_normal((shape[0], 3))
    force = imu.linear_acceleration + draw.accelerometer_offset
    force = force + noise.accelerometer * rng.standard_normal((shape[0], 3))
    stamps = time[kept]
    if draw.varying is not None:
        effort += offset_drift(stamps, draw.varying.drift, draw.varying.warming)[:, columns]
        for group, channels in {"joints": (position, velocity, effort), "imu": (gyro, force)}.items():
            held = np.arange(len(stamps)) // draw.varying.held.get(group, 1) * draw.varying.held.get(group, 1)
            for values in channels:
                values[:] = values[held]
        # delays of its own generator, so that all other draws stay; what arrives late does not overtake
        late = np.random.default_rng(np.random.SeedSequence(seed).spawn(6)[5])
        stamps = np.sort(stamps + late.uniform(0.0, draw.varying.jitter, len(stamps)))
    _spoil((position, velocity, effort, gyro, force), limit, rng.poisson(draw.spikes * (time[-1] - time[0])), rng)
    there = np.asarray(rng.uniform(size=shape[0]) >= draw.lost)
    there[:1] = True
    orientation = imu.orientation
    return Recording(
        time=stamps[there],
        joints=motion.joints,
        position=position[there],
        velocity=velocity[there],
        effort=effort[there],
        imu=Imu(gyro[there], force[there], None if orientation is None else orientation[there], imu.frame),
        source=source,
    )


def _spoil(channels: Sequence[Array], limit: Array, count: int, rng: np.random.Generator) -> None:
    sizes = SpikeSizes()
    most = (sizes.position, sizes.velocity, sizes.effort * limit, sizes.angular_velocity, sizes.specific_force)
    for _ in range(count):
        which = int(rng.integers(len(channels)))
        values = channels[which]
        row, column = rng.integers(len(values)), rng.integers(values.shape[1])
        values[row, column] += np.broadcast_to(most[which], values.shape[1])[column] * rng.uniform(-1.0, 1.0)


def _late(effort: Array, time: Array, delay: float) -> Array:
    """Torques delayed by `delay`, interpolated linearly between the milliseconds; constant before the first one."""
    at = np.clip((time - delay - time[0]) / (time[1] - time[0]), 0.0, len(time) - 1.0)
    before = np.minimum(at.astype(int), len(time) - 2)
    share = (at - before)[:, None]
    return np.asarray((1.0 - share) * effort[before] + share * effort[before + 1])


def _encoded(
    position: Array, draw: DrawnRobot, period: float, noise: float, rng: np.random.Generator, kept: slice
) -> tuple[Array, Array]:
    """Quantised positions, and velocities computed by a drive from their differences over a few milliseconds."""
    quantum = draw.quantum or 1.0
    steps = max(1, round(draw.differenced / period))
    encoded = quantum * np.round((position + noise * rng.standard_normal(position.shape)) / quantum)
    before = np.concatenate([np.repeat(encoded[:1], steps, axis=0), encoded[:-steps]])
    return encoded[kept], ((encoded - before) / (steps * period))[kept]


def offset_drift(time: Array, drift: Array, warming: float) -> Array:
    """Drift of the torque offsets (samples, n) [N·m] since the beginning, up to `drift` (n,): drives that warm up with
    `warming` time constants in a log.
    """
    passed = (time - time[0]) / (time[-1] - time[0])
    grown = np.expm1(-warming * passed) / np.expm1(-warming)
    return np.asarray(grown[:, None] * drift)


def _imu(motion: TrueMotion, robot: Robot, draw: DrawnRobot, kept: slice) -> Imu:
    """Values of an IMU off its nominal pose at the kept samples, without noise; its accelerometer may be low-passed.

    The point r of the trunk, in trunk axes, has the specific force Rᵀ (a - g) + α x r + ω x (ω x r).
    """
    mount = ImuMount.of(robot)
    to_trunk = Rotation.from_matrix(mount.rotation) * Rotation.from_rotvec(draw.imu_rotation)
    place = mount.translation + mount.rotation @ draw.imu_place
    trunk, omega = Rotation.from_quat(motion.orientation), motion.angular_velocity
    force = trunk.inv().apply(motion.linear_acceleration - np.array([0.0, 0.0, -GRAVITY]))
    force += np.cross(motion.angular_acceleration, place) + np.cross(omega, np.cross(omega, place))
    orientation = trunk * to_trunk * Rotation.from_rotvec(draw.orientation_offset)
    inverse = to_trunk.inv()
    gyro, force = inverse.apply(omega), inverse.apply(force)
    if draw.varying is not None:
        rate = (len(motion.time) - 1) / (motion.time[-1] - motion.time[0])
        b, a = butter(2, draw.varying.lowpass, fs=rate)
        force, _ = lfilter(b, a, force, axis=0, zi=lfilter_zi(b, a)[:, None] * force[:1])
    return Imu(gyro[kept], force[kept], orientation.as_quat()[kept], mount.name)
