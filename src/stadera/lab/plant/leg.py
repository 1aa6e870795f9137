"""One leg swinging on a held trunk, the plant of offline identification, and legs that differ from CAD."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.linalg import expm

from stadera.constants import SAME
from stadera.errors import ModelError
from stadera.excite.sinusoids import Reference
from stadera.inertia import InertialParameters
from stadera.lab.plant.model import (
    DryFriction,
    build_model,
    joint_offsets,
    least_leg_eigenvalue,
    mass_matrix,
    workspace,
)
from stadera.logs import Recording
from stadera.robot.model import Robot, Tree
from stadera.types import Array


@dataclass(frozen=True)
class TrackingSettings:
    """Settings of the simulation of a leg."""

    # natural frequency of the tracking loop with default gains [rad/s], well above an excitation's
    bandwidth: float = 2 * np.pi * 8.0
    # of the integrator [s]; within these, a step is at most `decay` time constants of the drives' damping, since a
    # fourth-order Runge-Kutta method is unstable above 2.8
    largest_step: float = 1e-3
    smallest_step: float = 2e-5
    decay: float = 2.0
    tolerance: float = 1e-15  # of the dry-friction constraint; MuJoCo's default leaves errors of 3e-5 N·m in the torque


_TRACKING = TrackingSettings()


@dataclass(frozen=True, eq=False)
class Gains:
    """Joint tracking gains: τ = stiffness (q_ref - q) + damping (q̇_ref - q̇)."""

    stiffness: Array  # (joints,) [N·m/rad]
    damping: Array  # (joints,) [N·m·s/rad]

    @classmethod
    def scaled(cls, robot: Robot, leg: str, bandwidth: float = _TRACKING.bandwidth) -> Gains:
        """Gains for a critically damped loop of this bandwidth [rad/s] on the largest inertia a joint sees."""
        tree = robot.leg_tree(leg)
        model = build_model(robot, tree)
        data = mujoco.MjData(model)
        inertia = np.zeros(model.nv)
        for position in workspace(robot, tree):
            data.qpos[:] = position
            inertia = np.maximum(inertia, np.diag(mass_matrix(model, data)))
        return cls(inertia * bandwidth**2, 2.0 * inertia * bandwidth)


def simulate_leg(
    robot: Robot, leg: str, trajectory: Reference, *, gains: Gains | None = None, friction: DryFriction | None = None
) -> Recording:
    """Simulates one leg tracking a reference, on which it starts, the trunk held level and the other legs at rest.

    The motor's torque is continuous in time (the reference is interpolated linearly between its samples), saturated at
    the joint's effort limit, and integrated by a fourth-order Runge-Kutta method. Joint limits are not end stops here.
    The recorded values at the reference's instants are exact and simultaneous: position, velocity, acceleration and
    effort of a sample satisfy

        effort = M(q) q̈ + h(q, q̇) + armature q̈ + viscous q̇ + friction + offset

    where friction is coulomb sign(q̇) while a joint slides, and the static friction (below coulomb) while it sticks.
    The robot may be physically impossible (see `stadera.lab.plant.model`); `gains` are `Gains.scaled` by default;
    `friction` is in place of the leg's Coulomb friction.
    """
    tree = robot.leg_tree(leg)
    gains = gains or Gains.scaled(robot, leg)
    interval = float(trajectory.time[-1] - trajectory.time[0]) / (len(trajectory.time) - 1)
    fastest = _fastest_decay(robot, tree, gains, trajectory.position[:: max(1, len(trajectory.time) // 100)])
    step = min(max(_TRACKING.decay / fastest, _TRACKING.smallest_step), _TRACKING.largest_step)
    substeps = max(1, int(np.ceil(interval / step - SAME)))
    model = _tracking_model(robot, tree, gains, interval / substeps)
    # the actuator itself adds -stiffness q - damping q̇, so only this drive is prescribed over time
    drive = gains.stiffness * trajectory.position + gains.damping * trajectory.velocity
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


def _fastest_decay(robot: Robot, tree: Tree, gains: Gains, positions: Array) -> float:
    """Largest eigenvalue of M⁻¹ D of the drives' damping over these positions (samples, n) [1/s]: straight legs have
    little inertia about some of their joints.
    """
    model = build_model(robot, tree)
    data, damping, fastest = mujoco.MjData(model), np.diag(gains.damping), float(np.finfo(float).tiny)
    for position in positions:
        data.qpos[:] = position
        rates = np.linalg.eigvals(np.linalg.solve(mass_matrix(model, data), damping))
        fastest = max(fastest, float(np.abs(rates).max()))
    return fastest


def _tracking_model(robot: Robot, tree: Tree, gains: Gains, timestep: float) -> mujoco.MjModel:
    """The leg with motors of force `act - stiffness q - damping q̇`, where act is the integral of the control."""
    model = build_model(robot, tree, timestep=timestep, drive_state=True)
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
    friction: DryFriction | None,
) -> Array:
    """Position, velocity, acceleration and motor torque at each sample of the drive, (samples, 4, joints)."""
    rates = np.diff(drive, axis=0, append=drive[-1:]) / interval
    samples = np.empty((len(drive), 4, model.nv))
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


def perturbed(
    robot: Robot,
    leg: str,
    rng: np.random.Generator,
    *,
    com_std: float = 0.02,
    inertia_std: float = 0.02,
    margin: float = 0.1,
    draws: int = 200,
) -> Robot:
    """The paper's perturbation (section IV.A): white noise on the leg links' centres of mass and inertia tensors.

    Masses are unchanged. Each component of a centre of mass is perturbed by an independent N(0, com_std²) [m], and each
    of the six entries of the tensor about the LINK ORIGIN, in link axes (the paper's footnote 5), by N(0, inertia_std²)
    [kg·m²]: the tensor does not follow the shifted centre. At the paper's sizes the links are usually not physically
    possible (Table I has negative moments). The whole set is drawn again, up to `draws` times, until the least
    eigenvalue of the joint-space mass matrix over the leg's workspace is at least `margin` times that of the given
    robot, which keeps the leg simulable.
    """
    least = margin * least_leg_eigenvalue(robot, leg)
    for _ in range(draws):
        links = {}
        for link in robot.leg(leg).links:
            vector = robot.inertias[link].vector.copy()
            vector[1:4] += vector[0] * rng.normal(0.0, com_std, 3)
            vector[4:] += rng.normal(0.0, inertia_std, 6)
            links[link] = InertialParameters(vector)
        candidate = robot.with_inertias(links)
        if least_leg_eigenvalue(candidate, leg) >= least:
            return candidate
    raise ModelError(
        f"robot {robot.name}, leg {leg}: none of {draws} perturbations (com {com_std} m, inertia {inertia_std} "
        "kg·m²) leaves the mass matrix positive definite; ask for smaller ones"
    )


def perturbed_physical(
    robot: Robot, leg: str, rng: np.random.Generator, *, com_std: float = 0.02, stretch_std: float = 0.3
) -> Robot:
    """A perturbation of the same size for which every link is physically possible, without redraws.

    The link's mass distribution is displaced by N(0, com_std²) [m] in each component, then deformed about its centre of
    mass by the linear map exp(E), with the nine entries of E independent N(0, stretch_std²). The pseudo-inertia is
    transformed by congruence, so it remains positive definite; to first order the second moments change by a share of 2
    stretch_std. Masses are unchanged.
    """
    changed = {}
    for link in robot.leg(leg).links:
        body = robot.inertias[link]
        com = body.com
        shift = rng.normal(0.0, com_std, 3)
        deformation = expm(rng.normal(0.0, stretch_std, (3, 3)))
        # r' = c + s + D (r - c)
        changed[link] = body.transformed(deformation, com + shift - deformation @ com)
    return robot.with_inertias(changed)
