"""Converts a robot to a Pinocchio model, with the robot's inertias and rotors instead of the file's."""

from typing import Any

import numpy as np
import pinocchio as pin

from stadera.errors import ModelError
from stadera.robot.model import Robot
from stadera.types import Array


def pinocchio_model(robot: Robot) -> Any:
    """`pinocchio.Model` with a free-flyer and the tree's joints in the tree's order. Raises ModelError: a link has zero
    mass and non-zero moments, or an impossible inertia.

    Hence q = [position, quaternion xyzw, joint angles in tree order] and v = [linear, angular velocity of the trunk in
    its own frame, joint velocities]. Link i of the tree is joint i + 1. Rotor inertias are set, friction and limits are
    not; every link is a BODY frame and every other frame of the robot an OP_FRAME, by their names.
    """
    tree, model = robot.tree, pin.Model()
    model.name = robot.name
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.addJointFrame(root)
    for i, name in enumerate(tree.joints):
        placement = pin.SE3(tree.rotations[i], tree.translations[i])
        joint = model.addJoint(tree.parents[i] + 1, _joint_model(tree.axes[i]), placement, name)
        model.addJointFrame(joint)
    for k, link in enumerate(tree.links):
        try:
            body = robot.inertias[link].to_pinocchio()
        except RuntimeError as error:
            reason = str(error).rstrip(".")
            raise ModelError(f"robot {robot.name}: link {link!r} is no body that can be simulated: {reason}") from error
        model.appendBodyToJoint(k + 1, body, pin.SE3.Identity())
    for name, frame in robot.frames.items():
        kind = pin.FrameType.BODY if name in tree.links else pin.FrameType.OP_FRAME
        placement = pin.SE3(np.array(frame.rotation), np.array(frame.translation))
        model.addFrame(pin.Frame(name, tree.links.index(frame.link) + 1, placement, kind), False)
    model.armature = np.array([*[0.0] * 6, *(robot.dynamics[joint].armature for joint in tree.joints)])
    return model


def _joint_model(axis: Array) -> Any:
    aligned = {(1.0, 0.0, 0.0): pin.JointModelRX, (0.0, 1.0, 0.0): pin.JointModelRY, (0.0, 0.0, 1.0): pin.JointModelRZ}
    kind = aligned.get((float(axis[0]), float(axis[1]), float(axis[2])))
    return kind() if kind else pin.JointModelRevoluteUnaligned(np.array(axis))
