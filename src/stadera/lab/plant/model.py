"""Compiles a `Robot` into a MuJoCo model.

The plant is built from the tree, the inertias, the joint dynamics and the feet only, not by MuJoCo's own reader of
model files: it needs no meshes, and its parameters may be those of any `Robot`, such as the truth of an experiment.

Inertias are written into the compiled model. MuJoCo's compiler rejects bodies whose principal moments are negative or
violate the triangle inequality, but its dynamics only need a positive definite joint-space mass matrix M(q). This is
checked here over a sampled workspace, so a link as in the paper's Table I (perturbed to negative moments) can be
simulated as long as the whole mechanism has a positive kinetic energy.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.robot.mjcf import keep_quiet
from stadera.robot.model import Robot, Tree
from stadera.types import Array


def build_spec(
    robot: Robot, tree: Tree, *, floating: bool = False, timestep: float = 1e-3, drive_state: bool = False
) -> mujoco.MjSpec:
    """Makes the bodies, joints and torque actuators of a tree of this robot; inertias are placeholders until compiled.

    Every link becomes a body with its name, every joint a hinge with armature, viscous damping and dry friction
    (`frictionloss`) of the robot's joint dynamics, and an actuator that applies a torque and saturates at the joint's
    effort limit. Offsets of the joint dynamics are constant generalised forces: see `joint_offsets`.

    Args:
        floating: whether the trunk is free (a free joint) instead of held level.
        timestep: [s].
        drive_state: whether each motor's torque is the time integral of its control, so that a torque can be prescribed
            as a continuous function of time, instead of the control itself.
    """
    keep_quiet()
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.gravity = (0.0, 0.0, -GRAVITY)
    trunk = spec.worldbody.add_body(name=tree.links[0])
    placeholder_inertia(trunk)
    if floating:
        trunk.add_freejoint(name="floating_base")
    bodies = [trunk]
    for i, joint in enumerate(tree.joints):
        place = {"pos": tree.translations[i], "quat": quaternion_wxyz(tree.rotations[i])}
        body = bodies[tree.parents[i]].add_body(name=tree.links[i + 1], **place)
        placeholder_inertia(body)
        dynamics = robot.dynamics[joint]
        body.add_joint(
            name=joint,
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=tree.axes[i],
            armature=dynamics.armature,
            damping=[dynamics.viscous, 0.0, 0.0],
            frictionloss=dynamics.coulomb,
            solref_friction=(2.0 * timestep, 1.0),
            # with the fastest reference allowed: the narrowest zone of creep
            solimp_friction=(0.99, 0.99, 1e-3, 0.5, 2.0),
        )
        _add_motor(spec, joint, robot.limits[joint].effort, drive_state)
        bodies.append(body)
    return spec


def compile_model(spec: mujoco.MjSpec, robot: Robot, tree: Tree) -> mujoco.MjModel:
    """The compiled model, with the robot's inertias in it."""
    model = _filled_model(spec, robot, tree)
    least = least_mass_eigenvalue(model, workspace(robot, tree))
    if least <= 0.0:
        unphysical = [link for link in tree.links if not robot.inertias[link].is_physical()]
        blame = f"; not physical: {', '.join(unphysical)}" if unphysical else ""
        raise ModelError(
            f"robot {robot.name}: the joint-space mass matrix is not positive definite in the workspace "
            f"(least eigenvalue {least:.3g} kg·m²), it cannot be simulated{blame}"
        )
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def build_model(
    robot: Robot,
    tree: Tree | None = None,
    *,
    floating: bool = False,
    timestep: float = 1e-3,
    drive_state: bool = False,
) -> mujoco.MjModel:
    """A compiled model of the robot, or of a part such as `robot.leg_tree("RH")`, as `build_spec` makes it."""
    tree = tree or robot.tree
    spec = build_spec(robot, tree, floating=floating, timestep=timestep, drive_state=drive_state)
    return compile_model(spec, robot, tree)


def least_leg_eigenvalue(robot: Robot, leg: str) -> float:
    """Least eigenvalue of a held leg's M(q) over its workspace; positive if the leg can be simulated."""
    tree = robot.leg_tree(leg)
    model = _filled_model(build_spec(robot, tree), robot, tree)
    return least_mass_eigenvalue(model, workspace(robot, tree))


def joint_offsets(robot: Robot, tree: Tree) -> Array:
    """Constant torque of each joint on the actuator, the offset of its dynamics [N·m], (n,)."""
    return np.array([robot.dynamics[joint].offset for joint in tree.joints])


def set_body_inertia(model: mujoco.MjModel, body: int, parameters: InertialParameters) -> None:
    """Writes a body's mass, centre of mass and inertia, physically possible or not; call `mj_setConst` afterwards.

    MuJoCo stores the inertia about the centre of mass by its principal values and axes: I_c = R diag(d) Rᵀ.
    """
    values, axes = np.linalg.eigh(parameters.inertia_com)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1.0
    model.body_mass[body] = parameters.mass
    model.body_ipos[body] = parameters.com if parameters.mass else 0.0
    model.body_iquat[body] = quaternion_wxyz(axes)
    model.body_inertia[body] = values


def quaternion_wxyz(rotation: Array) -> Array:
    """MuJoCo's quaternion (4,), scalar first, of a rotation matrix (3, 3)."""
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(rotation, dtype=float).ravel())
    return quat


def workspace(robot: Robot, tree: Tree, samples: int = 200, seed: int = 20170924) -> Array:
    """Joint positions spread over the joints' ranges (±π where unlimited) [rad], (samples, n); always the same."""
    limits = [robot.limits[joint] for joint in tree.joints]
    lower = np.array([max(limit.lower, -np.pi) for limit in limits])
    upper = np.array([min(limit.upper, np.pi) for limit in limits])
    return np.random.default_rng(seed).uniform(lower, upper, (samples, len(limits)))


def least_mass_eigenvalue(model: mujoco.MjModel, positions: Array) -> float:
    """Least eigenvalue of M(q) over joint positions (samples, n), with the trunk at its reference pose."""
    data = mujoco.MjData(model)
    matrices = np.empty((len(positions), model.nv, model.nv))
    n = positions.shape[1]
    for matrix, position in zip(matrices, positions, strict=True):
        data.qpos[model.nq - n :] = position
        matrix[:] = mass_matrix(model, data)
    return float(np.linalg.eigvalsh(matrices).min())


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """M(q) at the data's position, armature included, (nv, nv); updates the data's position-dependent values."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full


def _filled_model(spec: mujoco.MjSpec, robot: Robot, tree: Tree) -> mujoco.MjModel:
    model = spec.compile()
    for link in tree.links:
        set_body_inertia(model, model.body(link).id, robot.inertias[link])
    return model


def placeholder_inertia(body: mujoco.MjsBody) -> None:
    """Sets any inertia, for the compiler; `set_body_inertia` writes the true one into the compiled model.

    It differs from the body's frame on purpose: the compiler takes shortcuts if the two frames coincide.
    """
    body.explicitinertial = True
    body.mass = 1.0
    body.ipos = (0.1, 0.2, 0.3)
    body.iquat = (0.5, 0.5, 0.5, 0.5)
    body.inertia = (1.0, 1.1, 1.2)


def _add_motor(spec: mujoco.MjSpec, joint: str, effort: float, drive_state: bool) -> None:
    motor = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_motor()
    if drive_state:
        motor.dyntype = mujoco.mjtDyn.mjDYN_INTEGRATOR
    if np.isfinite(effort):
        motor.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        motor.forcerange = (-effort, effort)


@dataclass(frozen=True, eq=False)
class DryFriction:
    """Largest dry friction coulomb (1 + v(q)) + load |τ|, with v linear between knots evenly over a joint's range."""

    coulomb: Array  # (n,) [N·m]
    low: Array  # (n,) [rad], the first knot
    high: Array  # (n,) [rad], the last one
    variation: Array  # (n, knots), v at the knots
    load: Array  # (n,), share of the torque

    def at(self, position: Array, effort: Array) -> Array:
        """Friction (..., n) [N·m] at joint positions (..., n) [rad] under torques (..., n) [N·m]."""
        last, joints = self.variation.shape[1] - 1, np.arange(position.shape[-1])
        x = last * np.clip((position - self.low) / (self.high - self.low), 0.0, 1.0)
        before = np.minimum(x.astype(int), last - 1)
        share = x - before
        v = (1.0 - share) * self.variation[joints, before] + share * self.variation[joints, before + 1]
        return np.asarray(self.coulomb * (1.0 + v) + self.load * np.abs(effort))

    def of(self, joints: list[int]) -> DryFriction:
        """That of some of the joints."""
        return DryFriction(*(getattr(self, name)[joints] for name in self.__dataclass_fields__))
