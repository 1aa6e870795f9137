"""Small files that would take gigabytes or for ever, refused by the limit that they break, which can be raised."""

from __future__ import annotations

import gzip
import resource
import sqlite3
import zipfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import zstandard
from mcap.writer import CompressionType, Writer
from pyarrow import parquet
from rosbags.rosbag1 import Writer as Ros1Writer
from scipy.io import savemat

from bags import IMU, JOINT_STATE, TYPES, Sent, joints, write_folder, write_mcap, write_ros1
from robot.robot_files import mjcf, quadruped, urdf_joint, urdf_link
from stadera.errors import ModelError, RecordingError, StaderaError, UnknownNameError
from stadera.limits import DEFAULTS, Budget, LimitError, Limits
from stadera.logs import LogFile, read, stream
from stadera.logs.batches import within
from stadera.logs.topics import ReadOptions
from stadera.robot import load_robot

ZEROS = bytes(1 << 20)
SMALL = Limits(unpacked=5e5, columns=50, elements=200, depth=20, seconds=0.05, seconds_per_megabyte=0.1)


def limited(path: Path, limits: Limits = SMALL) -> LogFile:
    return LogFile(path, reading=ReadOptions(limits=limits))


def states(count: int = 30) -> list[Sent]:
    return [joints(1.0 + 0.01 * k, ["a", "b"], [k, k], [0, 0], [1, 1]) for k in range(count)]


# -- bytes ------------------------------------------------------------------------------------------------------------
def _mcap(folder: Path, compression: CompressionType) -> Path:
    bomb = Sent("/chatter", IMU, 2, ZEROS)
    return write_mcap([*states(), bomb], folder / "log.mcap", chunk=1 << 21, compression=compression)


def _ros1(folder: Path, compression: object) -> Path:
    path = folder / "log.bag"
    writer = Ros1Writer(path)
    writer.set_compression(compression)  # type: ignore[arg-type]
    with writer:
        connection = writer.add_connection("/joint_states", JOINT_STATE, msgdef="Header header", md5sum="0" * 32)
        writer.write(connection, 1, ZEROS)
    return path


def _parquet(folder: Path) -> Path:
    """A page of a million equal values; dictionary encoding is off, so that the page has them all."""
    table = {"time": np.arange(200_000.0), "a.position": np.zeros(200_000)}
    options = {"use_dictionary": False, "data_page_size": 1 << 24, "max_rows_per_page": 200_000, "compression": "zstd"}
    parquet.write_table(pa.table(table), folder / "log.parquet", **options)
    return folder / "log.parquet"


def _npz(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "log.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in (
            ("time", np.arange(60_000.0)),
            ("position", np.zeros((60_000, 2), order="F")),
            ("joints", np.array(["a", "b"])),
        ):
            with archive.open(f"{name}.npy", "w") as file:
                np.lib.format.write_array(file, array)
    return folder / "log.npz"


def _mat(folder: Path) -> Path:
    savemat(folder / "log.mat", {"time": np.arange(1e6), "a_position": np.zeros(1_000_000)}, do_compression=True)
    return folder / "log.mat"


BOMBS: dict[str, Callable[[Path], Path]] = {
    "mcap, zstd": lambda folder: _mcap(folder, CompressionType.ZSTD),
    "mcap, lz4": lambda folder: _mcap(folder, CompressionType.LZ4),
    "ros1, bz2": lambda folder: _ros1(folder, Ros1Writer.CompressionFormat.BZ2),
    "ros1, lz4": lambda folder: _ros1(folder, Ros1Writer.CompressionFormat.LZ4),
    "parquet": _parquet,
    "npz": _npz,
}


@pytest.mark.parametrize("name", BOMBS)
def test_what_unpacks_to_more_than_allowed_is_refused(tmp_path: Path, name: str) -> None:
    path = BOMBS[name](tmp_path)
    with pytest.raises(LimitError, match=rf"{path.name}.* unpacks to: .*--limit unpacked=.* raises"):
        read(limited(path, Limits(unpacked=5e5, ratio=1.0)))


def test_the_default_limits_hold_by_themselves(tmp_path: Path) -> None:
    """A chunk of 600 MB in 60 kB: refused without taking a tenth of that."""
    path, frame = tmp_path / "log.mcap", zstandard.ZstdCompressor().compressobj(size=600 << 20)
    packed = b"".join([*(frame.compress(ZEROS) for _ in range(600)), frame.flush()])
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 30, compression=CompressionType.ZSTD, enable_crcs=False)
        writer.start()
        schema = writer.register_schema(JOINT_STATE, "ros2msg", TYPES.generate_msgdef(JOINT_STATE)[0].encode())
        channel = writer.register_channel("/joint_states", "cdr", schema)
        writer.add_message(channel, 1, b"\0" * 100, 1)
        writer.finish()
    content = path.read_bytes()
    at = content.index(b"\x28\xb5\x2f\xfd") - 8
    stored = int.from_bytes(content[at : at + 8], "little")
    start = content.rindex(b"\x06", 0, at)  # the chunk's record
    length = int.from_bytes(content[start + 1 : start + 9], "little") - stored + len(packed)
    head = (
        content[: start + 1]
        + length.to_bytes(8, "little")
        + content[start + 9 : at]
        + len(packed).to_bytes(8, "little")
    )
    path.write_bytes(head + packed + content[at + 8 + stored :])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(LimitError, match=r"unpacks to: 6\.29146e\+08, and at most 2\.56e\+08 are read"):
        read(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 60_000  # kB


def test_a_log_that_is_too_large_for_its_file_is_not_put_together_in_memory(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    rows = 400_000
    table = {"time": np.arange(float(rows)), **{f"{j}.position": np.zeros(rows) for j in "abcdefgh"}}
    parquet.write_table(
        pa.table(table), path, compression="zstd", column_encoding=dict.fromkeys(table, "PLAIN"), use_dictionary=False
    )
    with pytest.raises(LimitError, match=r"bytes of the log in memory: .*--limit unpacked="):
        read(limited(path, Limits(unpacked=4e6, ratio=1.0)))
    assert sum(map(len, stream(limited(path, Limits(unpacked=4e6, ratio=1.0))))) == rows
    assert len(read(path)) == rows


def test_a_matlab_file_is_unpacked_within_limits(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"log\.mat: damaged MATLAB file: MemoryError"):
        read(limited(_mat(tmp_path), Limits(unpacked=1e6, ratio=0.1)))


def test_a_message_that_was_compressed_on_its_own(tmp_path: Path) -> None:
    packed = zstandard.compress(bytes(300 << 20))
    sent = [message._replace(data=packed) if k == 3 else message for k, message in enumerate(states())]
    with pytest.raises(LimitError, match=r"a message: bytes that it unpacks to: 3\.14573e\+08"):
        read(write_mcap(sent, tmp_path / "log.mcap"))


# -- columns ----------------------------------------------------------------------------------------------------------
def _wide(path: Path, columns: int) -> Path:
    names = ",".join(["time", *(f"j{k}.position" for k in range(columns))])
    row = ",".join("0" * columns)
    path.write_text(f"{names}\n0,{row}\n1,{row}\n")
    return path


def test_columns_are_counted_before_they_are_looked_at(tmp_path: Path) -> None:
    with pytest.raises(
        LimitError, match=r"log\.csv: columns: 50001, and at most 10000 are read; --limit columns=1e\+05"
    ):
        read(_wide(tmp_path / "log.csv", 50_000))
    assert len(read(_wide(tmp_path / "log.csv", 9_000)).joints) == 9_000


def test_joints_of_a_message_are_columns(tmp_path: Path) -> None:
    names = [f"j{k}" for k in range(40)]
    sent = [joints(1.0 + 0.01 * k, names, [0.0] * 40) for k in range(5)]
    for path in (write_mcap(sent, tmp_path / "log.mcap"), write_ros1(sent, tmp_path / "log.bag")):
        with pytest.raises(LimitError, match="columns: 120, and at most 50"):
            read(limited(path, replace(SMALL, seconds=10.0)))


def test_an_array_whose_header_promises_too_many_columns(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1099511627776, 1099511627776), }"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("x.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(LimitError, match="columns"):
        read(path)


# -- time -------------------------------------------------------------------------------------------------------------
ENDLESS = (
    "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n) "
    "SELECT id, 99 AS topic_id, id AS timestamp, x'00' AS data FROM n"
)


def test_a_view_in_place_of_the_messages_is_refused(tmp_path: Path) -> None:
    (path,) = write_folder(states(), tmp_path / "bag").glob("*.db3")
    with closing(sqlite3.connect(path)) as database:
        database.execute("ALTER TABLE messages RENAME TO old")
        database.execute(ENDLESS)
        database.commit()
    with pytest.raises(RecordingError, match="messages is no table"):
        read(path)


def test_a_query_that_takes_too_long_is_broken_off(tmp_path: Path) -> None:
    (path,) = write_folder(states(), tmp_path / "bag").glob("*.db3")
    with closing(sqlite3.connect(path)) as database:
        # rows that are computed when they are read
        database.execute("DROP TABLE messages")
        endless = "(WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT max(i) FROM n)"
        database.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
        database.execute(f"CREATE VIEW message_definitions2 AS SELECT {endless} AS topic_type")
        database.execute("DROP TABLE IF EXISTS message_definitions")
        database.execute(
            f"CREATE VIEW message_definitions AS SELECT {endless} AS topic_type, 1 AS encoded_message_definition"
        )
        database.commit()
    with pytest.raises(StaderaError, match=r"more than .* s of processor time|no message"):
        read(limited(path))


def test_reading_has_a_time_that_its_consumer_does_not_count_against(tmp_path: Path) -> None:
    path = write_mcap(states(4000), tmp_path / "log.mcap")
    with pytest.raises(LimitError, match=r"more than .* s of processor time; --limit seconds="):
        read(limited(path, Limits(seconds=0.002, seconds_per_megabyte=1e-6)))
    budget = Budget(path, Limits(seconds=0.2, seconds_per_megabyte=1e-6))
    for _ in within(np.zeros((3, 1)), budget, 1):
        _burn(0.15)
    with pytest.raises(LimitError):
        list(within(map(np.atleast_1d, (_burn(0.15) for _ in range(3))), budget, 1))


def _burn(seconds: float) -> float:
    import time

    until = time.thread_time() + seconds
    while time.thread_time() < until:
        pass
    return until


# -- models -----------------------------------------------------------------------------------------------------------
def _chain(links: int) -> str:
    joints_ = (urdf_joint(f"j{k}", f"l{k}" if k else "base", f"l{k + 1}", "0 0 0.1", "1 0 0") for k in range(links))
    return "".join([*joints_, *(urdf_link(f"l{k + 1}") for k in range(links))])


def _nested(depth: int) -> str:
    return "<a>" * depth + "</a>" * depth


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("long.urdf", quadruped().replace("</robot>", _chain(150) + "</robot>"), "joints one behind the other: 101"),
        ("wide.urdf", quadruped().replace("</robot>", "<link/>" * 20_001 + "</robot>"), "elements: 20001"),
        ("deep.urdf", f"<robot>{_nested(5000)}</robot>", "elements in each other: 101"),
        ("copies.xml", '<replicate count="1000">' * 3 + "<geom/>" + "</replicate>" * 3, "with all copies"),
        ("array.xml", '<custom><numeric name="x" size="99999999999"/></custom>', "numbers of <numeric>"),
        ("ring.xml", '<include file="ring.xml"/>' * 3, None),
    ],
)
def test_models_beyond_sense_are_refused(tmp_path: Path, name: str, text: str, said: str | None) -> None:
    path = tmp_path / name
    path.write_text(mjcf(text) if name.endswith(".xml") else text)
    with pytest.raises(ModelError if said is None else LimitError, match=said or name):
        load_robot(path)


def test_included_files_count(tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_text(f"<mujoco>{'<geom/>' * 300}</mujoco>")
    path = tmp_path / "robot.xml"
    path.write_text(mjcf('<include file="part.xml"/>'))
    with pytest.raises(LimitError, match="with all copies and included files"):
        load_robot(path, Limits(elements=310))


@pytest.mark.parametrize("name", ["bomb.urdf", "bomb.xml"])
def test_entities_are_not_read(tmp_path: Path, name: str) -> None:
    levels = "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * 10}">' for k in range(9))
    text = f'<!DOCTYPE robot [<!ENTITY e0 "x">{levels}]><robot name="&e9;"/>'
    (tmp_path / name).write_text(text)
    with pytest.raises(ModelError, match="a DOCTYPE"):
        load_robot(tmp_path / name)


def test_a_raised_limit_lets_a_file_in(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(quadruped())
    with pytest.raises(LimitError, match="--limit elements=1e\\+02"):
        load_robot(path, Limits(elements=50))
    assert load_robot(path, Limits.parse(["elements=200"])).mass == load_robot(path).mass


def test_limits_are_parsed_by_name() -> None:
    assert Limits.parse(["seconds=60", "columns=1e5"]) == replace(DEFAULTS, seconds=60.0, columns=1e5)
    with pytest.raises(UnknownNameError, match="valid: unpacked, ratio, columns"):
        Limits.parse(["memory=3"])
    for wrong in ("seconds", "seconds=many", "seconds=-1", "seconds=nan"):
        with pytest.raises(StaderaError):
            Limits.parse([wrong])


def test_a_packed_table_is_read_in_pieces(tmp_path: Path) -> None:
    path = tmp_path / "log.csv.gz"
    with gzip.open(path, "wb") as file:
        file.write(b"time,a.position\n0,1\n1,2\n" + b"\n" * (64 << 20))
    assert len(read(path)) == 2
