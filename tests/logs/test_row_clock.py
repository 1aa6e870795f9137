"""Time of rows that repeats or runs back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyarrow import csv

from stadera.errors import RecordingError
from stadera.logs import read, stream
from stadera.logs.batches import RowClock

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


def test_a_clock_that_is_set_back_is_refused(tmp_path: Path) -> None:
    time = PERIOD * np.arange(1000)
    time[400:] -= 0.5
    with pytest.raises(RecordingError, match=r"'time' runs back at sample 404 \(0.798000 to 0.308000 s\)"):
        read(written(tmp_path / "log.csv", time))


def test_time_that_is_no_clock_is_refused(tmp_path: Path) -> None:
    time = PERIOD * np.arange(1000)
    time[500:520] = time[499]
    with pytest.raises(RecordingError, match="'time' stands still at sample 505"):
        read(written(tmp_path / "log.csv", time))


@settings(max_examples=40, deadline=None)
@given(
    faults=st.lists(st.tuples(st.integers(700, 1999), st.integers(-2, 200)), max_size=2),
    rows=st.integers(1, 700),
)
def test_chunks_are_the_whole_and_time_increases(faults: list[tuple[int, int]], rows: int) -> None:
    time = PERIOD * np.arange(2000)
    for sample, by in faults:
        time[sample:] += by * PERIOD
    numbers = np.arange(len(time))
    kept = RowClock("log")(time, numbers)
    clock, starts = RowClock("log"), range(0, len(time), rows)
    parts = [clock(time[start : start + rows], numbers[start : start + rows]) for start in starts]
    np.testing.assert_array_equal(np.concatenate(parts), kept)
    assert (np.diff(time[kept]) > 0).all()
    assert kept.sum() >= len(time) - 6


def test_notes_of_a_stream(tmp_path: Path) -> None:
    time = PERIOD * np.arange(1000)
    time[700] = time[699]
    chunks = tuple(stream(written(tmp_path / "log.csv", time), rows=300))
    assert [len(chunk.notes) for chunk in chunks] == [0, 0, 1, 0]
