"""A robot in another process, over Zenoh on loopback: as rmw_zenoh and as zenoh-bridge-ros2dds publish it."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from on_zenoh import PATIENCE, Listener, Publish

from bags import TYPES
from stadera.live import LiveSession, keys
from stadera.live.link import Endpoints
from stadera.live.messages import TRIGGER_HASH, type_hash
from stadera.live.run import run
from stadera.logs import Recording, Topics, read
from stadera.robot import Robot
from stadera.robot.imu import ImuMount
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.samples import Samples
from stadera.weigh.weigh import weigh

INERTIA = "geometry_msgs/msg/InertiaStamped"


@pytest.fixture
def live(robot: Robot, endpoint: str) -> Iterator[LiveSession]:
    """A session that listens; ended at the end of the test."""
    session, stop = LiveSession(robot, imu_frame=ImuMount.of(robot).name), threading.Event()
    thread = threading.Thread(target=run, args=(session, Endpoints(listen=(endpoint,)), Topics(), stop))
    thread.start()
    yield session
    stop.set()
    thread.join(PATIENCE)
    assert not thread.is_alive()


def played(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    assert process.stdout.readline() == "done\n"


def body(sample: Any) -> Any:
    """A geometry_msgs/InertiaStamped."""
    return TYPES.deserialize_cdr(sample.payload.to_bytes(), INERTIA)


@pytest.mark.parametrize("kind", ["ros", "bridge"])
def test_all_arrives_and_gives_what_the_log_gives(
    kind: str, live: LiveSession, listener: Listener, publish: Publish, walk: Recording
) -> None:
    played(publish(kind, "--how", "connect", "--rate", 2, "--stay"))
    state = listener.until(lambda state: state["time"] is not None and state["time"] > walk.time[-1] - 0.005)
    assert not any(state["lost"].values())
    expected = TrunkEstimator(live.robot)
    expected.add(Samples.of_recording(walk, live.robot))
    assert state["trunk"]["mass"]["value"] == pytest.approx(expected.trunk.inertial.mass, rel=1e-9)
    assert [c["noticed"] for c in state["changes"]] == [c.noticed for c in expected.changes]
    sent = body(listener.last["stadera/trunk"])
    assert sent.header.frame_id == live.robot.trunk
    assert sent.inertia.m == pytest.approx(expected.trunk.inertial.mass, rel=1e-9)
    tensor, six = expected.trunk.inertial.inertia_com, sent.inertia
    assert [six.ixx, six.ixy, six.ixz, six.iyy, six.iyz, six.izz] == pytest.approx(
        [*tensor[0], *tensor[1, 1:], tensor[2, 2]], rel=1e-6, abs=1e-9
    )
    _answers(kind, listener)


def _answers(kind: str, listener: Listener) -> None:
    """A tare in the way of either; the payload follows."""
    if kind == "bridge":
        reply = listener.ask("stadera/tare", payload=b"\0\1\0\0\0")
        assert not any("dds_" in key for key in listener.last)
    else:
        client = keys.attachment(keys.Sent(7, 1, b"c" * 16))
        key = keys.topic_key(0, "stadera/tare", "std_srvs/srv/Trigger", TRIGGER_HASH)
        reply = listener.ask(key, payload=b"\0\1\0\0\0", attachment=client)
        answered = keys.read_attachment(reply.attachment.to_bytes())
        assert answered is not None
        assert (answered.sequence, answered.publisher) == (7, b"c" * 16)
        trunk = listener.last[keys.topic_key(0, "stadera/trunk", INERTIA, type_hash(INERTIA))]
        assert keys.read_attachment(trunk.attachment.to_bytes()) is not None
        assert body(trunk).inertia.m > 0.0
    assert reply.payload.to_bytes()[4] == 1
    listener.until(lambda state: state["payload"] is not None)
    assert listener.ask("stadera/reset").payload.to_bytes()[4] == 1
    listener.until(lambda state: state["payload"] is None and state["trunk"]["mass"]["value"] is None)


def test_a_robot_that_is_killed_and_comes_back(live: LiveSession, listener: Listener, publish: Publish) -> None:
    """Its stamps begin anew; meanwhile the state says what it waits for, and what was known stays known."""
    listener.until(lambda state: "joint states" in state["waiting_for"][0])
    first = publish("bridge", "--how", "connect")
    known = listener.until(lambda state: (state["time"] or 0.0) > 1.0)
    first.kill()
    listener.until(lambda state: any("have stopped" in lacking for lacking in state["waiting_for"]))
    publish("bridge", "--how", "connect")
    later = listener.until(lambda state: state["time"] > known["time"] + 1.5 and not state["waiting_for"])
    assert later["trunk"]["mass"]["std"] < 1.05 * known["trunk"]["mass"]["std"]
    assert any("clock" in note for note in later["notes"])


def test_the_command_records_all_and_ends_cleanly(
    robot: Robot, endpoint: str, listener: Listener, publish: Publish, tmp_path: Path
) -> None:
    """LowState, whose stamps are those of the bridge: the recording, weighed, gives what was sent last."""
    record = tmp_path / "out.mcap"
    command = [sys.executable, "-m", "stadera", "live", "--robot", "hyq", "--listen", endpoint, "--record", str(record)]
    process = subprocess.Popen([*command, "--rrd", str(tmp_path / "out.rrd")], stdout=subprocess.PIPE, text=True)
    try:
        played(publish("lowstate", "--how", "connect", "--stay"))
        listener.until(lambda state: any("have stopped" in lacking for lacking in state["waiting_for"]))
        process.send_signal(signal.SIGTERM)
        out, _ = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert process.returncode == 0
    assert "samples arrive" in out
    assert "\ntrunk " in out
    assert len(read(record)) == 850
    last = body(listener.last["stadera/trunk"]).inertia
    trunk = weigh(robot, record).trunk.inertial
    np.testing.assert_allclose([last.m, last.com.x, last.com.y, last.com.z], [trunk.mass, *trunk.com], rtol=1e-9)
    assert (tmp_path / "out.rrd").stat().st_size > 10_000


def test_nobody_there(robot: Robot, endpoint: str) -> None:
    """Nothing to connect to: the session waits, and ends when it is told to."""
    stop = threading.Event()
    threading.Timer(1.0, stop.set).start()
    begun = time.monotonic()
    state = run(LiveSession(robot), Endpoints(connect=(endpoint,)), Topics(), stop)
    assert state.waiting_for
    assert time.monotonic() - begun < PATIENCE
