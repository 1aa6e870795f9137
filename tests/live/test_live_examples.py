"""The programs beside: messages as rosbags makes them, a robot weighed by what the client sends, Python 3.10."""

from __future__ import annotations

import ast
import importlib.util
import subprocess
import sys
import threading
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from on_zenoh import PATIENCE, Listener

import bags
from stadera.live import LiveSession
from stadera.live.link import Endpoints
from stadera.live.run import run
from stadera.logs import LogFile, Recording, Topics
from stadera.robot import Robot

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="module")
def client() -> ModuleType:
    spec = importlib.util.spec_from_file_location("live_client", EXAMPLES / "live_client.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["live_client", "live_rclpy_node"])
def test_they_are_python_of_ros_humble(name: str) -> None:
    ast.parse((EXAMPLES / f"{name}.py").read_text(), feature_version=(3, 10))


def test_messages_are_those_of_ros(client: ModuleType) -> None:
    names, rng = ["a", "longer_joint", "c"], np.random.default_rng(0)
    channels = rng.normal(size=(3, 3))
    assert client.joint_state(12.345678901, names, *channels) == bags.joints(12.345678901, names, *channels).data
    gyro, force = rng.normal(size=(2, 3))
    sent = bags.imu(3.25, gyro, force, frame="imu_link", known=(False, True, True))
    assert client.imu(3.25, gyro, force, "imu_link") == sent.data


def test_a_loop_of_ones_own(
    client: ModuleType, robot: Robot, walk: Recording, endpoint: str, listener: Listener
) -> None:
    """Sent sample by sample, without tokens; the tare is answered."""
    stop, unit = threading.Event(), walk.imu
    assert unit is not None
    session = LiveSession(robot)
    thread = threading.Thread(target=run, args=(session, Endpoints(listen=(endpoint,)), Topics(), stop))
    thread.start()
    try:
        listener.until(lambda state: True)
        own = client.Stadera(endpoint)
        listener.ask("stadera/tare")  # the own session is connected as soon as this one is
        while not own.state:
            stop.wait(0.01)
        for k, t in enumerate(walk.time[:500]):
            joints = (walk.position[k], walk.velocity[k], walk.effort[k])
            own.send(float(t), walk.joints, *joints, unit.angular_velocity[k], unit.linear_acceleration[k])
            stop.wait(0.001)
        listener.until(lambda state: (state["time"] or 0.0) > 1.5 and state["trunk"]["mass"]["value"] is not None)
        assert own.tare()[0]
        own.session.close()
    finally:
        stop.set()
        thread.join(PATIENCE)


def test_the_client_follows_a_replay(robot: Robot, walk_file: Path, endpoint: str) -> None:
    stop = threading.Event()
    where = (Endpoints(listen=(endpoint,)), Topics())
    replayed = {"log": LogFile(walk_file), "rate": 0.5}
    thread = threading.Thread(target=run, args=(LiveSession(robot), *where, stop), kwargs=replayed)
    thread.start()
    command = [sys.executable, str(EXAMPLES / "live_client.py"), endpoint, "4"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    stop.set()
    thread.join(PATIENCE)
    assert done.returncode == 0, done.stderr
    assert "kg, trust: " in done.stdout
