"""Refusals; measurements of any layout."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stadera.body import Body
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.robot.stance import standing_configuration
from stadera.trunk import Samples, TrunkEstimator, TrunkSettings
from stadera.trunk.front import Front
from stadera.trunk.measurement import Measurement

MOUNT = ImuMount(np.eye(3), np.array([0.1, -0.05, 0.07]), "imu")
MOUNT.translation.setflags(write=False)


@cache
def robot(name: str, dry: bool = True) -> Robot:
    plain = load_robot(name)
    if not dry:
        return plain
    return plain.with_dynamics({joint: JointDynamics(0.02, 0.3, 0.5, 0.1) for joint in plain.tree.joints})


@cache
def samples(name: str, rate: float, seed: int) -> Samples:
    """Random waves of all channels, with noise and a stamp that jitters."""
    made, rng = robot(name), np.random.default_rng(seed)
    n = 600
    time = (np.arange(n) + 0.1 * rng.uniform(size=n)) / rate

    def waves(channels: int, size: float) -> np.ndarray:
        phase = 2.0 * np.pi * time[:, None] * rng.uniform(0.5, 3.0, channels) + rng.uniform(0.0, 6.0, channels)
        return size * np.sin(phase)

    position = standing_configuration(made) + waves(len(made.tree.joints), 0.2)
    velocity = np.gradient(position, time, axis=0) + 0.02 * rng.standard_normal(position.shape)
    effort = waves(len(made.tree.joints), 0.4 * made.mass) + 0.3 * rng.standard_normal(position.shape)
    force = np.array([0.0, 0.0, 9.81]) + waves(3, 1.0) + 0.05 * rng.standard_normal((n, 3))
    return Samples(time, position, velocity, effort, waves(3, 0.5) + 0.003 * rng.standard_normal((n, 3)), force)


def test_blocks_are_refused() -> None:
    made, data = robot("hyq"), samples("hyq", 500.0, 0)
    position, force = data.position.copy(), data.specific_force.copy()
    position[10:, list(Body.of(made).legs[2])] = 0.0
    force[5] = 0.0
    table = replace(data, position=position, specific_force=force).table
    maker = Front(made, MOUNT, TrunkSettings())
    noise = maker._maker.noise.variance
    zero, stretched = maker.blocks(table[:22], (10, 10))
    assert "accelerometer reads zero" in zero.refusal
    assert f"leg {made.legs[2].name} is so stretched" in stretched.refusal
    np.testing.assert_array_equal(maker._maker.noise.variance, noise)


def test_measurements_of_any_layout_count_alike() -> None:
    """Also strided and read-only ones."""
    made, data = robot("hyq"), samples("hyq", 500.0, 2)

    def learnt(extra: Callable[[np.ndarray], np.ndarray]) -> TrunkEstimator:
        estimator = TrunkEstimator(made)
        for k in range(60):
            channels = (data.position, data.velocity, data.effort, data.angular_velocity, data.specific_force)
            estimator.update(Measurement(float(data.time[k]), *(extra(channel[k]) for channel in channels)))
        return estimator

    def read_only(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values.setflags(write=False)
        return values

    expected = learnt(np.copy)._history.current.triangle
    for change in (lambda values: np.repeat(values, 2)[::2], read_only):
        np.testing.assert_array_equal(learnt(change)._history.current.triangle, expected)


def test_a_measurement_of_another_size_is_refused() -> None:
    estimator, data = TrunkEstimator(robot("hyq")), samples("hyq", 500.0, 2)
    short = Measurement(0.0, data.position[0], data.velocity[0, :-1], data.effort[0], np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match=r"\w"):
        estimator.update(short)
