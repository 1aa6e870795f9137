"""Pinocchio's model of a `Robot`, as the plant's independent judge."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stadera.robot.model import Robot, Tree

GRAVITY = np.array([0.0, 0.0, -9.81])


def pinocchio_model(robot: Robot, tree: Tree, floating: bool = False) -> pin.Model:
    """The same tree with Pinocchio's joints; link inertias, where physical, on them; armature included."""
    model = pin.Model()
    model.gravity.linear = GRAVITY
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root") if floating else 0
    joints = [root]
    for i, joint in enumerate(tree.joints):
        placement = pin.SE3(tree.rotations[i], tree.translations[i])
        hinge = pin.JointModelRevoluteUnaligned(tree.axes[i])
        joints.append(model.addJoint(joints[tree.parents[i]], hinge, placement, joint))
    for index, link in zip(joints, tree.links, strict=True):
        if robot.inertias[link].is_physical() and index > 0:
            model.appendBodyToJoint(index, robot.inertias[link].to_pinocchio(), pin.SE3.Identity())
    assert [model.names[j] for j in joints[1:]] == list(tree.joints)
    first = 6 if floating else 0
    assert all(model.joints[j].idx_v == first + k for k, j in enumerate(joints[1:]))
    model.armature = np.r_[np.zeros(first), [robot.dynamics[j].armature for j in tree.joints]]
    return model


def inverse_dynamics(robot: Robot, tree: Tree, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray):
    """Joint torques of rigid links with armature, (samples, n); by the regressor, as links may not be physical."""
    model = pinocchio_model(robot, tree)
    data = model.createData()
    parameters = np.concatenate([_pinocchio_order(robot.inertias[link].vector) for link in tree.links[1:]])
    torque = np.empty_like(position)
    for k in range(len(position)):
        regressor = pin.computeJointTorqueRegressor(model, data, position[k], velocity[k], acceleration[k])
        torque[k] = regressor @ parameters + model.armature * acceleration[k]
    return torque


def _pinocchio_order(vector: np.ndarray) -> np.ndarray:
    m, hx, hy, hz, xx, xy, xz, yy, yz, zz = vector
    return np.array([m, hx, hy, hz, xx, xy, yy, xz, yz, zz])
