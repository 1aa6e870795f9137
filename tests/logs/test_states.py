"""Joints' states in messages of other types, and bags of several robots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from bags import OLD_LOW_STATE, OTHERS, STATES, Sent, imu, joints, states, write_folder, write_mcap
from stadera.errors import RecordingError
from stadera.logs import LogFile, Topics, read

NAMES = ("LF_HAA", "LF_HFE", "rear/left_knee"[5:])
TIMES = [5.0 + 0.002 * k for k in range(60)]


def sent(kind: str) -> list[Sent]:
    own = np.array([1.0, 2.0, 3.0])
    return [states(kind, t, NAMES, own * t, own, -own * t) for t in TIMES]


@pytest.mark.parametrize("kind", [*STATES, *(kind for kind in OTHERS if kind != OLD_LOW_STATE)])
def test_states_are_found_by_the_names_of_fields(tmp_path: Path, kind: str) -> None:
    for path in (
        write_mcap(sent(kind), tmp_path / "x.mcap"),
        write_folder(sent(kind), tmp_path / "bag", StoragePlugin.SQLITE3),
    ):
        log = read(path, joints=NAMES, require=("effort",))
        np.testing.assert_allclose(log.position, np.outer(TIMES, [1, 2, 3]), atol=1e-12)
        np.testing.assert_allclose(log.effort, -np.outer(TIMES, [1, 2, 3]), atol=1e-12)
        np.testing.assert_allclose(log.time, TIMES, atol=1e-9)
        assert (log.velocity is None) == ("Statistics" in kind)
        assert any(f"joints read from /state ({kind})" in note for note in log.notes)


def test_a_joint_state_is_preferred_and_others_can_be_chosen(tmp_path: Path) -> None:
    usual = [joints(t, NAMES, (t, t, t)) for t in TIMES]
    path = write_mcap([*usual, *sent("control_msgs/msg/DynamicJointState")], tmp_path / "x.mcap")
    assert read(path).effort is None
    assert read(LogFile(path, Topics(joint="/state"))).effort is not None


def test_a_robot_of_several_is_chosen_by_its_topic(tmp_path: Path) -> None:
    mixed = [
        message
        for t in TIMES
        for k, name in enumerate(("a", "b"))
        for message in (
            joints(t, NAMES, (k, k, k), topic=f"/{name}/joint_states"),
            imu(t, (k, 0, 0), topic=f"/{name}/imu/data"),
        )
    ]
    path = write_mcap(mixed, tmp_path / "x.mcap")
    with pytest.raises(RecordingError, match=r"/a/joint_states \(.*500 Hz, 3 joints\), /b/joint_states \(.*500 Hz"):
        read(path, joints=NAMES)
    for k, name in enumerate(("a", "b")):
        log = read(LogFile(path, Topics(joint=f"/{name}/joint_states")), joints=NAMES, require=("imu",))
        assert log.imu is not None
        assert (log.imu.angular_velocity[:, 0] == k).all()
        assert any(f"IMU from /{name}/imu/data" in note for note in log.notes)


def test_robots_of_other_joints_are_told_apart(tmp_path: Path) -> None:
    arm = [joints(t, ("elbow",), (1.0,), topic="/arm/joint_states") for t in TIMES]
    dog = [joints(t, NAMES, (1.0, 2.0, 3.0), topic="/dog/joint_states") for t in TIMES]
    log = read(write_mcap([*arm, *dog], tmp_path / "x.mcap"), joints=NAMES)
    assert len(log) == len(TIMES)
    assert any("other topics of joints: /arm/joint_states; --joint-topic chooses" in note for note in log.notes)


def test_an_imu_of_another_robot_is_not_taken(tmp_path: Path) -> None:
    both = [joints(t, NAMES, (1.0, 2.0, 3.0), topic=f"/{name}/joint_states") for t in TIMES for name in "ab"]
    units = [imu(t, topic="/b/imu") for t in TIMES]
    path = write_mcap([*both, *units], tmp_path / "x.mcap")
    assert read(LogFile(path, Topics(joint="/a/joint_states"))).imu is None
    assert read(LogFile(path, Topics(joint="/b/joint_states"))).imu is not None
