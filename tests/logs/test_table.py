"""The flat table: round trips, what is kept out, and what bad files get."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pyarrow import parquet

from stadera.errors import RecordingError, StaderaError, UnknownNameError
from stadera.logs import Imu, Recording, read, stream, write_table

HEADER = "time,LF_HAA.position,LF_HAA.velocity,LF_HAA.effort"


def csv_of(folder: Path, *rows: str, header: str = HEADER) -> Path:
    path = folder / "log.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


finite = st.floats(-1e3, 1e3, allow_subnormal=True)


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    n, joints = draw(st.integers(2, 12)), draw(st.integers(1, 3))
    steps = draw(arrays(np.float64, n, elements=st.floats(1e-6, 1e3)))
    channels = {
        name: draw(st.none() | arrays(np.float64, (n, joints), elements=finite))
        for name in ("velocity", "acceleration", "effort")
    }
    imu = Imu(draw(arrays(np.float64, (n, 3), elements=finite)), draw(arrays(np.float64, (n, 3), elements=finite)))
    return Recording(
        time=np.cumsum(steps),
        joints=tuple(f"leg.j{i}" for i in range(joints)),
        position=draw(arrays(np.float64, (n, joints), elements=finite)),
        imu=draw(st.sampled_from([None, imu])),
        foot_force=draw(st.sampled_from([{}, {"LF_FOOT": imu.linear_acceleration}])),
        foot_contact=draw(st.sampled_from([{}, {"LF_FOOT": imu.angular_velocity[:, 0] > 0}])),
        **channels,
    )


def same_bits(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    if a is None or b is None:
        return a is b
    return a.shape == b.shape and np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes()


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(recording=recordings())
def test_written_values_come_back_bit_for_bit(suffix: str, tmp_path: Path, recording: Recording) -> None:
    back = read(write_table(recording, tmp_path / f"log{suffix}"))
    assert back.joints == recording.joints
    assert back.notes == ()
    for name in ("time", "position", "velocity", "acceleration", "effort"):
        assert same_bits(getattr(back, name), getattr(recording, name)), name
    assert (back.imu is None) == (recording.imu is None)
    if back.imu is not None and recording.imu is not None:
        assert same_bits(back.imu.angular_velocity, recording.imu.angular_velocity)
        assert same_bits(back.imu.linear_acceleration, recording.imu.linear_acceleration)
    assert {f: v.tobytes() for f, v in back.foot_contact.items()} == {
        f: v.tobytes() for f, v in recording.foot_contact.items()
    }
    for foot in recording.foot_force:
        assert same_bits(back.foot_force[foot], recording.foot_force[foot])


def test_unknown_columns_are_kept_out_and_named(tmp_path: Path) -> None:
    path = csv_of(tmp_path, "0,1,2,3,hot,7", "1,1,2,3,cold,7", header=HEADER + ",weather,imu.angular_velocity.x")
    recording = read(path)
    assert recording.imu is None
    assert any("weather" in note for note in recording.notes)
    assert any("imu.linear_acceleration.x" in note for note in recording.notes)


def test_a_quaternion_is_read_by_the_names_of_its_columns(tmp_path: Path) -> None:
    imu = [f"imu.{of}.{axis}" for of in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    header = ",".join(["time,a.position", *(f"imu.orientation.{axis}" for axis in "wzyx"), *imu])
    recording = read(csv_of(tmp_path, *(f"{t},1,0.7,0.5,0.5,0.1,0,0,0,0,0,9.81" for t in (0, 1)), header=header))
    assert recording.imu is not None
    np.testing.assert_array_equal(recording.imu.orientation, [[0.1, 0.5, 0.5, 0.7]] * 2)  # xyzw


def test_a_header_may_have_a_byte_order_mark_quotes_and_spaces(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b'\xef\xbb\xbf"time" , "LF_HAA.position"\r\n0, 1.5\r\n0.1, -2\r\n')
    np.testing.assert_array_equal(read(path).position, [[1.5], [-2.0]])


def test_parquet_of_other_number_types_is_read(tmp_path: Path) -> None:
    table = pa.table(
        {
            "time": pa.array([0.0, 0.5], pa.float32()),
            "a.position": pa.array([1, 2], pa.int64()),
            "LF.contact": pa.array([True, False]),
        }
    )
    parquet.write_table(table, tmp_path / "log.parquet")
    recording = read(tmp_path / "log.parquet")
    np.testing.assert_array_equal(recording.position, [[1.0], [2.0]])
    np.testing.assert_array_equal(recording.foot_contact["LF"], [True, False])


def test_blank_cells_are_dropouts_dropped_and_counted(tmp_path: Path) -> None:
    rows = [f"{0.01 * i:.2f},{'' if i in (30, 31, 32, 33, 34, 35, 70) else i},0,0" for i in range(100)]
    recording = read(csv_of(tmp_path, *rows))
    assert len(recording) == 93
    (note,) = recording.notes
    assert note.startswith("dropped 7 of 100 samples with blank cells, in 2 dropouts, the first at sample 30")
    assert "LF_HAA.position" in note
    np.testing.assert_allclose(np.diff(recording.time)[[29, 63]], [0.07, 0.02])


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["0,1,2,3", "1,nan,2,3"], r"column 'LF_HAA.position' is nan at sample 1"),
        (["0,1,2,3", "1,1,2,3", "2,1,2,-inf"], r"column 'LF_HAA.effort' is -inf at sample 2"),
        (["0,1,2,3", "0,1,2,3"], r"'time' stands still at sample 1"),
        (["0,1,2,3", "1,1,2,3", "0.5,1,2,3"], r"'time' runs back at sample 2 \(1.000000 to 0.500000 s\)"),
        (["0,1,2,3", "1,1,fast,3"], r"column 'LF_HAA.velocity' holds 'fast', not a number at sample 1"),
        (["0,1,2,3", "1,1"], r"2 cells instead of 4 at sample 1"),
        (["0,1,2,3"], r"too few samples: 1"),
        ([], r"too few samples: 0"),
        (["0,,2,3", "1,,2,3"], r"too few samples: 0 without blank cells among 2, .*; 'LF_HAA.position' is blank in 2"),
    ],
)
def test_bad_values_name_file_column_and_sample(tmp_path: Path, rows: list[str], message: str) -> None:
    path = csv_of(tmp_path, *rows)
    with pytest.raises(RecordingError, match=message) as caught:
        read(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("LF_HAA.position,LF_HAA.effort", r"not a flat table: no column 'time'"),
        ("tme,LF_HAA.position", r"no column 'time'; did you mean 'tme'"),
        ("time,LF_HAA.effort", r"no column '<joint>.position'"),
        ("time,LF_HAA.position,LF_HAA.position", r"column 'LF_HAA.position' is there 2 times"),
        ("0.1,0.2,0.2", "the first row is numbers"),
        ("time,a.position,b.postion,b.effort", r"no column 'b.position'; did you mean 'b.postion'"),
        ("time,a.position,b.position,a.effort", r"no column 'b.effort'"),
    ],
)
def test_bad_headers_name_the_column_and_the_closest(tmp_path: Path, header: str, message: str) -> None:
    row = ",".join("0" for _ in header.split(","))
    with pytest.raises(RecordingError, match=message):
        read(csv_of(tmp_path, row, row, header=header))


def test_a_missing_torque_column_names_its_misspelling(tmp_path: Path) -> None:
    path = csv_of(tmp_path, "0,1,2", "1,1,2", header="time,LF_HAA.position,LF_HAA.efort")
    with pytest.raises(RecordingError, match=r"no column 'LF_HAA.effort'; did you mean 'LF_HAA.efort'"):
        read(path, require=("effort",))
    with pytest.raises(RecordingError, match="effort"):
        read(path).channel("effort", ("LF_HAA",))


def test_a_joint_can_be_missing_in_what_was_read(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="valid: LF_HAA"):
        read(csv_of(tmp_path, "0,1,2,3", "1,1,2,3")).channel("position", ("RF_HAA",))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_time_that_runs_back_between_chunks_is_found(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log{suffix}"
    table = pa.table({"time": [0.0, 1.0, 2.0, 1.5, 2.5, 3.5], "a.position": [0.0] * 6})
    if suffix == ".csv":
        pa.csv.write_csv(table, path)
    else:
        parquet.write_table(table, path)
    with pytest.raises(RecordingError, match=r"runs back at sample 3"):
        list(stream(path, rows=3))


def test_nan_in_a_late_chunk_has_its_number_in_the_file(tmp_path: Path) -> None:
    values = np.zeros(1000)
    values[777] = np.nan
    path = tmp_path / "log.parquet"
    parquet.write_table(pa.table({"time": np.arange(1000.0), "a.position": values}), path)
    with pytest.raises(RecordingError, match=r"'a.position' is nan at sample 777"):
        list(stream(path, rows=100))


def garbage(folder: Path, kind: str) -> Path:
    path = folder / ("log.parquet" if "parquet" in kind else "log.csv")
    match kind:
        case "absent":
            pass
        case "empty" | "empty parquet":
            path.touch()
        case "directory":
            path.mkdir()
        case "directory of logs":
            path.mkdir()
            (path / "a.parquet").touch()
        case "zip":
            path.write_bytes(b"PK\x03\x04" + bytes(200))
        case "binary":
            path.write_bytes(bytes(range(256)) * 20)
        case "prose":
            path.write_text("Dear diary,\ntoday the robot walked.\n")
        case "cut off parquet":
            write_table(Recording(np.arange(99.0), ("a",), np.zeros((99, 1))), path)
            path.write_bytes(path.read_bytes()[:-100])
        case "text parquet":
            path.write_text(f"{HEADER}\n0,1,2,3\n1,1,2,3\n")
        case "strings parquet":
            parquet.write_table(pa.table({"time": [0.0, 1.0], "a.position": ["x", "y"]}), path)
    return path


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("absent", "no such file"),
        ("empty", "the file is empty; accepted: .*CSV table"),
        ("empty parquet", "the file is empty; accepted: .*Parquet table"),
        ("directory", "a directory, not a log; accepted: .*CSV table"),
        ("directory of logs", r"a directory, not a log; accepted: .*; for the logs in it give `stadera fleet` '.*/\*'"),
        ("zip", "not what its name says, no CSV table.*; accepted: "),
        ("binary", "not what its name says, no CSV table.*; accepted: "),
        ("prose", "not a flat table: no column 'time'"),
        ("cut off parquet", "damaged Parquet file"),
        ("text parquet", "not what its name says: content is CSV table"),
        ("strings parquet", "column 'a.position' holds string, not numbers"),
    ],
)
def test_what_is_no_log_gets_one_line_naming_the_file(tmp_path: Path, kind: str, message: str) -> None:
    path = garbage(tmp_path, kind)
    for attempt in (read, lambda p: list(stream(p))):
        with pytest.raises(StaderaError, match=message) as caught:
            attempt(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_failed_write_leaves_what_was_there(tmp_path: Path) -> None:
    recording = Recording(np.arange(5.0), ("a",), np.zeros((5, 1)))
    path = write_table(recording, tmp_path / "log.csv")
    before = path.read_bytes()
    later = replace(recording, joints=("b",))
    with pytest.raises(RecordingError, match="differ in their columns"):
        write_table(iter([recording, later]), path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["log.csv"]


def test_only_known_suffixes_and_folders_are_written(tmp_path: Path) -> None:
    recording = Recording(np.arange(5.0), ("a",), np.zeros((5, 1)))
    with pytest.raises(RecordingError, match=r"\.csv, \.parquet"):
        write_table(recording, tmp_path / "log.xlsx")
    with pytest.raises(StaderaError, match="no such folder"):
        write_table(recording, tmp_path / "absent" / "log.csv")
    with pytest.raises(RecordingError, match="nothing to write"):
        write_table([], tmp_path / "log.csv")
    with pytest.raises(RecordingError, match="comma"):
        write_table(replace(recording, joints=("a,b",)), tmp_path / "log.csv")
    assert os.listdir(tmp_path) == []


def test_real_logs_are_read(shared_data: Path) -> None:
    for name, samples in (("go2", 4779), ("aliengo", 4700)):
        recording = read(shared_data / "real" / f"{name}_legs_in_air.csv", require=("velocity", "effort"))
        assert len(recording) == samples
        assert len(recording.joints) == 12
        assert recording.notes == ()
