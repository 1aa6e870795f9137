"""Logs with damaged headers and definitions: read as far as they go, or refused by an error of our own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType

from bags import low_state, of_recording, write_folder, write_mcap, write_ros1
from stadera.errors import RecordingError
from stadera.logs import Imu, Recording, read, write_table

SAMPLES = 60


def logs(folder: Path) -> list[Path]:
    rng = np.random.default_rng(0)
    values = rng.normal(size=(3, SAMPLES, 2))
    imu = Imu(rng.normal(size=(SAMPLES, 3)), rng.normal(size=(SAMPLES, 3)), frame="imu")
    log = Recording(1e9 + 0.002 * np.arange(SAMPLES), ("a", "b"), values[0], values[1], effort=values[2], imu=imu)
    states = [low_state(1.7e9 + 0.002 * k, [k] * 12, [0] * 12, [0] * 12) for k in range(SAMPLES)]
    return [
        write_table(log, folder / "table.csv"),
        write_table(log, folder / "table.parquet"),
        write_ros1(of_recording(log), folder / "log.bag", chunk=4096),
        write_mcap(of_recording(log), folder / "log.mcap", chunk=4096, compression=CompressionType.NONE),
        write_mcap(states, folder / "states.mcap", chunk=4096),
        *write_folder(states, folder / "states").glob("*.db3"),
    ]


@pytest.mark.parametrize(
    ("kind", "old", "new"),
    [
        ("table.parquet", b"a.position", b"\xf2.position"),  # a name that is not UTF-8
        ("log.bag", b"time=", b"tyme="),  # headers without their fields
        ("log.bag", b"type=", b"tipe="),
    ],
)
def test_a_log_without_its_headers_is_named(tmp_path: Path, kind: str, old: bytes, new: bytes) -> None:
    log = next(path for path in logs(tmp_path) if path.name == kind)
    log.write_bytes(log.read_bytes().replace(old, new))
    with pytest.raises(RecordingError, match=kind):
        read(log)


def test_a_damaged_definition_of_lowstate_is_replaced_by_the_published_one(tmp_path: Path) -> None:
    log = next(path for path in logs(tmp_path) if path.name == "states.mcap")
    whole = read(log)
    log.write_bytes(log.read_bytes().replace(b"float32 tau_est", b"fl\xffat32 tau_est"))
    np.testing.assert_array_equal(read(log).effort, whole.effort)
