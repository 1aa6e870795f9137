"""Files of every kind, damaged or absurd: read as far as they go, or refused by an error that names the file."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from bags import low_state, write_folder
from mutants import KINDS, SAMPLES, mutant, plain
from robot.robot_files import mjcf, quadruped
from stadera.boundary import foreign
from stadera.errors import ModelError, RecordingError, StaderaError
from stadera.identify.schema import with_identified_legs
from stadera.logs import Recording, read
from stadera.logs.frames import columns_of
from stadera.robot import load_robot


@pytest.mark.parametrize("kind", KINDS)
def test_a_mutant_is_read_or_refused_in_one_line(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    said: list[str] = []
    seeds = 5 if kind == "mat" else 40  # a process for each
    for seed in range(seeds):
        path = mutant(kind, seed, tmp_path)
        try:
            KINDS[kind].read(path)
        except StaderaError as error:
            said.append(str(error).replace(path.name, "FILE"))
        path.unlink()
    assert 0 < len(said) < seeds
    assert [text for text in said if ("FILE" not in text and kind != "map") or "\n" in text] == []
    assert os.listdir(tmp_path) == []


def test_parquet_statistics_that_contradict_a_column_do_not_end_the_process(tmp_path: Path) -> None:
    path = mutant("parquet", 700192, tmp_path)  # pyarrow's own reader of the footer calls std::terminate on it
    with pytest.raises(RecordingError, match="damaged Parquet file"):
        read(path)


def test_errors_of_others_name_file_and_step_and_our_own_pass() -> None:
    with (
        pytest.raises(ModelError, match=r"^a\.xml: reading links: it has no 'mass'$"),
        foreign("a.xml", "reading links", ModelError),
    ):
        _ = {}["mass"]
    with pytest.raises(RecordingError, match=r"^b: opening: a message of two lines$"), foreign("b", "opening"):
        raise OverflowError("a message\nof \x1btwo lines")
    with pytest.raises(ModelError, match=r"^as it is$"), foreign("c", "opening"):
        raise ModelError("as it is")
    with pytest.raises(KeyboardInterrupt), foreign("d", "opening"):
        raise KeyboardInterrupt


# -- paths ------------------------------------------------------------------------------------------------------------
READERS: dict[str, Callable[[Path], object]] = {
    "log": read,
    "robot": load_robot,
    "legs": lambda path: with_identified_legs(load_robot("hyq"), path),
}


@pytest.mark.parametrize("reader", READERS)
def test_paths_that_are_no_files_are_refused(tmp_path: Path, reader: str) -> None:
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    os.mkfifo(tmp_path / "pipe.csv")
    for name in (
        "loop.csv",
        "pipe.csv",
        "x" * 300,
        "a\0b",
        "nowhere.csv",
        "/".join(["d"] * 3000),
        os.fsdecode(b"\xff.csv"),
    ):
        with pytest.raises(StaderaError):
            READERS[reader](tmp_path / name)


def test_a_folder_with_a_pipe_in_it_is_no_bag(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "log.mcap")
    with pytest.raises(RecordingError, match="directory"):
        read(tmp_path)


# -- tables -----------------------------------------------------------------------------------------------------------
def _table(path: Path, **changed: object) -> Path:
    parquet.write_table(pa.table({**columns_of(plain()), **changed}), path)
    return path


def test_integers_beyond_doubles_are_rounded(tmp_path: Path) -> None:
    stamps = pa.array([2**53 + 2 * k + 1 for k in range(SAMPLES)], pa.int64())
    with pytest.raises(RecordingError, match=r"column 'time' is 9\.01e\+15 at sample 0, more than any sensor"):
        read(_table(tmp_path / "log.parquet", time=stamps))


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [("a.velocity", 1e8, "1e\\+08"), ("b.effort", -1e12, "-1e\\+12"), ("imu.angular_velocity.x", 1e5, "1e\\+05")],
)
def test_values_beyond_any_robot_are_refused(tmp_path: Path, column: str, value: float, said: str) -> None:
    values = columns_of(plain())[column].copy()
    values[7] = value
    with pytest.raises(RecordingError, match=f"{column}.* is {said} at sample 7, more than any sensor"):
        read(_table(tmp_path / "log.parquet", **{column: values}))


def test_values_beyond_any_robot_in_own_arrays_are_refused() -> None:
    effort = np.zeros((3, 2))
    effort[2, 1] = 1e12
    with pytest.raises(RecordingError, match=r"'b\.effort' is 1e\+12 at sample 2, more than any sensor"):
        Recording.from_arrays(np.arange(3.0), np.zeros((3, 2)), effort=effort, joints=["a", "b"])


def test_names_that_cannot_be_printed_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be printed"):
        read(_table(tmp_path / "log.parquet", **{"\x1b[2Jevil.position": np.zeros(SAMPLES)}))


# -- bags -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("statement", "lost"),
    [
        ("UPDATE messages SET timestamp = 'noon' WHERE id = 3", 1),
        ("UPDATE messages SET data = 42 WHERE id = 5", 1),
        ("UPDATE messages SET timestamp = 9223372036854775807 WHERE id = 7", 1),
    ],
)
def test_rows_of_odd_types_are_left_out_and_counted(tmp_path: Path, statement: str, lost: int) -> None:
    states = [low_state(1.7e9 + 0.002 * k, [k] * 12, [0] * 12, [0] * 12) for k in range(SAMPLES)]
    (path,) = write_folder(states, tmp_path / "bag").glob("*.db3")
    with closing(sqlite3.connect(path)) as database:
        database.execute(statement)
        database.commit()
    log = read(path)
    assert len(log) == SAMPLES - lost
    assert any("left out 1 damaged" in note for note in log.notes)


def test_a_definition_that_unpacks_without_end_is_refused(tmp_path: Path) -> None:
    states = [low_state(1.7e9 + 0.002 * k, [k] * 12, [0] * 12, [0] * 12) for k in range(SAMPLES)]
    (path,) = write_folder(states, tmp_path / "bag").glob("*.db3")
    with closing(sqlite3.connect(path)) as database:
        database.execute("UPDATE message_definitions SET encoded_message_definition = 'uint32[999999999] x'")
        database.commit()
    with pytest.raises(RecordingError, match="more than 10000 numbers"):
        read(path)


# -- models -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("text", [quadruped(), mjcf()])
def test_an_unknown_encoding_of_xml_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.xml"
    path.write_text('<?xml version="1.0" encoding="ebcdic-zz"?>' + text.removeprefix('<?xml version="1.0"?>'))
    with pytest.raises(ModelError, match=r"robot\.xml.*not XML: unknown encoding"):
        load_robot(path)


def test_mujoco_leaves_no_log_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "robot.xml"
    path.write_text(mjcf().replace('size="0.3 0.15 0.1"', 'size="nan 0.15 0.1"'))
    with pytest.raises(ModelError, match=r"robot\.xml"):
        load_robot(path)
    assert [p.name for p in tmp_path.iterdir()] == ["robot.xml"]


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"links": {"a": {"mass": {"value": 1' + "0" * 400 + "}}}}", "{}", "3"]
)
def test_legs_that_are_no_identification_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "legs.json"
    path.write_text(text)
    with pytest.raises(ModelError, match=r"legs\.json: not the JSON of an identification"):
        with_identified_legs(load_robot("hyq"), path)
