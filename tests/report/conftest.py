"""A small identification of the HyQ's RH leg: eight smooth seconds whose torques are computed, with noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.identify.legs import identify
from stadera.identify.result import Identification
from stadera.identify.settings import IdentifySettings
from stadera.legs import FrictionModel, JointMotion, JointTorqueRegressor
from stadera.logs import Recording
from stadera.robot import Robot, load_robot

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
