"""Dynamics by Pinocchio, and random motions and bodies to try them on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stadera.body import JointMotion, Rows, TrunkMotion
from stadera.inertia import InertialParameters
from stadera.lab.pinocchio import pinocchio_model
from stadera.robot.model import Robot, Tree


def random_motion(n: int, samples: int = 12, seed: int = 0) -> JointMotion:
    rng = np.random.default_rng(seed)
    return JointMotion(*(s * rng.uniform(-1.0, 1.0, (samples, n)) for s in (2.0, 5.0, 30.0)))


def random_trunk(samples: int = 12, seed: int = 1) -> TrunkMotion:
    """Specific force drawn anew for each sample."""
    return TrunkMotion(15.0 * np.random.default_rng(seed).uniform(-1.0, 1.0, (samples, 3)))


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    return pin.Quaternion(rng.normal(size=4)).normalized().matrix()


def random_tree(seed: int, joints: int = 4) -> Tree:
    """Joints in a branching tree, every axis oblique, every frame turned and displaced."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(joints, 3))
    return Tree(
        links=tuple(f"l{k}" for k in range(joints + 1)),
        joints=tuple(f"j{k}" for k in range(joints)),
        parents=tuple(int(rng.integers(0, k + 1)) for k in range(joints)),
        rotations=np.stack([random_rotation(rng) for _ in range(joints)]),
        translations=rng.uniform(-0.5, 0.5, (joints, 3)),
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
    )


def random_inertias(links: tuple[str, ...], seed: int) -> dict[str, InertialParameters]:
    rng = np.random.default_rng(seed)
    return {
        link: InertialParameters.from_pinocchio(
            pin.Inertia.FromLogCholeskyParameters(pin.LogCholeskyParameters(rng.uniform(-1.0, 0.5, 10)))
        )
        for link in links
    }


def robot_of(tree: Tree, inertias: dict[str, InertialParameters], like: Robot) -> Robot:
    """A robot of any tree; legs, limits and dynamics are none of its business."""
    dynamics, limits = next(iter(like.dynamics.values())), next(iter(like.limits.values()))
    return replace(
        like,
        tree=tree,
        inertias=inertias,
        dynamics=dict.fromkeys(tree.joints, dynamics),
        limits=dict.fromkeys(tree.joints, limits),
        frames={},
        shapes=(),
    )


def named(inertias: dict[str, InertialParameters], links: tuple[str, ...]) -> dict[str, float]:
    """Parameters by column name."""
    return {f"{link}.{name}": value for link in links for name, value in inertias[link].to_dict().items()}


def floating_torques(robot: Robot, joints: JointMotion, trunk: TrunkMotion, rotations: np.ndarray) -> np.ndarray:
    """Joint torques (samples, n), with gravity, by recursive Newton-Euler.

    `rotations` (samples, 3, 3) is the trunk's attitude in the world. The trunk's linear velocity is drawn at random: it
    must not matter.
    """
    model = pinocchio_model(robot)
    model.armature[:] = 0.0
    model.gravity.linear = gravity = np.array([0.0, 0.0, -9.81])
    data, rng = model.createData(), np.random.default_rng(9)
    n = len(joints)
    force, still = np.broadcast_to(trunk.specific_force, (n, 3)), np.zeros(3)
    out = np.empty((n, model.nv))
    for k in range(n):
        quaternion = pin.Quaternion(rotations[k]).coeffs()
        q = np.concatenate((rng.normal(size=3), quaternion, joints.position[k]))
        v = np.concatenate((rng.normal(size=3), still, joints.velocity[k]))
        a = np.concatenate((force[k] + rotations[k].T @ gravity, still, joints.acceleration[k]))
        out[k] = pin.rnea(model, data, q, v, a)
    return out[:, 6:]


def leg_regressor(tree: Tree, joints: JointMotion, up: np.ndarray) -> np.ndarray:
    """Pinocchio's joint torque regressor of a tree on a held trunk, (samples, joints, 10 a moving link), our order."""
    model = pin.Model()
    at = [0]
    for i, joint in enumerate(tree.joints):
        placement = pin.SE3(tree.rotations[i], tree.translations[i])
        at.append(model.addJoint(at[tree.parents[i]], pin.JointModelRevoluteUnaligned(tree.axes[i]), placement, joint))
    model.gravity.linear = -9.81 * up / np.linalg.norm(up)
    data = model.createData()
    order = np.array([0, 1, 2, 3, 4, 5, 7, 6, 8, 9])
    rows = [
        pin.computeJointTorqueRegressor(model, data, q, v, a).reshape(model.nv, -1, 10)[:, :, order]
        for q, v, a in zip(joints.position, joints.velocity, joints.acceleration, strict=True)
    ]
    return np.stack(rows).reshape(len(joints), model.nv, -1)


def stack(rows: Sequence[Rows], columns: tuple[str, ...]) -> Rows:
    """Concatenates several sets of rows into one dense set over `columns`; columns that a set lacks are zero in it."""
    index = {name: k for k, name in enumerate(columns)}
    matrix = np.zeros((sum(len(r) for r in rows), len(columns)))
    at = 0
    for r in rows:
        matrix[at : at + len(r), [index[c] for c in r.columns]] = r.matrix
        at += len(r)
    target = np.concatenate([r.target for r in rows]) if rows else np.zeros(0)
    std = np.concatenate([np.broadcast_to(r.std, len(r)) for r in rows]) if rows else np.zeros(0)
    return Rows(columns, matrix, target, std)
