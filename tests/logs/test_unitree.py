"""Unitree's LowState: motors by name, the IMU's conventions, stamps by the robot's counter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bags import imu, joints, low_state, old_low_state, write_folder, write_mcap, write_ros1
from stadera.errors import RecordingError
from stadera.logs import LogFile, Recording, Topics, read
from stadera.logs.bags.unitree import LOW_STATES, MOTORS, TickClock
from stadera.robot import load_robot

MS = 1_000_000


def states(count: int = 50, **options: object) -> list:
    motor = np.arange(20)
    return [low_state(1.7e9 + 0.002 * k, motor + k, -motor, 0.5 * motor, tick=2 * k, **options) for k in range(count)]


@pytest.mark.parametrize("kind", LOW_STATES)
def test_motors_by_name_and_the_imu_in_our_order(tmp_path: Path, kind: str) -> None:
    for path in (
        write_mcap(states(kind=kind), tmp_path / "x.mcap"),
        write_folder(states(kind=kind), tmp_path / kind[:10]),
    ):
        log = read(path)
        log = log if kind == LOW_STATES[0] else read(path, joints=MOTORS)
        assert log.joints == MOTORS
        np.testing.assert_array_equal(log.position, np.arange(12) + np.arange(50)[:, None])
        np.testing.assert_array_equal(log.channel("velocity", ("RL_calf_joint", "FR_hip_joint")), [[-11, 0]] * 50)
        np.testing.assert_array_equal(log.channel("effort", ("FL_hip_joint",)), [[1.5]] * 50)
        assert log.imu is not None
        assert log.imu.frame is None
        np.testing.assert_allclose(log.imu.angular_velocity[7], (1, 2, 3))
        np.testing.assert_allclose(log.imu.linear_acceleration[7], (4, 5, 6))
        np.testing.assert_allclose(log.imu.orientation[7], (0.1, 0.7, 0.5, 0.5), rtol=1e-6)  # type: ignore[index]
        np.testing.assert_allclose(np.diff(log.time), 0.002, atol=1e-6)


def test_a_humanoids_motors_are_a_g1s_and_parallel_ankles_are_named(tmp_path: Path) -> None:
    motor = np.arange(35)
    sent = [low_state(1.7e9 + 0.002 * k, motor + k, -motor, 0.5 * motor, 2 * k, LOW_STATES[1]) for k in range(50)]
    robot = load_robot("g1")
    extra = robot.extra
    assert extra is not None
    log = read(write_mcap(sent, tmp_path / "pr.mcap"))
    assert set(log.joints) == {*robot.tree.joints, *extra.joints}
    found = log.channel("effort", ("left_hip_pitch_joint", "right_ankle_roll_joint", "right_wrist_yaw_joint"))
    np.testing.assert_array_equal(found, [[0.0, 5.5, 14.0]] * 50)
    sent = [low_state(1.7e9 + 0.002 * k, motor, motor, motor, 2 * k, LOW_STATES[1], mode_pr=1) for k in range(50)]
    with pytest.raises(RecordingError, match=r"mode AB \(mode_pr 1\)"):
        read(write_mcap(sent, tmp_path / "ab.mcap"))


@pytest.mark.parametrize(
    "leg",
    [
        ("LH_HAA", "LH_HFE", "LH_KFE"),
        ("rl_hip", "rl_thigh", "rl_calf"),
        ("hl.hx", "hl.hy", "hl.kn"),
        ("RL_abad", "RL_hip", "RL_knee"),
    ],
)
def test_joints_of_other_names_are_found_by_leg_and_part(leg: tuple[str, ...], tmp_path: Path) -> None:
    log = read(write_mcap(states(), tmp_path / "x.mcap"), joints=leg)
    assert log.joints == leg
    np.testing.assert_array_equal(log.position, np.arange(9, 12) + np.arange(50)[:, None])


def test_joints_that_are_not_there_are_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"no column 'arm_1\.position'"):
        read(write_mcap(states(), tmp_path / "x.mcap"), joints=("FL_hip_joint", "arm_1"))


def test_a_topic_of_its_own_replaces_the_imu_where_asked_for(tmp_path: Path) -> None:
    others = [imu(1.7e9 + 0.002 * k, (0, 0, 9), frame="head") for k in range(50)]
    path = write_mcap(sorted([*states(), *others], key=lambda sent: sent.received), tmp_path / "x.mcap")
    for topics, expected, frame in ((Topics(), 3.0, None), (Topics(imu="/imu/data"), 9.0, "head")):
        unit = read(LogFile(path, topics)).imu
        assert unit is not None
        assert unit.angular_velocity[20, 2] == pytest.approx(expected)
        assert unit.frame == frame


def test_two_topics_of_joints_are_asked_about(tmp_path: Path) -> None:
    named = [joints(1.7e9 + 0.002 * k, ("a",), (1.0,)) for k in range(50)]
    path = write_mcap([*states(), *named], tmp_path / "y.mcap")
    with pytest.raises(
        RecordingError, match=r"/joint_states \(.*1 joints\), /lowstate \(.*500 Hz, 12 joints\); choose"
    ):
        read(path)
    log = read(path, joints=("FL_hip_joint", "FL_thigh_joint"))
    assert any("joints read from /lowstate" in n and "other topics of joints: /joint_states" in n for n in log.notes)


def test_the_slow_copy_of_the_state_is_left(tmp_path: Path) -> None:
    path = write_mcap([*states(), *states(topic="/lf/lowstate")[::10]], tmp_path / "x.mcap")
    assert len(read(path)) == 50
    assert len(read(LogFile(path, Topics(joint="/lf/lowstate")))) == 5


def test_more_motors_than_the_legs_have_are_named(tmp_path: Path) -> None:
    sent = [low_state(1.7e9 + 0.002 * k, np.ones(16), np.ones(16), np.ones(16)) for k in range(9)]
    assert any("/lowstate has 16 motors" in note for note in read(write_mcap(sent, tmp_path / "x.mcap")).notes)


def test_the_ros_1_packages_of_older_robots(tmp_path: Path) -> None:
    """Names in camel case, numbers that are not aligned."""
    path = write_ros1(
        [old_low_state(1.6e9 + 0.002 * k, np.arange(12.0) + k, 2 * k) for k in range(50)], tmp_path / "x.bag"
    )
    log = read(path)
    assert log.joints == MOTORS
    np.testing.assert_array_equal(log.position, np.arange(12) + np.arange(50)[:, None])
    np.testing.assert_array_equal(log.effort, log.position + 1)  # type: ignore[operator]
    assert log.imu is not None
    np.testing.assert_allclose(log.imu.linear_acceleration[3], (4, 5, 6))
    np.testing.assert_allclose(log.imu.orientation[3], (0.1, 0.7, 0.5, 0.5), rtol=1e-6)  # type: ignore[index]


def test_late_messages_get_the_counters_time(tmp_path: Path) -> None:
    """Every tenth one is held up and comes in a burst with the next ones."""
    late = [0.015 if k % 10 == 5 else 0.0 for k in range(500)]
    received = np.maximum.accumulate([1.7e9 + 0.002 * k + d for k, d in enumerate(late)])
    sent = [low_state(float(t), [0] * 12, [0] * 12, [0] * 12, tick=2 * k) for k, t in enumerate(received)]
    log = read(write_mcap(sent, tmp_path / "x.mcap"))
    assert len(log) == 500
    np.testing.assert_allclose(log.time, 1.7e9 + 0.002 * np.arange(500), atol=2.6e-3)
    assert np.ptp(received - 1.7e9 - 0.002 * np.arange(500)) > 0.014
    assert any("stamps of /lowstate corrected by its counter, by at most 13 ms" in note for note in log.notes), (
        log.notes
    )


def test_messages_that_arrive_in_bursts_are_still_apart() -> None:
    """Steps of nearly zero would make accelerations of a burst's messages infinite."""
    clock, rng = TickClock(), np.random.default_rng(0)
    bursts = np.cumsum(rng.uniform(5, 30, 200)) * MS
    arrived = [int(bursts[np.searchsorted(bursts, 2 * k * MS)]) + 100 * k for k in range(1000)]
    stamps = np.array([clock.stamp(t, 2 * k) for k, t in enumerate(arrived)])
    assert np.diff(stamps).min() >= 0.5 * MS
    late = stamps[200:] - 2 * MS * np.arange(200, 1000)  # the least delay is known by then
    assert np.ptp(late) <= 2.1 * MS


def test_stamps_that_agree_with_the_counter_are_kept() -> None:
    clock, rng = TickClock(), np.random.default_rng(0)
    for k in range(10_000):
        sent = 12_345_678 + k * 2_000_960  # not a whole number of milliseconds
        received = 1_700_000_000_000_000_000 + sent + int(rng.uniform(0, 0.9 * MS))
        assert clock.stamp(received, sent // MS) == received
    assert clock.repaired == 0


@pytest.mark.parametrize("step", [-3600.0, -0.2, 0.2, 3600.0])
def test_a_step_of_the_recorders_clock_is_undone(step: float) -> None:
    clock = TickClock()
    stamps = [clock.stamp((2 * k * MS) + (int(1e9 * step) if k >= 500 else 0), 2 * k) for k in range(1000)]
    np.testing.assert_allclose(np.diff(stamps), 2 * MS, atol=2.1 * MS)
    assert abs(stamps[-1] - 2 * 999 * MS) <= 2 * MS


def test_a_counter_that_wraps_stands_still_or_starts_anew() -> None:
    clock = TickClock()
    wrapping = [clock.stamp(2 * k * MS, (2**32 - 100 + 2 * k) % 2**32) for k in range(200)]
    assert wrapping == [2 * k * MS for k in range(200)]
    assert [clock.stamp(10**9 + k, 7) for k in range(5)] == [10**9 + k for k in range(5)]
    assert clock.stamp(2 * 10**9, 3) == 2 * 10**9


def test_the_same_log_in_every_format(shared_data: Path) -> None:
    """Five seconds of a real Go2: LowState is of single precision."""
    table = read(shared_data / "real" / "go2_legs_in_air.csv")
    for name, tolerance in (("jointstate_ros1.bag", 0.0), ("lowstate_db3", 3e-7), ("lowstate_mcap", 3e-7)):
        log = read(shared_data / "real" / "formats" / f"go2_legs_in_air_{name}", joints=table.joints)
        assert len(log) == 1000
        np.testing.assert_allclose(log.time - log.time[0], table.time[:1000], atol=5e-7)
        for channel in ("position", "velocity", "effort"):
            np.testing.assert_allclose(getattr(log, channel), getattr(table, channel)[:1000], atol=tolerance)
        assert isinstance(log, Recording)
        assert log.imu is not None
        upright = Rotation.from_quat(log.imu.orientation).magnitude()  # type: ignore[arg-type]
        np.testing.assert_allclose(upright, 0.0, atol=1e-6)
