"""An arm on the trunk that moves as the log says, against Pinocchio's dynamics of the whole tree."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from arm import with_arm
from stadera.inertia import InertialParameters
from stadera.lab.plant.sensors import IDEAL
from stadera.live.session import LiveSession
from stadera.logs import Imu, Recording, stream, take, write_table
from stadera.robot import Robot, load_robot
from stadera.robot.export import export_model
from stadera.robot.stance import standing_configuration
from stadera.trunk import TrunkEstimator
from stadera.trunk.settings import ModelErrors, TrunkSettings
from stadera.weigh import Weighing, weigh
from stadera.weigh.settings import WeighSettings
from standing import GRAVITY, StandingRobot
from walking import Walk, recorded, walked

LOAD = InertialParameters.from_com(1.5, [0.05, 0.03, 0.1], 0.01 * np.eye(3))
TARED = 2.0  # s
WALK = Walk(seconds=4.5, rate_hz=250.0, load=LOAD, loaded_at=2.2)


def arm(time: np.ndarray) -> np.ndarray:
    """A lidar on its rail, shoulder and elbow, in the order of the robot's `extra`."""
    waves = [np.sin(2.0 * np.pi * rate * time + phase) for rate, phase in ((0.7, 0.0), (0.8, 1.0), (1.1, 2.0))]
    return np.array([0.05, 0.5, -0.7]) + np.array([0.05, 0.9, 0.8]) * np.column_stack(waves)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return with_arm("go2", tmp_path_factory.mktemp("arm"))


@cache
def log_of(robot: Robot) -> Recording:
    """Joints of the legs, then of arm and lidar, whose torques are not known."""
    motion = walked(robot, WALK, arm=arm)
    legs, extra = recorded(robot, motion, IDEAL), robot.extra
    assert extra is not None
    q, step = arm(motion.time), 1e-5
    qd = (arm(motion.time + step) - arm(motion.time - step)) / (2.0 * step)
    assert legs.velocity is not None
    assert legs.effort is not None
    return replace(
        legs,
        joints=(*legs.joints, *extra.joints),
        position=np.hstack([legs.position, q]),
        velocity=np.hstack([legs.velocity, qd]),
        effort=np.hstack([legs.effort, np.zeros_like(q)]),
    )


@cache
def weighed(robot: Robot) -> Weighing:
    return weigh(robot, log_of(robot), tare=(0.0, TARED))


# drives without friction, as this plant's are
FREE = WeighSettings(trunk=TrunkSettings(model=ModelErrors(coulomb=1e-4, load_friction=0.0)))


def legs_alone(log: Recording) -> Recording:
    assert log.velocity is not None
    assert log.effort is not None
    channels = {name: getattr(log, name)[:, :12] for name in ("position", "velocity", "effort")}
    return replace(log, joints=log.joints[:12], **channels)


def trunk_at_the_beginning(robot: Robot, log: Recording) -> InertialParameters:
    posed = robot.posed(dict(zip(log.joints[12:], log.position[0, 12:].tolist(), strict=True)))
    return posed.inertias[posed.trunk] + LOAD


@pytest.mark.parametrize("velocities", [True, False])
def test_an_arm_that_moves_disturbs_neither_trunk_nor_payload(robot: Robot, velocities: bool) -> None:
    log = log_of(robot)
    found = weighed(robot) if velocities else weigh(robot, replace(log, velocity=None), tare=(0.0, TARED))
    true = trunk_at_the_beginning(robot, log)
    assert found.trust.verdict == "good"
    assert found.mass == pytest.approx(true.mass, abs=0.02 if velocities else 0.04)
    np.testing.assert_allclose(found.com, true.com, atol=2e-3)
    assert found.payload is not None
    assert found.payload.mass == pytest.approx(LOAD.mass, abs=0.02)
    np.testing.assert_allclose(found.payload.com[:2], LOAD.com[:2], atol=3e-3)
    (note,) = [note for note in found.notes if "of no leg" in note]
    assert note.startswith("joints lift, shoulder, elbow of no leg: they move as recorded")
    assert "0.05, 1.26, 0.027" in note


def test_without_the_arms_joints_it_is_said_and_the_bars_contain_it(robot: Robot) -> None:
    found, true = (
        weigh(robot, legs_alone(log_of(robot)), tare=(0.0, TARED)),
        trunk_at_the_beginning(robot, log_of(robot)),
    )
    known = weighed(robot)
    assert abs(found.mass - true.mass) < 2.0 * found.mass_std
    assert found.payload is not None
    assert known.payload is not None
    assert abs(found.payload.mass - LOAD.mass) < 2.0 * found.payload.mass_std
    assert found.payload.at == ""  # an arm that is not recorded is no place of a load: so the bar is less than of two
    assert found.payload.mass_std > 1.5 * known.payload.mass_std
    assert "joints lift, shoulder, elbow of no leg: not in recording, held at the model's zero" in found.notes


def test_a_table_gives_the_same_whether_or_not_it_has_the_arms_torques(robot: Robot, tmp_path: Path) -> None:
    log = take(log_of(robot), slice(0, 400))
    path = tmp_path / "log.csv"
    write_table(log, path)
    lines = path.read_text().splitlines()
    kept = [k for k, name in enumerate(lines[0].split(",")) if name != "elbow.effort"]
    path.write_text("\n".join(",".join(line.split(",")[k] for k in kept) for line in lines))
    found, same = weigh(robot, path), weigh(robot, log)
    assert found.mass == pytest.approx(same.mass, abs=1e-3)
    assert any("they move as recorded" in note for note in found.notes)


def test_inspect_says_what_becomes_of_the_arm(run, robot: Robot, tmp_path: Path) -> None:
    log = take(log_of(robot), slice(0, 500))
    whole, path = tmp_path / "whole.csv", tmp_path / "log.csv"
    write_table(log, whole)
    lines = whole.read_text().splitlines()
    idle = [f"{joint}.effort" for joint in log.joints[12:]]
    kept = [k for k, name in enumerate(lines[0].split(",")) if name not in idle]
    path.write_text("\n".join(",".join(line.split(",")[k] for k in kept) for line in lines))
    shown = " ".join(run("inspect", path, "--robot", robot.source).out.split())
    assert "left out joints of no leg that have no torque: lift, shoulder, elbow" in shown
    assert "joints lift, shoulder, elbow of no leg: they move as recorded" in shown
    assert "nothing wrong was found" in shown
    write_table(legs_alone(log), path.with_suffix(".parquet"))
    shown = " ".join(run("inspect", path.with_suffix(".parquet"), "--robot", robot.source).out.split())
    assert "of no leg: not in log.parquet, held at the model's zero" in shown


def test_the_estimator_takes_the_arms_joints(robot: Robot) -> None:
    log = log_of(robot)
    assert log.imu is not None
    assert log.velocity is not None
    assert log.effort is not None
    order = np.random.default_rng(0).permutation(len(log.joints))
    estimator = TrunkEstimator(robot, joints=[log.joints[k] for k in order])
    for k in range(np.searchsorted(log.time, TARED)):
        q, dq, tau = (x[k, order] for x in (log.position, log.velocity, log.effort))
        estimator.update(log.time[k], q, dq, tau, log.imu.angular_velocity[k], log.imu.linear_acceleration[k])
    trunk = robot.inertias[robot.trunk]  # with the arm at the model's zero
    assert estimator.trust.verdict == "good"
    assert estimator.trunk.inertial.mass == pytest.approx(trunk.mass, abs=0.05)
    np.testing.assert_allclose(estimator.trunk.com, trunk.com, atol=3e-3)


def test_at_rest_an_arm_parked_elsewhere_after_the_tare_is_no_payload(robot: Robot) -> None:
    parked = np.array([[0.0, 0.3, -0.9], [0.1, 1.2, 0.4]])
    extra = robot.extra
    assert extra is not None
    rng = np.random.default_rng(1)
    poses = [dict(zip(extra.joints, pose.tolist(), strict=True)) for pose in parked]
    plants = [StandingRobot(robot, 1.5 * k, (0.05, 0.03, 0.1), pose) for k, pose in enumerate(poses)]
    q = standing_configuration(robot)
    n = 400
    half = n // 2
    effort = np.repeat([plant.efforts(q, np.eye(3)) for plant in plants], half, axis=0)
    log = Recording(
        time=np.arange(n) / 100.0,
        joints=(*robot.tree.joints, *extra.joints),
        position=np.hstack([np.tile(q, (n, 1)), np.repeat(parked, half, axis=0)]) + 1e-4 * rng.normal(size=(n, 15)),
        velocity=1e-2 * rng.normal(size=(n, 15)),
        effort=np.hstack([effort + 1e-2 * rng.normal(size=(n, 12)), np.zeros((n, 3))]),  # the arm's are not known
        imu=Imu(1e-3 * rng.normal(size=(n, 3)), np.array([0, 0, GRAVITY]) + 2e-2 * rng.normal(size=(n, 3))),
    )
    found = weigh(robot, log, tare=(0.0, 1.9), method="standing", settings=FREE)
    assert found.payload is not None
    assert found.payload.mass == pytest.approx(1.5, abs=0.02)
    np.testing.assert_allclose(found.payload.com[:2], LOAD.com[:2], atol=2e-3)
    true = trunk_at_the_beginning(robot, log)
    np.testing.assert_allclose(found.com[:2], true.com[:2], atol=2e-3)


def test_the_exported_model_has_the_weighed_trunk_and_the_arm_as_it_was(robot: Robot, tmp_path: Path) -> None:
    posed = robot.posed({"shoulder": 1.0, "lift": 0.1})
    heavier = posed.with_inertias({posed.trunk: posed.inertias[posed.trunk] + LOAD})
    export_model(heavier, tmp_path / "out.urdf")
    back = load_robot(tmp_path / "out.urdf")
    assert back.extra is not None
    assert robot.extra is not None
    np.testing.assert_allclose(back.inertias[back.trunk].vector, (robot.inertias[robot.trunk] + LOAD).vector, atol=1e-9)
    for one, other in zip(back.extra.bodies, robot.extra.bodies, strict=True):
        np.testing.assert_allclose(one.vector, other.vector, atol=1e-12)


def test_a_live_session_takes_the_arms_joints(robot: Robot) -> None:
    log, session = log_of(robot), LiveSession(robot)
    assert robot.extra is not None
    whole = next(stream(log.with_others(robot.extra.joints), joints=robot.tree.joints))
    for start in range(0, int(np.searchsorted(log.time, TARED)), 25):
        session.add(take(whole, slice(start, start + 25)), 0.0)
    posed = robot.posed(dict(zip(log.joints[12:], log.position[0, 12:].tolist(), strict=True)))
    state = session.state()
    assert state.trust.verdict == "good"
    assert state.trunk.inertial.mass == pytest.approx(posed.inertias[posed.trunk].mass, abs=0.05)
    np.testing.assert_allclose(state.trunk.com, posed.inertias[posed.trunk].com, atol=3e-3)
