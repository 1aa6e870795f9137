"""A humanoid's leg of six joints, identified while it swings, against Pinocchio's inverse dynamics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from stadera import IdentifySettings, identify
from stadera.errors import MissingExtraError
from stadera.logs import Recording, take
from stadera.robot import Robot, load_robot

ROTOR, COULOMB, RATE = 0.01, 0.8, 250.0  # kg·m², N·m, Hz


def g1() -> Robot:
    try:
        return load_robot("g1")
    except MissingExtraError as error:
        pytest.skip(str(error))


def swinging(robot: Robot, leg: str) -> Recording:
    """The leg swings, the trunk held; rotors and Coulomb friction that the model lacks."""
    joints, model = robot.leg(leg).joints, pin.buildModelFromUrdf(str(robot.source))
    rng, time, data = np.random.default_rng(0), np.arange(0.0, 40.0, 1.0 / RATE), model.createData()
    q = np.zeros((3, len(time), len(joints)))
    for _ in range(4):
        w, phase = 2.0 * np.pi * rng.uniform(0.2, 1.6, len(joints)), rng.uniform(0.0, 2.0 * np.pi, len(joints))
        along = time[:, None] * w + phase
        q += 0.15 * np.array([np.sin(along), w * np.cos(along), -w * w * np.sin(along)])
    at = [model.joints[model.getJointId(joint)].idx_v for joint in joints]
    whole, effort = np.zeros((3, model.nv)), np.zeros((len(time), len(joints)))
    for k in range(len(time)):
        whole[:, at] = q[:, k]
        effort[k] = pin.rnea(model, data, *whole)[at]
    effort += ROTOR * q[2] + COULOMB * np.tanh(q[1] / 0.02) + 0.02 * rng.standard_normal(effort.shape)
    return Recording.from_arrays(time, q[0], q[1], effort, joints=joints)


def test_of_a_short_log_little_is_known_and_nothing_is_wrong() -> None:
    """Half of it has 14 rows for 60 unknowns: a fit that leaves nothing is no noise of zero."""
    robot = g1()
    log = swinging(robot, "left")
    short = take(log, log.time < 4.0)
    result = identify(robot, short, IdentifySettings(legs=("left",)))
    for joint in robot.leg("left").joints:
        friction = result.legs[0].parameters[f"{joint}.coulomb"]
        assert abs(friction.value - COULOMB) < 3.0 * friction.std, joint


def test_rotors_and_friction_of_six_joints_are_found() -> None:
    robot = g1()
    result = identify(robot, swinging(robot, "left"), IdentifySettings(legs=("left",)))
    assert result.trust.verdict == "good"
    found = result.legs[0].parameters
    for joint in robot.leg("left").joints:
        assert found[f"{joint}.coulomb"].value == pytest.approx(COULOMB, rel=0.02), joint
        assert found[f"{joint}.armature"].value == pytest.approx(ROTOR, rel=0.1), joint
