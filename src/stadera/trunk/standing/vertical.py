"""The vertical of a robot that stands still and has no IMU: the direction of the total contact force.

At rest the specific force of the trunk is a = g u, u the vertical, trunk axes. Joint j of a leg carries the links k
beyond it, h_j = Σ m_k (s_j x (c_k - o_j)) · a, linear in a: h = H a. So the feet's forces f = B (h - τ), B = J^-T, are
affine in a, and so is their sum, which carries the robot's mass M:

    F(a) = F₀ + K a,    F₀ = -Σ B τ,    K = Σ B H;        F(a) = M a,    |a| = g

These are three equations for three unknowns, M and the two angles of u. They are solved by the iteration a ← g F(a) /
|F(a)|, which contracts by about |K| / M, the effect of the legs' own weight on the feet's forces across the vertical,
as a share of the weight.

If feet do not slip and joints are at rest, three feet hold the trunk at rest as well, so a gyro would add nothing. Only
an IMU could detect a steady push or pull across the vertical, which tilts F, and an accelerating ground, which changes
its magnitude; both are attributed to weight here. Constant errors of torques have the same effect, and are in the error
bars (`stadera.trunk.standing.equilibrium`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stadera.body.statics import LegModel, inverse_transposed
from stadera.constants import GRAVITY, NOTHING
from stadera.logs.recording import Recording
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement, extra_states, meant_stance
from stadera.trunk.standing.contact import ground_normal
from stadera.trunk.standing.forces import CARRIES
from stadera.types import Array, Bools

_AT_ONCE = 4096  # samples


def vertical_by_forces(
    robot: Robot, position: Array, velocity: Array, effort: Array, stance: Bools | None = None
) -> tuple[Array, Array]:
    """The vertical indicated by the feet's forces, and the mass that they carry, for samples at rest.

    Args:
        robot: the model of the legs.
        position, velocity: (samples, n) [rad, rad/s], joints in the tree's order; velocities are used for friction
            only.
        effort: (samples, n) [N·m].
        stance: (samples, 4), legs that may be loaded; None for all.

    Returns:
        Unit vectors (samples, 3), trunk axes, and the robot's mass (samples,) [kg]. Both are meaningless for a robot
        that is not on its feet.
    """
    model = LegModel.of(robot)
    columns = model.columns
    torque = effort[:, columns] - model.friction.torque(velocity[:, columns])
    pose = model.pose(position[:, columns])
    bears, feet = model.weight_torques(pose), pose.feet.transpose(1, 2, 0)
    away = -feet.mean(axis=1)
    away /= np.linalg.norm(away, axis=1, keepdims=True)

    def solved(carrying: Bools) -> tuple[Array, Array, Array]:
        """Vertical, sum of the forces, and each foot's force along the ground's normal."""
        normal = ground_normal(feet, carrying, away)
        by_torque, volume = inverse_transposed(pose.jacobians(model.contacts(pose.feet, normal.T)))
        felt = carrying & (np.abs(volume) >= model.least_volume)
        by_torque = np.where(felt[..., None], by_torque, 0.0)
        fixed = -(by_torque * torque).sum(axis=-1).transpose(1, 2, 0)
        slope = np.einsum("inlk,jnlk->nlij", by_torque, bears)
        up, total = _balanced(fixed.sum(axis=1), slope.sum(axis=1), normal)
        force = fixed + GRAVITY * (slope @ up[:, None, :, None])[..., 0]
        return up, total, (force @ normal[:, :, None])[..., 0]

    meant = np.ones((len(position), 4), dtype=bool) if stance is None else stance
    up, total, load = solved(meant)
    carrying = meant & (load > CARRIES * robot.mass * GRAVITY)
    if not np.array_equal(carrying, meant):
        up, total, _ = solved(carrying)
    return up, np.linalg.norm(total, axis=1) / GRAVITY


def vertical_of(measurement: Measurement, robot: Robot) -> Array:
    """The vertical indicated by the feet's forces at one measurement at rest, (3,), trunk axes."""
    m = measurement
    still = np.zeros_like(m.joint_position)[None]
    stance = None if m.stance is None else m.stance[None]
    return np.asarray(vertical_by_forces(robot, m.joint_position[None], still, m.effort[None], stance)[0][0])


def measurements_without_imu(recording: Recording, robot: Robot) -> Iterator[Measurement]:
    """Yields a log's samples as if at rest, with the vertical from the feet's forces. The caller must check for rest.

    Raises:
        RecordingError: the log lacks a joint's velocity or effort.
        UnknownNameError: a joint of the robot is not recorded.
    """
    joints = robot.tree.joints
    q, qd, effort = (recording.channel(name, joints) for name in ("position", "velocity", "effort"))
    stance = meant_stance(recording, robot)
    extra = extra_states(recording, robot)
    for start in range(0, len(recording), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        up, _ = vertical_by_forces(robot, q[part], qd[part], effort[part], None if stance is None else stance[part])
        for k, vertical in enumerate(up, start=start):
            yield Measurement(
                time=float(recording.time[k]),
                joint_position=q[k],
                joint_velocity=qd[k],
                effort=effort[k],
                angular_velocity=np.zeros(3),
                specific_force=GRAVITY * vertical,
                stance=None if stance is None else stance[k],
                vertical_by_forces=True,
                extra=extra[k],
            )


def _balanced(fixed: Array, slope: Array, start: Array, iterations: int = 60) -> tuple[Array, Array]:
    """u (samples, 3) such that F₀ + g K u is along u, and that force, from F₀ (samples, 3) and K (samples, 3, 3)."""
    up, force = start, fixed
    for _ in range(iterations):
        force = fixed + GRAVITY * np.matvec(slope, up)
        size = np.linalg.norm(force, axis=1, keepdims=True)
        before, up = up, np.where(size > 0, force / np.where(size > 0, size, 1.0), up)
        if float(np.abs(up - before).max(initial=0.0)) < NOTHING:
            break
    return up, force
