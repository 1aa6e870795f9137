"""A small identification of the HyQ's RH leg, made from its parts: rich random motion, exact torques plus noise."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.identify.information import Information
from stadera.identify.observability import Verdict
from stadera.identify.prior import robot_prior
from stadera.identify.result import MODELS, Identification, KnownCombination, LegIdentification, TorqueTrace
from stadera.identify.solutions import consistent_solution, null_space_solution
from stadera.regressors.friction import FrictionModel
from stadera.regressors.joint_torques import JointTorqueRegressor
from stadera.regressors.motion import JointMotion
from stadera.robot import JointDynamics, load_robot

NOISE = 0.2  # N·m


def _leg_identification(robot, name, rng, samples=1500):
    leg, tree = robot.leg(name), robot.leg_tree(name)
    regressor = JointTorqueRegressor(tree, FrictionModel.full())
    time = np.arange(samples) / 100.0
    phase, speed = rng.uniform(0, 6, (3, 3)), rng.uniform(2, 8, (3, 3))
    angles = speed[:, None] * time[:, None] + phase[:, None]
    position = np.sin(angles).sum(axis=0) * 0.4
    velocity = (speed[:, None] * np.cos(angles)).sum(axis=0) * 0.4
    acceleration = (-(speed[:, None] ** 2) * np.sin(angles)).sum(axis=0) * 0.4
    motion = JointMotion(position, velocity, acceleration)
    prior = robot_prior(robot, regressor.columns)
    truth = dict(zip(prior.columns, prior.values, strict=True))
    for link in leg.links:
        truth[f"{link}.mcx"] *= 1.3
        truth[f"{link}.Izz"] *= 1.2
    for joint in leg.joints:
        truth |= {f"{joint}.armature": 0.02, f"{joint}.viscous": 0.5, f"{joint}.coulomb": 1.5}
    torque = regressor.predict(motion, truth) + rng.normal(0, NOISE, (samples, 3))
    information = Information.of(regressor.rows(motion, torque, std=NOISE), regressor.columns)
    estimate = consistent_solution(information, prior)
    cad = dict(zip(prior.columns, prior.values, strict=True))
    friction = {f"{j}.{t}": truth[f"{j}.{t}"] for j in leg.joints for t in ("armature", "viscous", "coulomb", "offset")}
    parameters = {"prior": cad, "prior_friction": cad | friction, "identified": estimate.by_name()}
    predicted = {model: regressor.predict(motion, parameters[model]) for model in MODELS}
    rms = {
        m: dict(zip(leg.joints, np.sqrt(np.mean((predicted[m] - torque) ** 2, axis=0)), strict=True)) for m in MODELS
    }
    half = samples // 2
    traces = tuple(
        TorqueTrace(part, time[rows], torque[rows], {m: predicted[m][rows] for m in MODELS})
        for part, rows in (("training", slice(0, half)), ("validation", slice(half, samples)))
    )
    first = f"{leg.links[2]}.mcx"
    combination = KnownCombination(
        f"{first} - 0.35·{leg.links[2]}.m", cad[first], truth[first], 0.003, "kg·m", Verdict.OBSERVABLE
    )
    return LegIdentification(
        leg=leg,
        estimate=estimate,
        null_space=null_space_solution(information, prior),
        friction_only=friction,
        combinations=(combination,),
        structural_rank=17,
        noise=dict.fromkeys(leg.joints, NOISE),
        correlation=dict.fromkeys(leg.joints, 1.0),
        rmse={"training": rms, "validation": rms},
        traces=traces,
        warnings=("rotor inertia of RH_HAA is poorly told apart from the links' inertia",),
    )


@pytest.fixture(scope="session")
def result() -> Identification:
    robot = load_robot("hyq")
    robot = robot.with_dynamics({j: JointDynamics() for j in robot.leg("RH").joints})
    rng = np.random.default_rng(3)
    return Identification(
        robot=robot,
        source="swing <RH> & co.csv",
        method="consistent",
        legs=(_leg_identification(robot, "RH", rng),),
        torque_lag=0.003,
        validated_on="the second half of the log",
        notes=("low-pass filtered all signals without delay, -3 dB at 8 Hz",),
        warnings=("2 % of the torques are at the joint's limit",),
    )
