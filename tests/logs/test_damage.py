"""Logs with bytes changed, lost or added: read as far as they go, or refused by an error of our own."""

from __future__ import annotations

import random
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType

from bags import low_state, of_recording, write_folder, write_mcap, write_ros1
from stadera.errors import RecordingError, StaderaError
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


def damaged(content: bytes, draw: random.Random) -> bytes:
    """Some bits turned, bytes changed, lost or added, often near the beginning, where headers are."""
    out = bytearray(content)
    for _ in range(draw.choice([1, 1, 2, 5, 20])):
        at = draw.randrange(len(out) if draw.random() < 0.6 else min(len(out), 400))
        match draw.randrange(5):
            case 0 | 1:
                out[at] ^= 1 << draw.randrange(8)
            case 2:
                out[at] = draw.choice([0, 1, 127, 128, 255])
            case 3:
                del out[at + 30 : at + 30 + draw.randrange(1, 64)]
            case 4:
                out[at:at] = draw.randbytes(draw.randrange(1, 32))
    return bytes(out[: draw.randrange(30, len(out))] if draw.random() < 0.1 else out)


@pytest.mark.parametrize("seed", range(4))
def test_damage_never_ends_in_an_error_of_another_library(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    for log in logs(tmp_path):
        content = log.read_bytes()
        for _ in range(50):
            log.write_bytes(damaged(content, draw))
            with suppress(StaderaError):
                read(log)


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
