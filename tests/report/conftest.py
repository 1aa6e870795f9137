"""A small identification of the HyQ's RH leg: eight smooth seconds whose torques are computed, with noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.body import FrictionModel, JointMotion, JointTorqueRegressor
from stadera.identify.legs import identify
from stadera.identify.result import Identification
from stadera.identify.settings import IdentifySettings
from stadera.inertia import InertialParameters
from stadera.logs import Recording
from stadera.robot import Robot, load_robot
from stadera.trunk.load import LoadChange, Payload
from stadera.trunk.result import TrunkParameters
from stadera.trunk.standing.estimator import Balance, Stance, Vertical
from stadera.trust import Trust
from stadera.weigh.result import Refusal, Timeline, Weighing

NOISE = 0.1  # N·m


def _recording(robot: Robot, leg: str) -> Recording:
    """Sines at joints whose links and friction are not quite the model's."""
    rng = np.random.default_rng(3)
    tree = robot.leg_tree(leg)
    regressor = JointTorqueRegressor(tree, FrictionModel.full())
    time = np.arange(0.0, 8.0, 0.004)
    speed, phase = rng.uniform(2.0, 8.0, (3, 3)), rng.uniform(0.0, 6.0, (3, 3))
    angle = speed[:, None] * time[:, None] + phase[:, None]
    motion = JointMotion(
        0.3 * np.sin(angle).sum(axis=0),
        0.3 * (speed[:, None] * np.cos(angle)).sum(axis=0),
        -0.3 * (speed[:, None] ** 2 * np.sin(angle)).sum(axis=0),
    )
    truth = {f"{j}.{t}": v for j in tree.joints for t, v in (("armature", 0.02), ("viscous", 0.5), ("coulomb", 1.5))}
    for link in tree.links[1:]:
        truth |= {f"{link}.{name}": 1.1 * value for name, value in robot.inertias[link].to_dict().items()}
    torque = regressor.predict(motion, truth) + rng.normal(0.0, NOISE, (len(time), 3))
    return Recording(time, tree.joints, motion.position, effort=torque, source="swing <RH> & co.csv")


@pytest.fixture(scope="session")
def result() -> Identification:
    robot = load_robot("hyq")
    found = identify(robot, [_recording(robot, "RH")], IdentifySettings(legs=("RH",), torque_lag=0.0))
    (leg,) = found.legs
    warned = replace(leg, warnings=("one joint's rotor inertia is poorly told apart",))
    return replace(found, legs=(warned,), warnings=("2 % of the torques are at the joint's limit",))


POSTURE = np.tile([0.0, 0.7, -1.4], 4)  # rad, feet below the hips
BOX = InertialParameters.from_com(8.0, [-0.2, 0.1, 0.15], [[0.3, 0.04, -0.02], [0.04, 0.5, 0.01], [-0.02, 0.01, 0.6]])


def _timeline(time: np.ndarray, robot: Robot) -> Timeline:
    after = time > 4.0
    mass = robot.inertias[robot.trunk].mass + 8.0 * after
    com = np.full((len(time), 3), np.nan)
    com[:, 0], com[:, 1] = 0.05 - 0.03 * after, 0.02 + 0.01 * after
    payload = np.column_stack([np.where(time > 3.0, 8.0 * after, np.nan), np.where(time > 3.0, 0.1, np.nan)])
    return Timeline(time, mass, np.full(len(time), 0.5), com, np.full((len(time), 3), 0.002), payload)


@pytest.fixture(scope="session")
def weighed() -> Weighing:
    """In motion, with a tare; inertias of trunk and payload observed."""
    robot = load_robot("hyq")
    whole = robot.inertias[robot.trunk] + BOX
    trunk = TrunkParameters(whole, np.diag([0.5, 0.002, 0.002, 0.01]) ** 2, np.full(6, 0.1), np.ones(10, dtype=bool))
    payload = Payload.of_parameters(BOX.vector, np.diag([0.1, *[0.01] * 3, *[0.02] * 6]) ** 2, 0.1)
    return Weighing(
        robot,
        "walk <1> & co.csv",
        "walking",
        "converged",
        Trust("doubtful", 2.5, {"LF": 2.0}, ("friction of 'lf_kfe_joint' is not in the model",)),
        trunk,
        9.9,
        payload,
        (LoadChange(4.0, 4.1, 8.0, 0.1, "on"),),
        _timeline(np.arange(0.1, 10.0, 0.1), robot),
        (Refusal(0.0, 0.1, "too few samples"),),
        0.0,
        10.0,
        (0.004, 0.001),
        notes=("the IMU is at the trunk's origin",),
        stance=Stance(np.eye(3), POSTURE),
    )


@pytest.fixture(scope="session")
def rested(weighed: Weighing) -> Weighing:
    """At rest: no inertia, no height."""
    robot, prior = weighed.robot, weighed.robot.inertias[weighed.robot.trunk]
    std = np.array([0.5, 0.002, 0.003, np.nan])
    trunk = TrunkParameters(prior, np.diag(std**2), np.full(6, np.nan), np.array([*[True] * 3, *[False] * 7]))
    feet = np.array([[0.37, 0.2, -0.6], [0.37, -0.2, -0.6], [-0.37, 0.2, -0.6], [-0.37, -0.2, -0.6]])
    force, stance = np.array([200.0, 210.0, 190.0, 180.0]), np.ones(4, dtype=bool)
    balance = Balance(
        np.eye(3), POSTURE, feet, stance, force, force @ feet[:, :2] / force.sum(), np.array([0.02, 0.01])
    )
    return replace(
        weighed,
        method="standing",
        trust=Trust("good", 1.0),
        trunk=trunk,
        payload=None,
        timeline=replace(_timeline(np.arange(0.1, 10.0, 0.25), robot), payload=None),
        torque_lag=None,
        balance=balance,
        vertical=Vertical("imu", np.array([0.0, 0.0, 1.0]), np.full(3, 0.003)),
    )
