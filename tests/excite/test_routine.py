"""The weighing routine: its dynamics against Pinocchio, its promise against drawn robots, its scripts against stubs."""

from __future__ import annotations

import runpy
import subprocess
import sys
import time
import types
from base64 import b64decode
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from stadera.constants import GRAVITY
from stadera.errors import IdentificationError, UnknownNameError
from stadera.excite.sinusoids import Sinusoids
from stadera.excite.trunk.design import RoutineSettings, weighing_routine
from stadera.excite.trunk.planted import AXES, Drawn, Planted
from stadera.excite.trunk.result import INTERFACES, Routine, player
from stadera.inertia import InertialParameters
from stadera.lab.pinocchio import pinocchio_model
from stadera.report.excite.trunk import film
from stadera.robot import load_robot
from stadera.trunk import TrunkEstimator


def path_of(robot: str, size: float = 1.0) -> Planted:
    model, rng = load_robot(robot), np.random.default_rng(3)
    largest = size * np.array([0.08, 0.06, 0.1, 0.02, 0.02, 0.015])
    amplitudes = np.repeat(0.5 * largest[None, :, None], 2, axis=2)
    frequencies, phases = rng.uniform(0.5, 1.5, (1, 6, 2)), rng.uniform(0.0, 6.0, (1, 6, 2))
    path = Sinusoids(AXES, np.zeros(6), np.zeros((1, 6)), amplitudes, frequencies, phases, np.array([0.0, 2.5]), 0.5)
    return Planted.of(model, path, 200.0)


@pytest.mark.parametrize("name", ["hyq", "go2", "g1"])
def test_torques_and_forces_are_those_of_pinocchio(name: str) -> None:
    planted = path_of(name)
    robot, motion = planted.robot, planted.motion
    load = InertialParameters.from_com(0.1 * robot.mass, (0.05, -0.02, 0.1), 0.01 * np.eye(3))
    torque, force = planted.torques(robot.inertias[robot.trunk] + load)
    model = pinocchio_model(robot)
    model.inertias[1] += load.to_pinocchio()
    data = model.createData()
    turn = Rotation.from_euler("ZYX", planted.pose[:, [2, 1, 0]])
    shift = planted.pose[:, 3:]
    speed, push = (np.gradient(values, planted.time, axis=0, edge_order=2) for values in (shift, shift))
    push = np.gradient(speed, planted.time, axis=0, edge_order=2)
    feet, before = [], None
    for k in range(40, len(planted.time) - 40, 50):
        q = np.concatenate([shift[k], turn[k].as_quat(), motion.position[k]])
        R = turn[k].as_matrix()
        v = np.concatenate([R.T @ speed[k], motion.angular_velocity[k], motion.velocity[k]])
        linear = R.T @ push[k] - np.cross(motion.angular_velocity[k], v[:3])
        a = np.concatenate([linear, motion.angular_acceleration[k], motion.acceleration[k]])
        model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
        needed = np.array(pin.rnea(model, data, q, v, a))
        own = np.concatenate([force[k].sum(axis=0), np.zeros(3)])
        np.testing.assert_allclose(needed[:3], own[:3], atol=2e-3 * robot.mass * GRAVITY)
        if all(leg.contact == 3 for leg in robot.legs):
            moment = np.cross(planted.contacts[k], force[k]).sum(axis=0)
            np.testing.assert_allclose(needed[3:6], moment, atol=2e-3 * robot.mass * GRAVITY)
            pin.computeJointJacobians(model, data, q)
            total = needed[6:].copy()
            for leg, f, at in zip(robot.legs, force[k], planted.contacts[k], strict=True):
                joint = model.getJointId(leg.joints[-1])
                J = np.array(pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED))
                J = J[:3] - pin.skew(R @ at + shift[k] - data.oMi[joint].translation) @ J[3:]
                total -= J[:, 6:].T @ (R @ f)
            friction = np.array([robot.dynamics[joint].viscous for joint in robot.tree.joints]) * motion.velocity[k]
            np.testing.assert_allclose(torque[k] - friction, total, atol=1e-3 * robot.mass * GRAVITY * robot.leg_length)
        pin.framesForwardKinematics(model, data, q)
        feet = [data.oMi[model.getJointId(leg.joints[-1])].act(np.array(leg.foot_position)) for leg in robot.legs]
        if before is not None:
            np.testing.assert_allclose(feet, before, atol=1e-5)
        before = feet


@pytest.fixture(scope="module")
def routine() -> Routine:
    return weighing_routine("go2", RoutineSettings(axes=("roll", "pitch", "yaw", "z"), draws=3, steps=3, drawn=2))


def test_robots_that_were_not_drawn_are_weighed_as_promised(routine: Routine) -> None:
    assert routine.expected.mass < 0.05
    assert max(routine.expected.com[:2]) < 0.01
    robot, load = routine.robot, InertialParameters.from_com(1.3, (0.06, -0.03, 0.08), 0.004 * np.eye(3))
    bars, apart = [], []
    for seed in range(4):
        drawn = Drawn(robot, np.random.default_rng((77, seed)))
        planted = Planted.of(drawn.true, routine.path, 250.0)
        estimator = TrunkEstimator(robot)
        estimator.add(drawn.measured(planted))
        estimator.tare()
        for sample in (drawn.measured(planted, load),):
            estimator.restart()
            estimator.add(sample.__class__(sample.time + 6.0, *list(vars(sample).values())[1:]))
        payload = estimator.payload
        assert payload is not None
        assert payload.mass_std_without_scale is not None
        bars.append([payload.mass_std_without_scale, *payload.com_std[:2]])
        apart.append((payload.mass - 1.3) / payload.mass_std)
    ratio = np.median(bars, axis=0) / [routine.expected.mass, *routine.expected.com[:2]]
    assert ((ratio > 1 / 1.7) & (ratio < 1.7)).all(), ratio
    assert np.abs(apart).max() < 3.0


def test_the_film_shows_feet_that_stay_in_place_and_a_trunk_that_does_not(routine: Routine) -> None:
    shown = film(routine)
    assert shown["count"] * shown["interval"] == pytest.approx(routine.settings.seconds, abs=2.0 * shown["interval"])
    for view in shown["views"]:
        numbers = np.frombuffer(b64decode(view["corners"]), "<i2").reshape(shown["count"], len(view["colours"]), 24, 2)
        moved = np.ptp(numbers, axis=0).max(axis=(1, 2))  # [mm], of each part's corners
        parts = np.array(view["colours"])
        assert (parts == "foot").sum() == len(routine.robot.legs)
        assert moved[parts == "foot"].max() < 2.0
        assert moved[parts == "shell"].min() > 5.0


def test_a_heavy_load_slips_no_foot_and_exceeds_no_limit(routine: Routine) -> None:
    robot = routine.robot
    load = InertialParameters.from_com(0.2 * robot.mass, (0.0, 0.0, 0.08), 0.004 * np.eye(3))
    torque, force = routine.planted.torques(robot.inertias[robot.trunk] + load)
    normal = (force * routine.planted.motion.normal[:, None]).sum(axis=2)
    assert (normal > 0.0).all()
    assert (np.linalg.norm(force, axis=2) < normal * np.hypot(1.0, 0.55)).all()
    limits = [robot.limits[joint] for joint in robot.tree.joints]
    assert (np.abs(torque).max(axis=0) < [limit.effort for limit in limits]).all()
    assert (routine.planted.motion.position > [limit.lower for limit in limits]).all()
    assert (routine.planted.motion.position < [limit.upper for limit in limits]).all()


class Stub:
    """A robot's interface that takes everything and remembers poses; `fails` after so many commands."""

    def __init__(self, fails: int | None) -> None:
        self.poses: list[tuple[float, ...]] = []
        self.fails, self.stopped = fails, False

    def take(self, *pose: float) -> int:
        self.poses.append(pose)
        return 0 if self.fails is None or len(self.poses) < self.fails else 3104

    def modules(self, name: str) -> dict[str, types.ModuleType]:
        stub = self
        if name == "unitree":

            class SportClient:
                def SetTimeout(self, seconds: float) -> None: ...
                def Init(self) -> None: ...
                def BalanceStand(self) -> int:
                    return 0

                def BodyHeight(self, height: float) -> int:
                    return 0

                def StopMove(self) -> int:
                    stub.stopped = True
                    return 0

                def Euler(self, roll: float, pitch: float, yaw: float) -> int:
                    return stub.take(roll, pitch, yaw)

            parts: dict[str, dict[str, Any]] = {
                "unitree_sdk2py.core.channel": {"ChannelFactoryInitialize": lambda domain, interface: None},
                "unitree_sdk2py.go2.sport.sport_client": {"SportClient": SportClient},
            }
        elif name == "spot":

            class Command:
                default_service_name = "command"

                def robot_command(self, command: Any, end_time_secs: float) -> None:
                    if stub.take(*command):
                        raise RuntimeError("lease revoked")

            class Lease:
                default_service_name = "lease"

            robot = types.SimpleNamespace(
                time_sync=types.SimpleNamespace(wait_for_sync=lambda: None),
                ensure_client=lambda service: Command() if service == "command" else Lease(),
                is_powered_on=lambda: True,
            )
            sdk = types.SimpleNamespace(create_robot=lambda host: robot)

            class KeepAlive:
                def __init__(self, *arguments: Any, **options: Any) -> None: ...
                def __enter__(self) -> None: ...
                def __exit__(self, *error: Any) -> None:
                    stub.stopped = True

            def stand(body_height: float, footprint_R_body: Any) -> Any:
                zxy = [footprint_R_body.yaw, footprint_R_body.roll, footprint_R_body.pitch]
                yaw, pitch, roll = Rotation.from_euler("ZXY", zxy).as_euler("ZYX").tolist()
                return (roll, pitch, yaw, body_height)

            parts = {
                "bosdyn.client": {"create_standard_sdk": lambda named: sdk},
                "bosdyn.client.lease": {"LeaseClient": Lease, "LeaseKeepAlive": KeepAlive},
                "bosdyn.client.robot_command": {
                    "RobotCommandBuilder": types.SimpleNamespace(synchro_stand_command=stand),
                    "RobotCommandClient": Command,
                    "blocking_stand": lambda command, timeout_sec: None,
                },
                "bosdyn.client.util": {"authenticate": lambda robot: None},
                "bosdyn.geometry": {"EulerZXY": types.SimpleNamespace},
            }
        else:

            class Pose:
                def __init__(self) -> None:
                    self.position, self.orientation = types.SimpleNamespace(), types.SimpleNamespace()

            def publish(pose: Any) -> None:
                turned = Rotation.from_quat([getattr(pose.orientation, axis) for axis in "xyzw"])
                yaw, pitch, roll = turned.as_euler("ZYX").tolist()
                stub.take(roll, pitch, yaw)

            def count() -> int:
                return 0 if stub.fails is not None and len(stub.poses) >= stub.fails else 1

            topic = types.SimpleNamespace(publish=publish, get_subscription_count=count)

            def close() -> None:
                stub.stopped = True

            node = types.SimpleNamespace(create_publisher=lambda *a: topic, destroy_node=close)
            parts = {
                "rclpy": {"init": lambda **o: None, "shutdown": lambda: None, "create_node": lambda name: node},
                "rclpy.signals": {"SignalHandlerOptions": types.SimpleNamespace(NO=0)},
                "geometry_msgs.msg": {"Pose": Pose},
            }
        made: dict[str, types.ModuleType] = {}
        for dotted, names in parts.items():
            for end in range(1, dotted.count(".") + 2):
                part = ".".join(dotted.split(".")[:end])
                made.setdefault(part, types.ModuleType(part))
            vars(made[dotted]).update(names)
        for dotted, module in made.items():
            parent, _, last = dotted.rpartition(".")
            if parent:
                setattr(made[parent], last, module)
        return made


def played(name: str, routine: Routine, stub: Stub, monkeypatch: pytest.MonkeyPatch, folder: Path) -> str:
    """Runs a script with a stub of its interface and a clock that runs as fast as it is asked; how it ended."""
    path = folder / "play.py"
    path.write_text(player(routine, name), encoding="utf-8")
    for dotted, module in stub.modules(name).items():
        monkeypatch.setitem(sys.modules, dotted, module)
    now = [0.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds

    monkeypatch.setattr(time, "sleep", sleep)
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(sys, "argv", ["play.py", "robot"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(path), run_name="__main__")
    return str(ended.value.code)


@pytest.mark.parametrize("name", INTERFACES)
@pytest.mark.parametrize("fails", [None, 30])
def test_a_script_plays_the_motion_and_goes_back_on_a_fault(
    name: str, fails: int | None, routine: Routine, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    stub = Stub(fails)
    ended = played(name, routine, stub, monkeypatch, tmp_path)
    monkeypatch.undo()
    poses, rate = np.array(stub.poses)[:, :3], INTERFACES[name].rate
    assert ended == "0" if fails is None else ended.startswith("stopped: ")
    if name != "spot" or fails is None:  # a Spot whose lease is gone takes no more commands
        np.testing.assert_allclose(poses[-1], 0.0, atol=1e-9)
        assert stub.stopped
    reference = routine.path.sample(rate)
    fastest = 1.2 * np.abs(reference.velocity[:, :3]).max(axis=0) + 0.011
    assert (np.abs(np.diff(poses, axis=0)) * rate <= fastest).all()
    if fails is None:
        np.testing.assert_allclose(poses[: len(reference)], reference.position[:, :3], atol=1e-3)


def test_a_second_interruption_stops_the_way_back(
    routine: Routine, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    stub = Stub(None)
    take, poses = stub.take, stub.poses

    def interrupted(*pose: float) -> int:
        take(*pose)
        if len(poses) in (20, 22):
            raise KeyboardInterrupt
        return 0

    monkeypatch.setattr(stub, "take", interrupted)
    ended = played("unitree", routine, stub, monkeypatch, tmp_path)
    assert "on the way back" in ended
    assert len(poses) == 22
    assert stub.stopped


def test_bad_requests_are_named(routine: Routine, run: Any) -> None:
    with pytest.raises(UnknownNameError, match="interface 'anymal'"):
        player(None, "anymal")  # type: ignore[arg-type]
    moved = replace(routine.path, amplitudes=routine.path.amplitudes + 0.01)
    with pytest.raises(IdentificationError, match="spot does not move x, y"):
        player(replace(routine, path=moved), "spot")
    with pytest.raises(IdentificationError, match="axes are of roll, pitch"):
        RoutineSettings(axes=("roll", "w"))
    with pytest.raises(IdentificationError, match="2 s at least"):
        RoutineSettings(seconds=1.0)
    for asked in ((), ("--leg", "LF", "--trunk")):
        ended = run("excite", "--robot", "hyq", *asked)
        assert ended.code == 2
        assert "--trunk" in ended.err


def test_a_drawn_robot_loses_torque_by_what_its_joints_carry() -> None:
    drawn, planted = Drawn(load_robot("go2"), np.random.default_rng(3)), path_of("go2")
    whole = drawn.measured(planted).effort
    drawn._p = dict(drawn._p) | {"load_friction": 0.0 * drawn._p["load_friction"]}
    carried = drawn.measured(planted).effort  # the noise is the same
    lost, rate = (whole - carried)[100:-100], planted.motion.velocity[100:-100]
    sliding = np.abs(rate) > 0.2
    share = np.abs(lost[sliding]) / np.abs(carried[100:-100][sliding])
    assert (np.sign(lost[sliding]) == np.sign(rate[sliding])).mean() > 0.95
    assert 0.01 < np.median(share) < 0.15


@pytest.mark.parametrize("name", INTERFACES)
def test_a_script_says_what_it_is_without_the_robots_package(name: str, routine: Routine) -> None:
    ran = subprocess.run([sys.executable, "-", "--help"], input=player(routine, name), capture_output=True, text=True)
    assert ran.returncode == 1
    assert ran.stderr.startswith("Weighing routine of ")
    assert "is needed" in ran.stderr
    assert "Traceback" not in ran.stderr
