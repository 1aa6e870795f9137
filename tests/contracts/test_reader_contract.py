"""What every log must do, run on every registered kind of file and on recordings made of own data.

A new reader adds a line to MAKERS, a new way to make a recording one to IN_MEMORY.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from bags import of_recording, write_folder, write_mcap, write_ros1
from log_formats import mat, npz
from stadera.errors import RecordingError, UnknownNameError
from stadera.logs import READERS, Imu, Recording, as_log, concatenate, read, reader_of, stream, write_table
from stadera.logs.frames import columns_of

SAMPLES = 1000
MAKERS: dict[str, Callable[[Recording, Path], Path]] = {
    "CSV table": lambda recording, folder: write_table(recording, folder / "log.csv"),
    "Parquet table": lambda recording, folder: write_table(recording, folder / "log.parquet"),
    "MCAP bag": lambda recording, folder: write_mcap(of_recording(recording), folder / "log.mcap"),
    "ROS 1 bag": lambda recording, folder: write_ros1(of_recording(recording), folder / "log.bag"),
    "NumPy table": lambda recording, folder: npz(recording, folder / "log.npz"),
    "MATLAB table": lambda recording, folder: mat(recording, folder / "log.mat"),
    "sqlite3 bag": lambda recording, folder: write_folder(of_recording(recording), folder / "log"),
}


def of_arrays(recording: Recording) -> Recording:
    """By lists, as who has own data may have them."""
    imu, lists = recording.imu, {}
    for name in ("position", "velocity", "effort"):
        lists[name] = getattr(recording, name).tolist()
    if imu is not None and imu.orientation is not None:
        imu = Imu(imu.angular_velocity.tolist(), imu.linear_acceleration.tolist(), imu.orientation.tolist())  # type: ignore[arg-type]
    return Recording.from_arrays(recording.time.tolist(), **lists, joints=list(recording.joints), imu=imu)


IN_MEMORY: dict[str, Callable[[Recording], Recording]] = {
    "recording": lambda recording: recording,
    "arrays": of_arrays,
    "mapping": lambda recording: Recording.from_dataframe(columns_of(recording)),
    "pyarrow": lambda recording: Recording.from_dataframe(pa.table(columns_of(recording))),
    "pandas": lambda recording: Recording.from_dataframe(
        pytest.importorskip("pandas").DataFrame(columns_of(recording))
    ),
    "polars": lambda recording: Recording.from_dataframe(
        pytest.importorskip("polars").DataFrame(columns_of(recording))
    ),
}


@pytest.fixture
def recording() -> Recording:
    rng = np.random.default_rng(7)
    return Recording(
        time=10.0 + 0.002 * np.arange(SAMPLES),
        joints=("LF_HAA", "LF_HFE", "fl.kn"),
        position=rng.normal(size=(SAMPLES, 3)),
        velocity=rng.normal(size=(SAMPLES, 3)),
        effort=rng.normal(size=(SAMPLES, 3)),
        imu=Imu(rng.normal(size=(SAMPLES, 3)), rng.normal(size=(SAMPLES, 3)), rng.normal(size=(SAMPLES, 4))),
    )


@pytest.fixture(params=sorted(MAKERS))
def file(request: pytest.FixtureRequest, recording: Recording, tmp_path: Path) -> Path:
    return MAKERS[request.param](recording, tmp_path)


@pytest.fixture(params=[*sorted(MAKERS), *sorted(IN_MEMORY)])
def log(request: pytest.FixtureRequest, recording: Recording, tmp_path: Path) -> Path | Recording:
    if request.param in MAKERS:
        return MAKERS[request.param](recording, tmp_path)
    return IN_MEMORY[request.param](recording)


def test_every_reader_is_under_this_contract() -> None:
    assert sorted(reader.name for reader in READERS) == sorted(MAKERS)


def test_exactly_one_reader_accepts(file: Path) -> None:
    assert [reader for reader in READERS if reader.accepts(file)] == [reader_of(file)]


def test_values_come_back(log: Path | Recording, recording: Recording) -> None:
    back = read(log)
    assert back.joints == recording.joints
    assert back.source == as_log(log).source
    assert back.acceleration is None
    assert back.imu is not None
    assert recording.imu is not None
    np.testing.assert_allclose(back.time, recording.time, rtol=0, atol=1e-9)  # stamps of messages are whole ns
    for name in ("position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(back, name), getattr(recording, name))
    for name in ("angular_velocity", "linear_acceleration", "orientation"):
        np.testing.assert_array_equal(getattr(back.imu, name), getattr(recording.imu, name))


def test_chunks_put_together_are_the_whole(log: Path | Recording) -> None:
    whole = read(log)
    for rows in (1, 7, 333, SAMPLES, SAMPLES + 1):
        chunks = tuple(stream(log, rows=rows))
        assert [len(chunk) for chunk in chunks[:-1]] == [rows] * (len(chunks) - 1)
        joined = concatenate(chunks)
        np.testing.assert_array_equal(joined.time, whole.time)
        np.testing.assert_array_equal(joined.position, whole.position)
        np.testing.assert_array_equal(joined.effort, whole.effort)
        assert joined.notes == whole.notes


def test_chosen_joints_come_in_the_asked_order(log: Path | Recording, recording: Recording) -> None:
    back = read(log, joints=("fl.kn", "LF_HAA"))
    assert back.joints == ("fl.kn", "LF_HAA")
    np.testing.assert_array_equal(back.position, recording.position[:, [2, 0]])


def test_a_joint_that_is_not_there_names_file_and_choices(log: Path | Recording) -> None:
    with pytest.raises(RecordingError, match=r"LF_HFE") as caught:
        read(log, joints=("LF_KFE",))
    assert as_log(log).source in str(caught.value)
    assert "LF_KFE" in str(caught.value)


def test_a_required_channel_that_is_not_there_is_named(log: Path | Recording) -> None:
    with pytest.raises(RecordingError, match=r"acceleration"):
        read(log, require=("acceleration",))
    with pytest.raises(UnknownNameError, match="valid: position, velocity"):
        read(log, require=("torque",))


def test_a_name_of_another_kind_is_an_error(file: Path) -> None:
    other = next(reader for reader in READERS if reader is not reader_of(file))
    renamed = file.rename(file.with_name(f"renamed{other.suffixes[0]}"))
    with pytest.raises(RecordingError, match="not what its name says"):
        read(renamed)


def test_a_name_that_promises_nothing_is_read_by_content(file: Path, recording: Recording) -> None:
    np.testing.assert_allclose(read(file.rename(file.with_name("renamed"))).time, recording.time, rtol=0, atol=1e-9)
