"""The same motion, recorded by IMUs elsewhere on the trunk and turned otherwise, gives the same answer."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stadera.errors import UnknownNameError
from stadera.lab.baselines import ALL_METHODS
from stadera.lab.plant.sensors import IDEAL
from stadera.logs import Recording
from stadera.robot import Robot, load_robot
from stadera.robot.imu import ImuMount, force_at_origin
from stadera.robot.model import Frame
from stadera.trunk import Setup, make_estimator, measurements_of
from walking import Motion, Walk, recorded, walked


@cache
def shaken() -> tuple[Robot, Motion]:
    robot = load_robot("hyq")
    return robot, walked(robot, Walk(seconds=1.2, rate_hz=500.0, period=0.0, tilt=0.1, frequency=1.2))


def elsewhere(seed: int) -> tuple[Robot, ImuMount, Recording]:
    """A robot with one more IMU frame, up to half a metre off and turned at random, and what is read there."""
    robot, motion = shaken()
    rng = np.random.default_rng(seed)
    turn, lever = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3)
    robot = replace(robot, frames={**robot.frames, "elsewhere": Frame(robot.trunk, turn, lever)})
    mount = ImuMount.of(robot, "elsewhere")
    return robot, mount, recorded(robot, motion, IDEAL, mount=mount)


@pytest.mark.parametrize("seed", range(4))
def test_specific_force_comes_back_to_the_origin(seed: int) -> None:
    robot, mount, log = elsewhere(seed)
    _, motion = shaken()
    made = list(measurements_of(log, robot))
    force, omega = (np.array([getattr(m, name) for m in made]) for name in ("specific_force", "angular_velocity"))
    np.testing.assert_allclose(omega, motion.angular_velocity, atol=1e-12)
    found = force_at_origin(force, omega, mount.translation, motion.angular_acceleration)
    np.testing.assert_allclose(found, motion.specific_force, atol=1e-10)
    for k in (0, 100):
        rest = np.cross(motion.angular_acceleration[k], mount.translation)
        np.testing.assert_allclose(made[k].force_at_origin, motion.specific_force[k] + rest, atol=1e-10)


@pytest.mark.parametrize("name", ["walking", "ls", "rls", "kalman"])
@pytest.mark.parametrize("seed", [0, 1])
def test_estimates_do_not_depend_on_the_mount(name: str, seed: int) -> None:
    estimates = []
    for robot, mount, log in (elsewhere(seed), (shaken()[0], None, recorded(*shaken(), IDEAL))):
        estimator = make_estimator(name, Setup(robot, mount=mount), ALL_METHODS)
        for measurement in measurements_of(log, robot):
            estimator.update(measurement)
        estimates.append(estimator.estimate())
    here, there = estimates
    assert here.status is there.status
    seen = there.observed
    np.testing.assert_array_equal(here.observed, seen)
    tolerance = np.array([5e-3 * shaken()[0].mass, 2e-3, 2e-3, 2e-3])  # weights differ a little with the lever
    assert (np.abs(here.value - there.value) < tolerance)[seen].all()


def test_of_two_imus_the_one_below_the_waist_is_the_trunks() -> None:
    assert ImuMount.of(load_robot("g1")).name == "imu_in_pelvis"


def test_an_unknown_frame_lists_each_on_the_trunk_once() -> None:
    robot = load_robot("b1")
    with pytest.raises(UnknownNameError, match=r"^b1: unknown IMU frame 'imu'; valid: trunk, base, ") as given:
        ImuMount.of(robot, "imu")
    assert len(set(given.value.valid)) == len(given.value.valid)
    assert {robot.frames[name].link for name in given.value.valid} == {robot.trunk}
    with pytest.raises(UnknownNameError, match=r"^the log may be of another robot than b1: unknown IMU frame 'imu'"):
        ImuMount.of(robot, None, "imu")


def test_an_imu_above_the_waist_turns_with_it() -> None:
    """H1's is on its torso: with the waist held at half a radian its axes are turned by that."""
    robot = load_robot("h1")
    straight, turned = ImuMount.of(robot), ImuMount.of(robot.posed({"torso_joint": 0.5}))
    turn = Rotation.from_rotvec([0.0, 0.0, 0.5]).as_matrix()
    np.testing.assert_allclose(turned.rotation, turn @ straight.rotation, atol=1e-12)
    np.testing.assert_allclose(turned.translation[2], straight.translation[2], atol=1e-12)
