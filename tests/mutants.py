"""Small files of every kind that is read, and seeded mutants of them: bytes changed, numbers and structure made absurd.

A mutant is `(kind, seed)`: the same pair gives the same file. `KINDS` says how each kind is made and what reads it.
"""

from __future__ import annotations

import gzip
import json
import random
import re
import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
from mcap.writer import CompressionType
from pyarrow import parquet
from rosbags.rosbag1 import Writer as Ros1Writer
from scipy.io import savemat

from bags import low_state, of_recording, write_folder, write_mcap, write_ros1
from robot.robot_files import mjcf, quadruped
from stadera.identify.schema import with_identified_legs
from stadera.logs import Imu, Recording, read, write_table
from stadera.logs.foreign.column_map import column_map
from stadera.logs.frames import columns_of
from stadera.robot import load_robot

SAMPLES = 40
_ABSURD = [0.0, -0.0, 1e-320, 1e8, -1e12, 1e14, 1e15, 1e300, -1e308, float("nan"), float("inf"), 2.0**63, -1.0]
_WORDS = (
    *("nan", "-inf", "1e400", "1e999999999", "", " ", "0,05", "1_000", "0x10", "٣", "1.0.0", "-", "9" * 400, "null"),
    *(
        "true",
        "18446744073709551616",
        "-1",
        "1e-400",
        "1 2",
        "\ufeff",
        "\x00",
        "é" * 60,
        "../../etc/passwd",
        "%s%n",
        "{}",
    ),
)


@dataclass(frozen=True)
class Kind:
    """A kind of file: how mutants of it are made, what reads it, and the ending of its name."""

    suffix: str
    make: Callable[[random.Random], bytes]
    read: Callable[[Path], object]


def mutant(kind: str, seed: int, folder: Path) -> Path:
    """The file of this kind and seed."""
    path = folder / f"{kind}-{seed}{KINDS[kind].suffix}"
    path.write_bytes(KINDS[kind].make(random.Random(f"{kind} {seed}")))
    return path


def damaged(content: bytes, draw: random.Random) -> bytes:
    """Some bits turned, bytes changed, lost or added, often near the beginning or the end, where headers are."""
    out = bytearray(content)
    for _ in range(draw.choice([1, 1, 2, 5, 20])):
        near = min(len(out), 400)
        at = draw.choice([draw.randrange(len(out)), draw.randrange(near), len(out) - 1 - draw.randrange(near)])
        match draw.randrange(7):
            case 0 | 1:
                out[at] ^= 1 << draw.randrange(8)
            case 2:
                out[at] = draw.choice([0, 1, 127, 128, 255])
            case 3:
                del out[at + 1 : at + 1 + draw.randrange(1, 64)]
            case 4:
                out[at:at] = draw.randbytes(draw.randrange(1, 32))
            case 5:  # a length
                size = draw.choice([2, 4, 8])
                value = draw.choice([0, 1, 0x7F, 0x7FFFFFFF, 0xFFFFFFFF, 2**63 - 1, 2**64 - 1, 2**40])
                out[at : at + size] = (value % (1 << 8 * size)).to_bytes(size, draw.choice(["little", "big"]))
            case 6:
                part = bytes(out[at : at + draw.randrange(1, 200)])
                out[at:at] = part * draw.choice([1, 1, 3])
        out = out or bytearray(b"\0")
    return bytes(out[: draw.randrange(1, len(out) + 1)] if draw.random() < 0.1 else out)


def reworded(text: str, draw: random.Random, token: str) -> str:
    """Some tokens of a text replaced by absurd ones, or swapped."""
    places = [m.span() for m in re.finditer(token, text)]
    for _ in range(draw.choice([1, 1, 2, 6])):
        begin, end = draw.choice(places)
        other = slice(*draw.choice(places))
        word = draw.choice([draw.choice(_WORDS), repr(draw.choice(_ABSURD)), text[other]])
        text = text[:begin] + word + text[end:]
        places = [m.span() for m in re.finditer(token, text)] or [(0, 0)]
    return text


# -- signals ----------------------------------------------------------------------------------------------------------
@cache
def plain() -> Recording:
    """Two joints and an IMU, noise."""
    rng = np.random.default_rng(0)
    values = rng.normal(size=(3, SAMPLES, 2))
    imu = Imu(*rng.normal(size=(2, SAMPLES, 3)), rng.normal(size=(SAMPLES, 4)), frame="imu")
    return Recording(1e3 + 0.002 * np.arange(SAMPLES), ("a", "b"), values[0], values[1], effort=values[2], imu=imu)


def _columns(draw: random.Random) -> dict[str, Any]:
    """Of a table, some of them absurd in value, type, name or length."""
    columns: dict[str, Any] = {name: np.array(values) for name, values in columns_of(plain()).items()}
    for _ in range(draw.choice([1, 1, 2, 4])):
        name = draw.choice([n for n in columns if isinstance(columns[n], np.ndarray)] or ["time"])
        at = draw.randrange(SAMPLES)
        match draw.randrange(7):
            case 0:
                columns[name][at:] = draw.choice(_ABSURD)
            case 1:
                columns[name][at] = draw.choice(_ABSURD)
            case 2:
                columns[name] = draw.choice(_TYPES)(columns[name])
            case 3:
                columns[draw.choice(_WORDS) + name] = columns.pop(name)
            case 4:
                columns.pop(name)
            case 5:
                columns[name] = columns[name] * draw.choice(_ABSURD)
            case 6:
                columns["time"] = draw.choice([lambda t: t[::-1], lambda t: t * 0, lambda t: t * 1e12, np.cumsum])(
                    np.asarray(columns_of(plain())["time"])
                )
        if not any(isinstance(values, np.ndarray) for values in columns.values()):
            break
    return columns


_TYPES: tuple[Callable[[Any], Any], ...] = (
    lambda v: pa.array([str(x) for x in v]),
    lambda v: pa.array([str(x) for x in v]).dictionary_encode(),
    lambda v: pa.array([int(x) % 2**64 if np.isfinite(x) else 0 for x in v], pa.uint64()),
    lambda v: pa.array([2**63 - 1 - k for k in range(len(v))], pa.int64()),
    lambda v: pa.array([1_700_000_000_000_000_000 + k for k in range(len(v))], pa.timestamp("ns")),
    lambda v: pa.array([[1.0, 2.0]] * len(v)),
    lambda v: pa.array([{"x": 1.0}] * len(v)),
    lambda v: pa.array([None] * len(v)),
    lambda v: pa.array([None if k % 3 else 1.0 for k in range(len(v))]),
    lambda v: pa.array([bool(x > 0) for x in v]),
    lambda v: pa.array([k * 10**20 for k in range(len(v))], pa.decimal128(38, 3)),
    lambda v: pa.array([bytes([k]) for k in range(len(v))]),
    lambda v: pa.array(np.zeros(len(v), dtype=np.float16)),
)


def _bytes_of(write: Callable[[Path], object], suffix: str) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"file{suffix}"
        write(path)
        if path.is_dir():
            path = next(path.glob("*.db3"))
        return path.read_bytes()


@cache
def _csv() -> str:
    return _bytes_of(lambda path: write_table(plain(), path), ".csv").decode()


def _make_csv(draw: random.Random) -> bytes:
    match draw.randrange(4):
        case 0:
            return damaged(_csv().encode(), draw)
        case 1 | 2:
            return reworded(_csv(), draw, r"[^,\n]+").encode("utf-8", "surrogatepass")
        case _:
            lines = _csv().splitlines(keepends=True)
            for _ in range(draw.choice([1, 3])):
                at = draw.randrange(len(lines))
                lines[at : at + draw.randrange(3)] = draw.choice([[], ["\n"], [lines[at]] * 2, [","], ['"'], ["\r\n"]])
                lines = lines or ["\n"]
            return draw.choice(["", "\ufeff", "#"]).encode() + "".join(lines).encode(draw.choice(["utf-8", "utf-16"]))


def _packed(content: bytes, draw: random.Random) -> bytes:
    return damaged(gzip.compress(content), draw) if draw.random() < 0.7 else gzip.compress(content)


@cache
def _parquet(compression: str) -> bytes:
    table = pa.table(columns_of(plain())).replace_schema_metadata({"imu.frame": "imu"})
    return _bytes_of(lambda path: parquet.write_table(table, path, compression=compression), ".parquet")


def _make_parquet(draw: random.Random) -> bytes:
    if draw.random() < 0.7:
        return damaged(_parquet(draw.choice(["none", "snappy", "zstd"])), draw)
    columns = _columns(draw)
    length = min(len(values) for values in columns.values())
    names = list(columns) + draw.choice([[], [], ["time"], [""]])
    arrays = [pa.array(values)[:length] for values in columns.values()]
    table = pa.table(arrays + arrays[:1] * (len(names) - len(arrays)), names=names)
    frame = draw.choice([b"imu", b"\xff\xfe", b"", b"x" * 10000])
    return _bytes_of(
        lambda path: parquet.write_table(table.replace_schema_metadata({b"imu.frame": frame}), path), ".parquet"
    )


def _arrays(draw: random.Random) -> dict[str, Any]:
    log = plain()
    assert log.imu is not None
    arrays: dict[str, Any] = dict(log.arrays().items()) | {"joints": list(log.joints)}
    for _ in range(draw.choice([0, 1, 2])):
        name = draw.choice(list(arrays))
        arrays[name] = draw.choice(
            [[], ["x"], np.zeros((3, 2, 2)), np.zeros(SAMPLES, dtype="c16"), [["a", "bb"]], 1.0, np.zeros((SAMPLES, 0))]
        )
    return arrays


def _make_npz(draw: random.Random) -> bytes:
    arrays = _arrays(draw)
    content = _bytes_of(lambda path: draw.choice([np.savez, np.savez_compressed])(path, **arrays), ".npz")
    return content if draw.random() < 0.2 else damaged(content, draw)


def _make_mat(draw: random.Random) -> bytes:
    arrays = {name.replace(".", "_"): values for name, values in _arrays(draw).items()} | {"s": {"a": [1, "x"]}}
    packed = draw.random() < 0.5
    content = _bytes_of(lambda path: savemat(path, arrays, do_compression=packed), ".mat")
    return content if draw.random() < 0.2 else damaged(content, draw)


_MAP = """
base = "plotjuggler"
joints = ["a", "b"]
[units]
position = "deg"
rate_hz = 500.0
[columns]
time = "__time"
"{joint}.position" = ["q_{joint}", { column = "/state/{i}", unit = "deg", factor = -1.5 }]
"imu.angular_velocity.{axis}" = "gyro_{axis}"
"""


def _make_map(draw: random.Random) -> bytes:
    if draw.random() < 0.3:
        return damaged(_MAP.encode(), draw)
    return reworded(_MAP, draw, draw.choice([r'"[^"]*"', r"[\w.]+", r"\S+"])).encode("utf-8", "surrogatepass")


# -- bags -------------------------------------------------------------------------------------------------------------
@cache
def _sent(kind: str) -> tuple[Any, ...]:
    if kind == "states":
        return tuple(low_state(1.7e9 + 0.002 * k, [k] * 12, [0] * 12, [0] * 12) for k in range(SAMPLES))
    return tuple(of_recording(plain()))


def _messages(draw: random.Random) -> list[Any]:
    """Of a bag, some damaged, out of order, or of another time."""
    sent = list(_sent(draw.choice(["states", "joints"])))
    for _ in range(draw.choice([1, 2, 10])):
        at = draw.randrange(len(sent))
        match draw.randrange(5):
            case 0 | 1:
                sent[at] = sent[at]._replace(data=damaged(sent[at].data, draw))
            case 2:
                sent[at] = sent[at]._replace(received=draw.choice([0, 1, 2**63 - 1, sent[at].received + 10**9]))
            case 3:
                sent[at] = sent[at]._replace(topic=draw.choice(["/x", "", "/" + "y" * 300]))
            case 4:
                other = draw.randrange(len(sent))
                sent[at], sent[other] = sent[other], sent[at]
    if draw.random() < 0.3:  # all alike
        sent = [message._replace(data=damaged(message.data, random.Random(len(sent)))) for message in sent]
    return sent


@cache
def _mcap(kind: str, compression: CompressionType) -> bytes:
    return _bytes_of(lambda path: write_mcap(_sent(kind), path, chunk=4096, compression=compression), ".mcap")


def _make_mcap(draw: random.Random) -> bytes:
    compression = draw.choice(list(CompressionType))
    if draw.random() < 0.5:
        return damaged(_mcap(draw.choice(["states", "joints"]), compression), draw)
    sent = _messages(draw)
    return _bytes_of(lambda path: write_mcap(sent, path, chunk=4096, compression=compression), ".mcap")


@cache
def _db3(kind: str) -> bytes:
    return _bytes_of(lambda path: write_folder(_sent(kind), path), "")


_SQL = (
    "UPDATE messages SET timestamp = 'noon' WHERE id = 3",
    "UPDATE messages SET timestamp = NULL",
    "UPDATE messages SET timestamp = -1 WHERE id > 5",
    "UPDATE messages SET timestamp = 1e300",
    "UPDATE messages SET data = NULL WHERE id % 3 = 0",
    "UPDATE messages SET data = 42",
    "UPDATE messages SET data = 'text' WHERE id = 2",
    "UPDATE messages SET data = x''",
    "UPDATE messages SET data = zeroblob(100000) WHERE id = 2",
    "UPDATE messages SET topic_id = NULL",
    "UPDATE messages SET topic_id = 'one' WHERE id = 1",
    "UPDATE topics SET id = NULL",
    "UPDATE topics SET name = NULL",
    "UPDATE topics SET name = x'ff00'",
    "UPDATE topics SET type = 7",
    "UPDATE topics SET type = NULL",
    "UPDATE topics SET serialization_format = NULL",
    "UPDATE message_definitions SET encoded_message_definition = NULL",
    "UPDATE message_definitions SET encoded_message_definition = x'ff'",
    "UPDATE message_definitions SET encoded_message_definition = 'float32[4'",
    "UPDATE message_definitions SET encoded_message_definition = 'uint32[999999999] x'",
    "DELETE FROM topics",
    "DELETE FROM messages",
    "DROP TABLE messages",
    "ALTER TABLE messages RENAME COLUMN data TO stuff",
    "ALTER TABLE messages RENAME TO old",
    "CREATE VIEW messages AS SELECT * FROM old",
    "INSERT INTO topics SELECT id + 10, name, type, serialization_format, offered_qos_profiles, '' FROM topics",
)


def _make_db3(draw: random.Random) -> bytes:
    content = _db3(draw.choice(["states", "joints"]))
    if draw.random() < 0.5:
        return damaged(content, draw)

    def write(path: Path) -> None:
        path.write_bytes(content)
        with closing(sqlite3.connect(path)) as database:
            for statement in draw.sample(_SQL, draw.choice([1, 1, 2, 4])):
                with suppress(sqlite3.Error):
                    database.execute(statement)
            database.commit()

    return _bytes_of(write, ".db3")


@cache
def _ros1(compression: Any) -> bytes:
    return _bytes_of(lambda path: write_ros1(_sent("joints"), path, chunk=4096, compression=compression), ".bag")


def _make_ros1(draw: random.Random) -> bytes:
    return damaged(_ros1(draw.choice([None, *Ros1Writer.CompressionFormat])), draw)


# -- models -----------------------------------------------------------------------------------------------------------
_XML_TOKEN = r'(?<==")[^"]*(?=")|<[^<>]*>'


def _make_xml(text: str) -> Callable[[random.Random], bytes]:
    def make(draw: random.Random) -> bytes:
        if draw.random() < 0.3:
            return damaged(text.encode(), draw)
        changed = reworded(text, draw, draw.choice([_XML_TOKEN, r'(?<==")[-\d. ]*(?=")']))
        if draw.random() < 0.1:
            changed = (
                f'<?xml version="1.0" encoding="{draw.choice(["utf-7", "ebcdic", "latin-1", "x", "utf-16"])}"?>'
                + (changed.removeprefix('<?xml version="1.0"?>'))
            )
        return changed.encode("utf-8", "surrogatepass")

    return make


@cache
def _legs() -> str:
    """As `identify --json` writes it, as far as it is read."""

    def q(value: float) -> dict[str, Any]:
        return {"prior": value, "value": value, "std": None, "observability": "measured"}

    links, joints = {}, {}
    for leg in (robot := load_robot("hyq")).legs:
        for link in leg.links:
            body = robot.inertias[link]
            inertia = dict(zip(("xx", "xy", "xz", "yy", "yz", "zz"), map(q, body.vector[4:].tolist()), strict=True))
            links[link] = {"mass": q(body.mass), "com": [q(x) for x in body.com.tolist()], "inertia": inertia}
        joints |= {
            joint: {name: q(0.1) for name in ("armature", "viscous", "coulomb", "offset")} for joint in leg.joints
        }
    return json.dumps({"links": links, "joints": joints})


def _make_legs(draw: random.Random) -> bytes:
    if draw.random() < 0.3:
        return damaged(_legs().encode(), draw)
    if draw.random() < 0.05:
        return b"[" * 100_000
    return reworded(_legs(), draw, draw.choice([r"-?\d[\d.e+-]*", r'"[^"]*"', r"\{[^{}]*\}"])).encode(
        "utf-8", "surrogatepass"
    )


def _read_legs(path: Path) -> object:
    return with_identified_legs(load_robot("hyq"), path)


KINDS: dict[str, Kind] = {
    "csv": Kind(".csv", _make_csv, read),
    "parquet": Kind(".parquet", _make_parquet, read),
    "csv.gz": Kind(".csv.gz", lambda draw: _packed(_make_csv(draw), draw), read),
    "npz": Kind(".npz", _make_npz, read),
    "mat": Kind(".mat", _make_mat, read),
    "map": Kind(".toml", _make_map, column_map),
    "mcap": Kind(".mcap", _make_mcap, read),
    "db3": Kind(".db3", _make_db3, read),
    "ros1": Kind(".bag", _make_ros1, read),
    "urdf": Kind(".urdf", _make_xml(quadruped()), load_robot),
    "mjcf": Kind(".xml", _make_xml(mjcf()), load_robot),
    "legs": Kind(".json", _make_legs, _read_legs),
}
