"""One leg swinging on a held trunk: the plant of offline identification (section IV.A of the paper)."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from stadera.constants import SAME
from stadera.errors import ModelError
from stadera.excite.sinusoids import Reference
from stadera.lab.plant.friction import VaryingFriction
from stadera.lab.plant.model import ModelOptions, build_model, joint_offsets, mass_matrix, workspace
from stadera.logs import Recording
from stadera.robot.model import Robot, Tree
from stadera.types import Array


@dataclass(frozen=True)
class TrackingSettings:
    """Settings of the simulation of a leg."""

    # natural frequency of the tracking loop with default gains [rad/s], well above an excitation's
    bandwidth: float = 2 * np.pi * 8.0
    largest_step: float = 1e-3  # of the integrator [s]
    tolerance: float = 1e-15  # of the dry-friction constraint; MuJoCo's default leaves errors of 3e-5 N·m in the torque


_TRACKING = TrackingSettings()


@dataclass(frozen=True, eq=False)
class Gains:
    """Joint tracking gains: τ = stiffness (q_ref - q) + damping (q̇_ref - q̇) + feedforward."""

    stiffness: Array  # (3,) [N·m/rad]
    damping: Array  # (3,) [N·m·s/rad]

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping"):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (3,) or not (np.isfinite(value).all() and (value >= 0).all()):
                raise ModelError(f"tracking {name} needs three values that are not negative, got {value.tolist()}")
            object.__setattr__(self, name, value)

    @classmethod
    def scaled(cls, robot: Robot, leg: str, bandwidth: float = _TRACKING.bandwidth) -> Gains:
        """Gains for a critically damped loop of this bandwidth [rad/s] on the largest inertia a joint sees."""
        tree = robot.leg_tree(leg)
        model = build_model(robot, tree)
        data = mujoco.MjData(model)
        inertia = np.zeros(3)
        for position in workspace(robot, tree):
            data.qpos[:] = position
            inertia = np.maximum(inertia, np.diag(mass_matrix(model, data)))
        return cls(inertia * bandwidth**2, 2.0 * inertia * bandwidth)


def simulate_leg(
    robot: Robot,
    leg: str,
    trajectory: Reference,
    *,
    gains: Gains | None = None,
    feedforward: Array | None = None,
    friction: VaryingFriction | None = None,
) -> Recording:
    """Simulates one leg tracking a reference, on which it starts, the trunk held level and the other legs at rest.

    The motor's torque is continuous in time (the reference is interpolated linearly between its samples), saturated at
    the joint's effort limit, and integrated by a fourth-order Runge-Kutta method. Joint limits are not end stops here.
    The recorded values at the reference's instants are exact and simultaneous: position, velocity, acceleration and
    effort of a sample satisfy

        effort = M(q) q̈ + h(q, q̇) + armature q̈ + viscous q̇ + friction + offset

    where friction is coulomb sign(q̇) while a joint slides, and the static friction (below coulomb) while it sticks.
    The robot may be physically impossible (see `stadera.lab.plant.model`); `gains` are `Gains.scaled` by default;
    `feedforward` (samples, 3) [N·m] is added to the tracking torque; `friction` is in place of the leg's Coulomb
    friction.
    """
    tree = robot.leg_tree(leg)
    gains = gains or Gains.scaled(robot, leg)
    interval = _check(trajectory, feedforward)
    substeps = max(1, int(np.ceil(interval / _TRACKING.largest_step - SAME)))
    model = _tracking_model(robot, tree, gains, interval / substeps)
    # the actuator itself adds -stiffness q - damping q̇, so only this drive is prescribed over time
    drive = gains.stiffness * trajectory.position + gains.damping * trajectory.velocity
    if feedforward is not None:
        drive = drive + feedforward
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = trajectory.position[0], trajectory.velocity[0]
    data.qfrc_applied[:] = -joint_offsets(robot, tree)
    samples = _run(model, data, drive, interval, substeps, friction)
    if not np.isfinite(samples).all():
        at = trajectory.time[int(np.argmax(~np.isfinite(samples).all(axis=(1, 2))))]
        raise ModelError(f"robot {robot.name}, leg {leg}: the simulated motion ran away at {at:.3f} s; lower the gains")
    position, velocity, acceleration, effort = (np.ascontiguousarray(samples[:, i]) for i in range(4))
    return Recording(
        time=np.array(trajectory.time, dtype=float),
        joints=tree.joints,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        effort=effort,
        source=f"simulated {robot.name} {leg}",
    )


def _check(trajectory: Reference, feedforward: Array | None) -> float:
    """Checks a reference; returns its sampling interval [s]."""
    time = np.asarray(trajectory.time, dtype=float)
    if time.ndim != 1 or len(time) < 2:
        raise ModelError(f"a leg's reference needs at least two samples, time has shape {time.shape}")
    given = {"position": trajectory.position, "velocity": trajectory.velocity}
    if feedforward is not None:
        given["feedforward"] = feedforward
    for name, values in given.items():
        if values.shape != (len(time), 3):
            raise ModelError(f"a leg's reference {name} needs shape {(len(time), 3)}, got {values.shape}")
        if not np.isfinite(values).all():
            raise ModelError(f"a leg's reference {name} is not finite")
    interval = float(time[-1] - time[0]) / (len(time) - 1)
    if not interval > 0 or np.abs(np.diff(time) - interval).max() > SAME * interval:
        raise ModelError("a leg's reference needs an even, increasing clock")
    return interval


def _tracking_model(robot: Robot, tree: Tree, gains: Gains, timestep: float) -> mujoco.MjModel:
    """The leg with motors of force `act - stiffness q - damping q̇`, where act is the integral of the control."""
    model = build_model(robot, tree, ModelOptions(timestep=timestep, drive_state=True))
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.tolerance = _TRACKING.tolerance
    model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_AFFINE
    model.actuator_biasprm[:, 1] = -gains.stiffness
    model.actuator_biasprm[:, 2] = -gains.damping
    return model


def _run(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    drive: Array,
    interval: float,
    substeps: int,
    friction: VaryingFriction | None,
) -> Array:
    """Position, velocity, acceleration and motor torque at each sample of the drive, (samples, 4, 3)."""
    rates = np.diff(drive, axis=0, append=drive[-1:]) / interval
    samples = np.empty((len(drive), 4, 3))
    forward, integrate = mujoco.mj_forward, mujoco.mj_RungeKutta
    qpos, qvel, qacc = data.qpos, data.qvel, data.qacc
    act, ctrl, force = data.act, data.ctrl, data.actuator_force
    for k in range(len(drive)):
        act[:], ctrl[:] = drive[k], rates[k]
        if friction is not None:
            model.dof_frictionloss[:] = friction.at(qpos, force)
        forward(model, data)
        sample = samples[k]
        sample[0], sample[1], sample[2], sample[3] = qpos, qvel, qacc, force
        integrate(model, data, 4)
        for _ in range(substeps - 1):
            forward(model, data)
            integrate(model, data, 4)
    return samples
