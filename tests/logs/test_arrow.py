"""Record batches of Arrow as numbers: every kind of column, with nulls, and slices that begin within a byte."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from stadera.errors import RecordingError
from stadera.logs.tables.arrow import _batches_of

ROWS = 300
COLUMNS = {
    "double": pa.array([0.1 * k for k in range(ROWS)]),
    "double_with_nulls": pa.array([None if k % 5 == 0 else 0.1 * k for k in range(ROWS)]),
    "single": pa.array(range(ROWS), pa.float32()),
    "integer_with_nulls": pa.array([None if k % 7 == 0 else k for k in range(ROWS)]),
    "byte": pa.array([k % 250 for k in range(ROWS)], pa.uint8()),
    "truth": pa.array([k % 2 == 0 for k in range(ROWS)]),
    "nothing": pa.nulls(ROWS),
}


@pytest.mark.parametrize(("start", "count"), [(0, ROWS), (3, 200), (13, 0), (64, 1)])
def test_values_and_blanks_are_those_of_python(start: int, count: int) -> None:
    table = pa.RecordBatch.from_pydict(COLUMNS).slice(start, count)
    (batch,) = _batches_of([table], tuple(COLUMNS), "log")
    given = np.array([[np.nan if v is None else float(v) for v in column.to_pylist()] for column in table.columns])
    np.testing.assert_array_equal(batch, given)


def test_nan_that_is_no_blank_names_its_sample() -> None:
    first = pa.RecordBatch.from_pydict({"a": [1.0, None, 2.0], "b": [1.0, np.nan, 2.0]})
    second = pa.RecordBatch.from_pydict({"a": [1.0, 2.0], "b": [1.0, np.nan]})
    batches = _batches_of([first, second], ("a", "b"), "log")
    assert np.isnan(next(batches)[:, 1]).all()
    with pytest.raises(RecordingError, match="log: column 'b' is nan at sample 4"):
        next(batches)


def test_reading_parquet_does_not_import_pandas() -> None:
    code = "import sys, stadera.logs; stadera.logs.read('go2_trot'); print('pandas' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
