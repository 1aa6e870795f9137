"""Own data as a log: arrays and data frames, what is taken, and what a wrong one hears."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from stadera.errors import RecordingError, StaderaError
from stadera.logs import Imu, LogFile, Recording, Topics, as_log, as_logs, read, stream

JOINTS = ("a", "b")
COLUMNS: dict[str, Any] = {"time": [0.0, 0.1, 0.2], "a.position": [1, 2, 3], "b.position": [4.0, 5.0, 6.0]}


def arrays(**changed: Any) -> Recording:
    given = {"time": [0, 1, 2], "position": np.zeros((3, 2)), "joints": JOINTS} | changed
    return Recording.from_arrays(**given)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"position": np.zeros((2, 3))}, r"position needs shape \(3, 2\), got \(2, 3\): transposed"),
        ({"velocity": [0.0, 0.0, 0.0]}, r"velocity needs shape \(3, 2\), got \(3,\)"),
        ({"effort": [[1.0, 2.0], [1.0], [1.0, 2.0]]}, "effort: its rows differ in length"),
        ({"effort": [["1", "2"]] * 3}, "effort holds <U1, not numbers"),
        ({"time": [[0, 1, 2]]}, r"time needs shape \(samples,\), got \(1, 3\)"),
        ({"time": [0, 2, 1]}, "'time' runs back at sample 2"),
        ({"time": np.array([0, 1, 2], dtype="M8[s]")}, r"time holds datetime64.*\(t - t\[0\]\) / numpy.timedelta64"),
        ({"position": [[0, 0], [0, np.inf], [0, 0]]}, "'b.position' is inf at sample 1"),
        ({"velocity": np.full((3, 2), np.nan)}, "velocity is NaN: no sample is complete"),
        ({"joints": "ab"}, "joints needs a list of names"),
        ({"joints": ("a", "a")}, "joint 'a' is named 2 times"),
        ({"imu": Imu(np.zeros((3, 3)), np.zeros((3, 4)))}, r"imu.linear_acceleration needs shape \(3, 3\)"),
        ({"foot_force": {"LF": [1, 2, 3]}}, r"LF.force needs shape \(3, 3\)"),
    ],
)
def test_wrong_arrays_are_named_with_the_shape_they_need(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        arrays(**changed)


def test_samples_with_nan_are_dropouts() -> None:
    """As blank cells of a table are."""
    turned = np.zeros((5, 3))
    turned[3, 1] = np.nan
    made = Recording.from_arrays(
        np.arange(5.0),
        [[0, 1], [np.nan, 2], [0, 3], [0, 4], [0, 5]],
        joints=("a", "b"),
        imu=Imu(turned, np.ones((5, 3))),
    )
    assert made.time.tolist() == [0.0, 2.0, 4.0]
    assert made.position[:, 1].tolist() == [1.0, 3.0, 5.0]
    (note,) = made.notes
    assert note == "dropped 2 of 5 samples with blank cells, in 2 dropouts, the first at sample 1, column 'position'"


def test_masked_values_are_dropouts() -> None:
    position = np.ma.masked_equal([[0, 1], [9, 2], [0, 3]], 9)
    assert arrays(position=position).time.tolist() == [0.0, 2.0]


def test_arrays_are_taken_as_they_are_and_lists_as_numbers() -> None:
    position = np.ones((3, 2))
    log = arrays(position=position, foot_contact={"LF": [0, 1, 1]}, source="trial 3")
    assert log.position is position
    assert log.time.dtype == np.float64
    assert log.foot_contact["LF"].tolist() == [False, True, True]
    assert log.name == "trial 3"


def frames() -> list[Any]:
    found: list[Any] = [COLUMNS, pa.table(COLUMNS)]
    for library in ("pandas", "polars"):
        try:
            found.append(__import__(library).DataFrame(COLUMNS))
        except ImportError:
            continue
    return found


@pytest.mark.parametrize("df", frames(), ids=lambda df: type(df).__module__)
def test_a_data_frame_of_every_library(df: Any) -> None:
    log = Recording.from_dataframe(df, joints=("b", "a"))
    np.testing.assert_array_equal(log.position, [[4, 1], [5, 2], [6, 3]])
    with pytest.raises(RecordingError, match=r"dataframe: no column 'a\.effort'"):
        Recording.from_dataframe(df, require=("effort",))


@pytest.mark.filterwarnings("error")
def test_a_lazy_frame_is_collected() -> None:
    polars = pytest.importorskip("polars")
    assert len(as_log(polars.LazyFrame(COLUMNS))) == 3  # type: ignore[arg-type]


def test_missing_values_are_dropouts() -> None:
    expected = "dropped 1 of 3 samples with blank cells, in 1 dropout, the first at sample 1, column 'a.position'"
    columns = COLUMNS | {"a.position": [1, None, 3]}
    made: list[Any] = [columns, pa.table(columns)]
    if pandas := sys.modules.get("pandas"):
        made += [pandas.DataFrame(columns), pandas.DataFrame(columns).convert_dtypes()]
    if polars := sys.modules.get("polars"):
        made.append(polars.DataFrame(columns))
    for df in made:
        log = Recording.from_dataframe(df)
        assert log.position[:, 0].tolist() == [1, 3]
        assert log.notes == (expected,)


def test_time_may_be_the_index_and_the_frame_in_the_metadata() -> None:
    pandas = pytest.importorskip("pandas")
    assert len(Recording.from_dataframe(pandas.DataFrame(COLUMNS).set_index("time"))) == 3
    imu = {f"imu.{q}.{axis}": [0.0] * 3 for q in ("angular_velocity", "linear_acceleration") for axis in "xyz"}
    table = pa.table(COLUMNS | imu).replace_schema_metadata({"imu.frame": "imu_link"})
    for given, expected in ((None, "imu_link"), ("other", "other")):
        unit = Recording.from_dataframe(table, imu_frame=given).imu
        assert unit is not None
        assert unit.frame == expected


@pytest.mark.parametrize(
    ("df", "message"),
    [
        ([1, 2], "list is not a data frame; valid: a pandas or polars DataFrame"),
        ({"a.position": [1, 2]}, "no column 'time'"),
        (COLUMNS | {"a.position": ["x"] * 3}, "'a.position' holds"),
        (COLUMNS | {"time": np.array([0, 1, 2], dtype="M8[ms]")}, r"'time' holds datetime64.*needed in seconds"),
        (COLUMNS | {"time": [0.0, 0.0, 1.0]}, "stands still at sample 1"),
        (COLUMNS | {"b.position": [0.0, np.inf, 1.0]}, "'b.position' is inf at sample 1"),
        (COLUMNS | {"b.position": [0.0, 1.0]}, "'b.position' has 2 values, 'time' has 3"),
    ],
)
def test_wrong_data_frames_are_named(df: Any, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        Recording.from_dataframe(df)


def test_whatever_is_a_log_is_taken(tmp_path: Path) -> None:
    recording, chosen = arrays(), LogFile(tmp_path / "x.mcap", Topics("/joints"))
    assert as_logs("x.csv") == (LogFile(Path("x.csv")),)
    assert as_logs(recording) == (recording,)
    assert as_logs(chosen) == (chosen,)
    assert as_logs(["x.csv", Path("y.csv"), chosen, recording]) == (
        LogFile(Path("x.csv")),
        LogFile(Path("y.csv")),
        chosen,
        recording,
    )
    assert as_log(chosen).source == str(chosen)
    for wrong, message in (([], "no log given"), (3, "got int"), ([1.0, 2.0], "got float"), (b"x", "got bytes")):
        with pytest.raises(RecordingError, match=message):
            as_logs(wrong)  # type: ignore[arg-type]
    (table,) = as_logs(pa.table(COLUMNS))  # type: ignore[arg-type]
    assert isinstance(table, Recording)
    np.testing.assert_array_equal(table.time, COLUMNS["time"])


def test_a_recording_is_read_as_a_file_is() -> None:
    log = arrays(velocity=np.zeros((3, 2)))
    assert read(log) is log
    assert [len(chunk) for chunk in stream(log, rows=2)] == [2, 1]
    for count in (0, 1):
        with pytest.raises(RecordingError, match=f"too few samples: {count}"):
            read(Recording.from_arrays(np.zeros(count), np.ones((count, 1)), joints=["a"]))
    with pytest.raises(StaderaError, match=r"no column 'a\.effort'"):
        stream(log, require=("effort",))


def test_readers_libraries_are_imported_when_they_are_used() -> None:
    code = "import sys, stadera.logs.reader, stadera.logs.frames; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"pyarrow", "mcap", "rosbags", "zstandard", "pandas", "polars"} & set(loaded)


def test_joints_of_a_recording_are_found_by_leg_and_part() -> None:
    """As those of a table are."""
    own, joints = ("LF_KFE", "LF_HAA", "LF_HFE"), ("lf_haa_joint", "lf_hfe_joint", "lf_kfe_joint")
    log = arrays(position=[[2.0, 0.0, 1.0]] * 3, joints=own)
    found = read(log, joints=joints)
    assert found.joints == joints
    assert found.position[0].tolist() == [0.0, 1.0, 2.0]
    assert found.notes == ("joints found by leg and part, 'LF_HAA' as 'lf_haa_joint'",)
    assert [chunk.joints for chunk in stream(log, joints=joints, rows=2)] == [joints] * 2
