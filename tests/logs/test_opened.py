"""A log whose beginning is kept: the same chunks as from the file, which is read once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stadera.errors import RecordingError
from stadera.logs import LogFile, Recording, stream, write_table
from stadera.logs.batches import MOST_ROWS
from stadera.logs.tables.arrow import ParquetTable
from stadera.logs.topics import OpenedLog

SAMPLES = MOST_ROWS + 300


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    time = 1e-3 * np.arange(SAMPLES)
    log = Recording.from_arrays(time, np.sin(time)[:, None], effort=np.cos(time)[:, None], joints=["knee"])
    made = tmp_path_factory.mktemp("opened") / "log.parquet"
    write_table(log, made)
    return made


@pytest.mark.parametrize("rows", [256, MOST_ROWS, 1000])
def test_chunks_are_those_of_the_file_each_time(path: Path, rows: int) -> None:
    log = OpenedLog.at(LogFile.of(path))
    expected = list(stream(path, joints=["knee"], require=("effort",), rows=rows))
    next(stream(log, joints=["knee"]))
    for _ in range(2):
        found = list(stream(log, joints=["knee"], require=("effort",), rows=rows))
        assert [len(chunk) for chunk in found] == [len(chunk) for chunk in expected]
        for chunk, other in zip(found, expected, strict=True):
            assert chunk.notes == other.notes
            for name, values in chunk.arrays().items():
                np.testing.assert_array_equal(values, other.arrays()[name])


def test_checks_before_the_main_pass_do_not_read_again(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    passes = []
    once = ParquetTable.stream
    monkeypatch.setattr(ParquetTable, "stream", lambda *given, **options: passes.append(1) or once(*given, **options))
    log = OpenedLog.at(LogFile.of(path))
    for rows in (MOST_ROWS, 256):
        next(stream(log, joints=["knee"], rows=rows))
    assert sum(len(chunk) for chunk in stream(log, joints=["knee"], require=("effort",))) == SAMPLES
    assert len(passes) == 1


def test_a_missing_channel_is_named_as_by_the_file(path: Path) -> None:
    log = OpenedLog.at(LogFile.of(path))
    next(stream(log, joints=["knee"]))
    with pytest.raises(RecordingError, match=r"no column 'knee\.velocity'"):
        stream(log, joints=["knee"], require=("velocity",))
