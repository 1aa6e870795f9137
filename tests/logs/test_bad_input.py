"""What is wrong with a table, said so that one knows what to do: the file, the column, the sample."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stadera.errors import RecordingError
from stadera.identify.legs import identify
from stadera.identify.settings import IdentifySettings
from stadera.logs import Imu, Preprocessing, Recording, preprocess, read, stream, write_table
from stadera.logs.summary import summarize
from stadera.robot import load_robot


def table(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_huge_value_names_column_and_sample(tmp_path: Path) -> None:
    path = table(tmp_path / "log.csv", "time,a.position,a.effort\n0,1,2\n1,1,-1e150\n2,1,2\n")
    with pytest.raises(
        RecordingError, match=r"log\.csv: column 'a\.effort' is -1e\+150 at sample 1, more than any sensor"
    ):
        read(path)


@pytest.mark.parametrize("sign", [";", "\t", "|"])
def test_other_separators_are_read(tmp_path: Path, sign: str) -> None:
    text = f"# go2, 12 May\ntime{sign}a.position\n0{sign}1.5\n1{sign}2\n"
    assert read(table(tmp_path / "log.csv", text)).position.tolist() == [[1.5], [2.0]]


def test_decimals_with_a_comma_are_read(tmp_path: Path) -> None:
    assert read(table(tmp_path / "log.csv", "time;a.position\n0,0;1,5\n0,5;2\n")).position.tolist() == [[1.5], [2.0]]


def test_columns_without_a_name(tmp_path: Path) -> None:
    path = table(tmp_path / "log.csv", "time,,a.position,\n0,1,2,3\n1,1,2,3\n")
    with pytest.raises(RecordingError, match="columns 2, 4 of the header have no name"):
        read(path)
    path = table(tmp_path / "log.csv", "time,a.position,\n0,1,2\n1,1,2\n")
    assert any("(no name)" in note for note in read(path).notes)


def test_too_few_samples_name_the_file() -> None:
    one = Recording(np.zeros(1), ("a",), np.zeros((1, 1)), source="short.csv")
    with pytest.raises(RecordingError, match=r"short\.csv: too few samples: 1"):
        preprocess(one, Preprocessing(10.0))


@pytest.mark.filterwarnings("error")
def test_a_summary_of_one_sample_is_refused_without_a_warning(tmp_path: Path) -> None:
    path = table(tmp_path / "log.csv", "time,a.position\n0,1\n")
    with pytest.raises(RecordingError, match="too few samples: 1"):
        summarize(stream(path))


def test_torques_that_are_all_zero_identify_nothing() -> None:
    robot = load_robot("hyq")
    joints = robot.leg("RH").joints
    time = np.arange(2000) * 1e-3
    motion = 0.3 * np.sin(np.outer(2 * np.pi * time, [0.7, 0.9, 1.1]))
    log = Recording(time, joints, motion, effort=np.zeros((2000, 3)), source="silent.csv")
    with pytest.raises(RecordingError, match=r"silent\.csv: the efforts of leg RH .* are all zero"):
        identify(robot, [log], IdentifySettings(legs=("RH",)))


def test_the_imu_frame_is_kept_where_a_table_has_a_place_for_it(tmp_path: Path) -> None:
    imu = Imu(np.zeros((2, 3)), np.ones((2, 3)), frame="imu_link")
    log = Recording(np.arange(2.0), ("a",), np.zeros((2, 1)), imu=imu)
    for name, frame in (("log.parquet", "imu_link"), ("log.csv", None)):
        back = read(write_table(log, tmp_path / name)).imu
        assert back is not None
        assert back.frame == frame


@pytest.mark.parametrize("rate", [200, 500])
def test_a_log_of_a_robot_that_stands_still_hears_that_little_can_be_learnt(rate: int) -> None:
    robot = load_robot("hyq")
    time = 12.345 + np.arange(1500) / rate
    still = np.tile([0.1, -0.5, 1.0], (len(time), 1))
    log = Recording(time, robot.leg("RH").joints, still, effort=np.ones((len(time), 3)), source="still.csv")
    (leg,) = identify(robot, [log], IdentifySettings(legs=("RH",))).legs
    assert any("poor excitation" in warning for warning in leg.warnings)
