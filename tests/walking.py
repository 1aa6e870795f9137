"""A robot that walks, worked out by Pinocchio from the raw model file: nothing of the package's own dynamics.

The trunk sways smoothly while feet step on a plane, one at a time; Pinocchio's inverse dynamics of the floating base
say what ground and actuators must do. Only foot placement by joint angles is the package's (its kinematics).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from stadera.inertia import InertialParameters
from stadera.lab.plant.sensors import SensorErrors
from stadera.logs import Imu, Recording
from stadera.robot import Robot
from stadera.robot.imu import ImuMount
from stadera.robot.kinematics import foot_positions
from stadera.robot.stance import standing_configuration
from standing import foot_jacobians

GRAVITY = 9.81
PHASES = np.array([0.0, 0.5, 0.25, 0.75])  # of LF, RF, LH, RH: at most one foot in the air


@dataclass(frozen=True)
class Walk:
    """How it walks.

    Attributes:
        seconds, rate_hz: of the run.
        speed: [m/s]. period: of a step of each leg [s], 0 for feet that stay.
        tilt, sway: sizes of the trunk's motion about and along each axis [rad, m].
        frequency: [Hz], of its slowest part.
        slope: of the ground, about y [rad].
        load: ten parameters put on the trunk at `loaded_at` [s].
        seed: of the sway's phases.
    """

    seconds: float = 3.0
    rate_hz: float = 1000.0
    speed: float = 0.2
    period: float = 0.8
    tilt: float = 0.05
    sway: float = 0.012
    frequency: float = 0.9
    slope: float = 0.0
    load: InertialParameters = field(default_factory=InertialParameters.zero)
    loaded_at: float = np.inf
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Motion:
    """All that is true over the run, (samples, ...); trunk axes unless it says otherwise."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    effort: np.ndarray
    angular_velocity: np.ndarray
    angular_acceleration: np.ndarray
    specific_force: np.ndarray
    rotation: np.ndarray
    force: np.ndarray  # (samples, 4, 3), on the feet
    contact: np.ndarray  # (samples, 4, 3) [m]
    normal: np.ndarray  # (samples, 3)


Arm = Callable[[np.ndarray], np.ndarray]
"""Positions of the joints outside the legs, (samples, k), at some times."""


def walked(robot: Robot, walk: Walk, pad: int = 8, arm: Arm | None = None) -> Motion:
    """The motion, exact to the accuracy of quintic splines."""
    dt = 1.0 / walk.rate_hz
    n = round(walk.seconds / dt)
    time = dt * np.arange(-pad, n + pad)
    base, R = _base(walk, time)
    feet = _footholds(robot, walk, time)
    q = _placed(robot, np.einsum("nji,nlj->nli", R, feet - base[:, None]))
    qs, bs, Rs = (make_interp_spline(time, x.reshape(len(time), -1), k=5) for x in (q, base, R))
    turn = np.einsum("nji,njk->nik", R, Rs(time, 1).reshape(-1, 3, 3))
    omega = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=-1)
    alpha = make_interp_spline(time, omega, k=5)(time, 1)
    down = GRAVITY * np.array([np.sin(walk.slope), 0.0, -np.cos(walk.slope)])
    accel = np.einsum("nji,nj->ni", R, bs(time, 2) - down)
    inside = slice(pad, pad + n)
    kept = [x[inside] for x in (time, q, qs(time, 1), qs(time, 2), omega, alpha, accel, R)]
    effort, force, contact = _inverse_dynamics(robot, walk, *kept, arm=_arm_states(arm, time, inside))
    return Motion(*kept[:4], effort, *kept[4:], force, contact, kept[7][:, 2])


def recorded(
    robot: Robot, motion: Motion, errors: SensorErrors, seed: int = 0, mount: ImuMount | None = None
) -> Recording:
    """What sensors with white and constant errors would have said of it; the IMU of the model, or another one."""
    rng = np.random.default_rng(seed)
    n = len(motion.time)
    limit = robot.effort_limits
    frame = None if mount is None else mount.name
    mount = mount or ImuMount.of(robot)
    omega, r = motion.angular_velocity, mount.translation
    at_imu = motion.specific_force + np.cross(motion.angular_acceleration, r) + np.cross(omega, np.cross(omega, r))

    def white(size: float, shape: tuple[int, ...]) -> np.ndarray:
        return size * rng.standard_normal(shape)

    constant = errors.torque_constant * limit * rng.standard_normal(12)
    return Recording(
        time=motion.time,
        joints=robot.tree.joints,
        position=motion.position + white(errors.position, (n, 12)),
        velocity=motion.velocity + white(errors.velocity, (n, 12)),
        effort=motion.effort + constant + limit * white(errors.torque, (n, 12)),
        imu=Imu(
            (omega + white(errors.gyro_constant, (3,)) + white(errors.gyro, (n, 3))) @ mount.rotation,
            (at_imu + white(errors.accelerometer_constant, (3,)) + white(errors.accelerometer, (n, 3)))
            @ mount.rotation,
            frame=frame,
        ),
    )


def _arm_states(arm: Arm | None, time: np.ndarray, inside: slice) -> np.ndarray | None:
    """Positions, velocities and accelerations of the joints outside the legs, (3, samples, k)."""
    if arm is None:
        return None
    spline = make_interp_spline(time, arm(time), k=5)
    return np.array([spline(time, order)[inside] for order in range(3)])


def _base(walk: Walk, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(walk.seed)
    phases = rng.uniform(0.0, 2.0 * np.pi, (2, 6, 1))
    rates = walk.frequency * (1.0 + 0.3 * rng.uniform(size=(6, 1)))
    slow, fast = (np.sin(2.0 * np.pi * k * rates * time + phase) for k, phase in zip((1.0, 2.3), phases, strict=True))
    waves = (slow + 0.4 * fast).T
    base = walk.sway * waves[:, :3]
    base[:, 0] += walk.speed * time
    return base, Rotation.from_rotvec(walk.tilt * waves[:, 3:]).as_matrix()


def _footholds(robot: Robot, walk: Walk, time: np.ndarray) -> np.ndarray:
    """Centres of the feet in the ground's frame, (samples, 4, 3); the trunk's origin starts at (0, 0, 0) there."""
    under = foot_positions(robot, standing_configuration(robot)[None])[0]
    feet = np.empty((len(time), 4, 3))
    for leg in range(4):
        feet[:, leg] = under[leg]
        if not walk.period:
            continue
        cycle, phase = np.divmod(time / walk.period + PHASES[leg], 1.0)
        x = np.clip(phase / 0.22, 0.0, 1.0)
        s = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        stride = walk.speed * walk.period
        feet[:, leg, 0] += (cycle - PHASES[leg] + s - 0.5 + 0.11) * stride
        feet[:, leg, 2] += 0.06 * 64.0 * x**3 * (1.0 - x) ** 3
    return feet


def _load_shares(walk: Walk, time: np.ndarray) -> np.ndarray:
    """How readily each foot carries, (samples, 4): zero in the air."""
    if not walk.period:
        return np.ones((len(time), 4))
    phase = np.mod(time[:, None] / walk.period + PHASES, 1.0)
    on_ground = np.clip((phase - 0.22) / 0.78, 0.0, 1.0)
    return np.clip(20.0 * on_ground * (1.0 - on_ground), 0.0, 1.0)


def _placed(robot: Robot, feet: np.ndarray) -> np.ndarray:
    """Joint angles (samples, 12) with the feet's centres there, (samples, 4, 3) in the trunk frame."""
    q = np.tile(standing_configuration(robot), (len(feet), 1))
    columns = np.array([[robot.tree.joints.index(j) for j in leg.joints] for leg in robot.legs])
    for _ in range(12):
        step = np.linalg.solve(foot_jacobians(robot, q), (feet - foot_positions(robot, q))[..., None])[..., 0]
        q[:, columns] += np.clip(step, -0.3, 0.3)
        if np.abs(step).max() < 1e-12:
            break
    assert np.abs(feet - foot_positions(robot, q)).max() < 1e-10
    return q


def _inverse_dynamics(
    robot: Robot,
    walk: Walk,
    time: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    omega: np.ndarray,
    alpha: np.ndarray,
    specific: np.ndarray,
    R: np.ndarray,
    arm: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Efforts (samples, 12), foot forces and contact points (samples, 4, 3), trunk axes."""
    bare = pin.buildModelFromUrdf(str(robot.source), pin.JointModelFreeFlyer())
    bare.gravity = pin.Motion.Zero()
    loaded = bare.copy()
    if walk.load.mass:
        loaded.inertias[1] += walk.load.to_pinocchio()
    in_q = [bare.joints[bare.getJointId(name)].idx_q for name in robot.tree.joints]
    in_v = [bare.joints[bare.getJointId(name)].idx_v for name in robot.tree.joints]
    frames = [bare.getFrameId(leg.foot) for leg in robot.legs]
    shares = _load_shares(walk, time)
    armature, viscous, coulomb = (
        np.array([getattr(robot.dynamics[j], kind) for j in robot.tree.joints])
        for kind in ("armature", "viscous", "coulomb")
    )
    effort, force, contact = np.empty_like(q), np.empty((len(q), 4, 3)), np.empty((len(q), 4, 3))
    data = {id(bare): bare.createData(), id(loaded): loaded.createData()}
    full, velocity, acceleration = pin.neutral(bare), np.zeros(bare.nv), np.zeros(bare.nv)
    others = [bare.joints[bare.getJointId(name)] for name in (robot.extra.joints if robot.extra else ())]
    for k in range(len(q)):
        model = loaded if time[k] >= walk.loaded_at else bare
        work = data[id(model)]
        full[in_q], velocity[in_v], acceleration[in_v] = q[k], qd[k], qdd[k]
        velocity[3:6], acceleration[:3], acceleration[3:6] = omega[k], specific[k], alpha[k]
        for j, joint in enumerate(others if arm is not None else ()):
            full[joint.idx_q], velocity[joint.idx_v], acceleration[joint.idx_v] = arm[:, k, j]
        torque = pin.rnea(model, work, full, velocity, acceleration)
        pin.computeJointJacobians(model, work, full)
        pin.updateFramePlacements(model, work)
        rows = []
        for leg, frame in enumerate(frames):
            J = pin.getFrameJacobian(model, work, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            down = -robot.legs[leg].foot_radius * R[k, 2]
            contact[k, leg] = work.oMf[frame].translation + down
            rows.append(J[:3] - pin.skew(down) @ J[3:])
        J = np.vstack(rows)
        weight = np.repeat(shares[k], 3)
        f = weight * np.linalg.lstsq(J[:, :6].T * weight, torque[:6], rcond=None)[0]
        rest = torque - J.T @ f
        assert np.abs(rest[:6]).max() < 1e-6
        effort[k] = rest[in_v] + armature * qdd[k] + viscous * qd[k] + coulomb * np.tanh(qd[k] / 0.02)
        force[k] = f.reshape(4, 3)
    return effort, force, contact
