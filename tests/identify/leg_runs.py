"""Legs to identify in tests: rows of random motion, and short runs of the plant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from stadera.body import FrictionModel, JointMotion, JointTorqueRegressor
from stadera.excite.sinusoids import Sinusoids
from stadera.information import Information
from stadera.lab.plant.leg import perturbed_physical, simulate_leg
from stadera.logs import Recording
from stadera.robot import JointDynamics, Robot, load_robot

DRIVE = JointDynamics(armature=0.03, viscous=0.6, coulomb=1.2, offset=-0.5)
SMOOTH = JointDynamics(armature=0.03, viscous=0.6)


@cache
def hyq() -> Robot:
    return load_robot("hyq")


@cache
def other_hyq(seed: int = 3) -> Robot:
    """A HyQ whose RH leg is not the model's, and could exist."""
    return perturbed_physical(hyq(), "RH", np.random.default_rng(seed), com_std=0.01, stretch_std=0.1)


def parameters_of(robot: Robot, columns: tuple[str, ...]) -> dict[str, float]:
    """The robot's own values of columns; friction of a model does not vary."""
    out = {}
    for column in columns:
        owner, term = column.rsplit(".", 1)
        out[column] = (
            robot.inertias[owner].to_dict()[term]
            if owner in robot.inertias
            else getattr(robot.dynamics[owner], term, 0.0)
        )
    return out


def leg_regressor(robot: Robot, friction: bool = False) -> JointTorqueRegressor:
    return JointTorqueRegressor(robot.leg_tree("RH"), FrictionModel.full() if friction else FrictionModel())


def rich_motion(samples: int = 400, seed: int = 0) -> JointMotion:
    rng = np.random.default_rng(seed)
    return JointMotion(*(s * rng.uniform(-1.0, 1.0, (samples, 3)) for s in (1.2, 4.0, 20.0)))


def told(
    truth: Mapping[str, float],
    regressor: JointTorqueRegressor,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
    motion: JointMotion | None = None,
    std: float | None = None,
) -> Information:
    """What torques of a leg with these parameters say, white noise of `noise` N·m on them (taken for 1e-9 if none)."""
    motion = motion or rich_motion()
    torque = regressor.predict(motion, dict(truth))
    if noise:
        torque = torque + (rng or np.random.default_rng(1)).normal(0.0, noise, torque.shape)
    return Information.of(regressor.rows(motion, torque, std=std or noise or 1e-9), regressor.columns)


def swing(duration: float = 20.0, seed: int = 0, scale: float = 1.0) -> Sinusoids:
    """A leg's motion, with two sinusoids a joint about one origin."""
    rng = np.random.default_rng(seed)
    shape = (1, 3, 2)
    return Sinusoids(
        joints=hyq().leg("RH").joints,
        rest=np.array([0.0, -0.6, 1.2]),
        origins=np.array([[0.05, -0.5, 1.1]]),
        amplitudes=scale * np.array([0.25, 0.35, 0.45])[:, None] * np.array([1.0, 0.5]) * np.ones(shape),
        frequencies=rng.uniform(0.4, 1.6, shape),
        phases=rng.uniform(0.0, np.pi, shape),
        starts=np.array([0.0, duration - 1.0]),
        fade=1.0,
    )


@cache
def run(drive: JointDynamics = DRIVE, seed: int = 0, duration: float = 20.0, rate: float = 250.0) -> Recording:
    """The other HyQ's RH leg swinging, exactly recorded: position and effort, and nothing else."""
    robot = replace(other_hyq(), dynamics=dict.fromkeys(hyq().tree.joints, drive))
    recording = simulate_leg(robot, "RH", swing(duration, seed).sample(rate))
    return replace(recording, velocity=None, acceleration=None, source=f"run{seed}")


@cache
def exact_run(drive: JointDynamics = SMOOTH, seed: int = 0) -> Recording:
    """The same with exact velocities and accelerations, and joints whose friction is linear."""
    robot = replace(other_hyq(), dynamics=dict.fromkeys(hyq().tree.joints, drive))
    return replace(simulate_leg(robot, "RH", swing(10.0, seed).sample(250.0)), source=f"exact{seed}")


def noisy(recording: Recording, effort: float, position: float = 0.0, seed: int = 5) -> Recording:
    """With white noise [N·m, rad]."""
    rng = np.random.default_rng(seed)
    assert recording.effort is not None
    return replace(
        recording,
        effort=recording.effort + rng.normal(0.0, effort, recording.effort.shape),
        position=recording.position + position * rng.normal(size=recording.position.shape),
    )


def cut(recording: Recording, start: int, stop: int) -> Recording:
    from stadera.logs import take

    return take(recording, slice(start, stop))
