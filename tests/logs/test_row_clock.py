"""Time of rows that repeats, runs back or is set back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pyarrow import csv

from stadera.errors import RecordingError
from stadera.logs import read, stream
from stadera.logs.stamps import RowClock

PERIOD = 0.002


def written(path: Path, time: np.ndarray) -> Path:
    csv.write_csv(pa.table({"time": time, "a.position": np.arange(float(len(time)))}), path)
    return path


def test_rows_that_repeat_or_are_out_of_order_are_left_out(tmp_path: Path) -> None:
    time = PERIOD * np.arange(1000)
    time[500], time[700] = time[499], time[697]
    log = read(written(tmp_path / "log.csv", time))
    np.testing.assert_array_equal(log.position[:, 0], np.delete(np.arange(1000), [500, 700]))
    assert "left out 2 samples whose time repeats or runs back" in log.notes


def test_where_the_clock_is_set_back_the_log_is_split(tmp_path: Path) -> None:
    time = PERIOD * np.arange(1000)
    time[400:] -= 0.5
    log = read(written(tmp_path / "log.csv", time))
    assert len(log) == 1000
    steps = np.diff(log.time)
    assert np.flatnonzero(steps > 5 * PERIOD).tolist() == [399]
    np.testing.assert_allclose(np.delete(steps, 399), PERIOD, atol=1e-9)
    (note,) = log.notes
    assert note.startswith("time is set back at sample 400, 0.798 to 0.300 s: the log is split there")


def test_a_clock_that_is_set_back_twice_and_drifts_keeps_its_steps(tmp_path: Path) -> None:
    time = 1.001 * PERIOD * np.arange(1000)
    time[300:] -= 0.2
    time[700:] -= 0.4
    log = read(written(tmp_path / "log.csv", time))
    steps = np.diff(log.time)
    assert len(log) == 1000
    assert np.flatnonzero(steps > 5 * PERIOD).tolist() == [299, 699]
    np.testing.assert_allclose(np.delete(steps, [299, 699]), 1.001 * PERIOD, atol=1e-9)
    assert [note[:31] for note in log.notes] == ["time is set back at sample 300,", "time is set back at sample 700,"]


def test_time_that_is_no_clock_is_refused(tmp_path: Path) -> None:
    time = PERIOD * np.arange(1000)
    time[500:520] = time[499]
    with pytest.raises(RecordingError, match="'time' stands still at sample 505"):
        read(written(tmp_path / "log.csv", time))


@settings(max_examples=40, deadline=None)
@given(
    faults=st.lists(st.tuples(st.integers(300, 1999), st.floats(-3.0, 0.5)), max_size=2),
    rows=st.integers(1, 700),
)
@example(faults=[(300, -0.0078125)], rows=1)  # four samples are skipped by one step back
def test_chunks_are_the_whole_and_time_increases(faults: list[tuple[int, float]], rows: int) -> None:
    time = PERIOD * np.arange(2000)
    for sample, by in faults:
        time[sample:] += round(by, 3) or 1e-4
    numbers = np.arange(len(time))
    whole, kept, _ = RowClock("log")(time, numbers)
    clock, parts = RowClock("log"), []
    for start in range(0, len(time), rows):
        part, some, _ = clock(time[start : start + rows], numbers[start : start + rows])
        parts.append(part[some])
    np.testing.assert_array_equal(np.concatenate(parts), whole[kept])
    assert (np.diff(whole[kept]) > 0).all()
    assert kept.sum() >= len(time) - 12


def test_notes_of_a_stream(tmp_path: Path) -> None:
    time = PERIOD * np.arange(1000)
    time[700] = time[699]
    chunks = tuple(stream(written(tmp_path / "log.csv", time), rows=300))
    assert [len(chunk.notes) for chunk in chunks] == [0, 0, 1, 0]
