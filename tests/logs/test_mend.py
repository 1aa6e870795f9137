"""Changes of a log while it is read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stadera.errors import RecordingError
from stadera.logs import Imu, LogFile, Recording, read, stream, take, write_table
from stadera.logs.mend import Gear, Mend, changed
from stadera.logs.topics import ReadOptions

JOINTS = ("FL_hip_joint", "FL_thigh_joint", "FL_calf_joint")


@pytest.fixture
def log() -> Recording:
    numbers = np.random.default_rng(0).normal(size=(3, 40, 3))
    return Recording.from_arrays(np.arange(40) / 100.0, *numbers, joints=JOINTS)


def test_a_gear_multiplies_torques_alone(log: Recording, tmp_path: Path) -> None:
    path = write_table(log, tmp_path / "log.csv")
    back = read(LogFile(path, reading=ReadOptions.of(gear="6.33,6.33,9.55")))
    assert log.effort is not None
    np.testing.assert_allclose(back.effort, log.effort * [6.33, 6.33, 9.55], rtol=1e-9)
    np.testing.assert_allclose(back.position, log.position, rtol=1e-9)
    assert any("gear ratios of 6.33, 6.33, 9.55" in note for note in back.notes)


def test_a_gear_by_part_needs_names_that_say_it(log: Recording) -> None:
    with pytest.raises(RecordingError, match="'one' says neither hip, thigh nor calf"):
        Gear.parse("1,2,3")(replace(log, joints=("one", "two", "three")))


@pytest.mark.parametrize("text", ["0", "-6", "6,7", "x", "", "nan"])
def test_no_gear(text: str) -> None:
    with pytest.raises(RecordingError, match="gear ratio"):
        Gear.parse(text)


def test_swapped_columns_are_read_though_one_joint_is_asked_for(log: Recording, tmp_path: Path) -> None:
    swap = Mend("knees", swapped={("effort", JOINTS[0]): JOINTS[2], ("effort", JOINTS[2]): JOINTS[0]})
    path = write_table(log, tmp_path / "log.csv")
    file = LogFile(path, reading=replace(ReadOptions(), changes=(swap,)))
    chunks = list(stream(file, joints=JOINTS[:1], rows=15))
    assert [chunk.joints for chunk in chunks] == [JOINTS[:1]] * 3
    assert [chunk.notes.count("knees") for chunk in chunks] == [1, 0, 0]
    assert log.effort is not None
    np.testing.assert_allclose(np.concatenate([c.effort for c in chunks if c.effort is not None]), log.effort[:, 2:])


def test_a_mend_twice_is_none(log: Recording) -> None:
    swap = Mend("", swapped={("position", JOINTS[0]): JOINTS[1], ("position", JOINTS[1]): JOINTS[0]})
    turn = Mend("", joint_factors={("velocity", JOINTS[1]): -1.0})
    back = changed(log, [swap, turn, turn, swap])
    np.testing.assert_array_equal(back.position, log.position)
    assert log.velocity is not None
    np.testing.assert_array_equal(back.velocity, log.velocity)


def test_a_turn_of_the_gyro_alone_keeps_force_and_orientation(log: Recording) -> None:
    quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (len(log), 1))
    given = replace(log, imu=Imu(log.position, log.position + 9.81, quaternion))
    turn = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    imu = Mend("turned", turn=turn, gyro_alone=True)(given).imu
    assert imu is not None
    np.testing.assert_array_equal(imu.angular_velocity, log.position @ np.array(turn).T)
    np.testing.assert_array_equal(imu.linear_acceleration, log.position + 9.81)
    np.testing.assert_array_equal(imu.orientation, quaternion)


def test_nothing_can_be_taken_of_a_log(log: Recording) -> None:
    assert len(take(log, log.time < 0.0)) == 0
