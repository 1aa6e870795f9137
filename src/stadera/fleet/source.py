"""Locations of logs: on disk, or at any URL that fsspec reads (s3://, gs://, az://, https://, sftp://, ...), and which
robot they are of.

A log is a file, or a folder that is a bag. A log at a URL is fetched into a temporary folder and deleted after use. A
Parquet table names its robot under the key "robot" of its metadata; a rosbag2 folder in its metadata.yaml, as written
by `ros2 bag record --custom-data robot=go2`.
"""

import hashlib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from glob import glob, has_magic
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from stadera.boundary import foreign
from stadera.errors import MissingExtraError, RecordingError
from stadera.logs.topics import LogFile


def is_url(address: str) -> bool:
    """True if an address is a URL instead of a path on disk."""
    return "://" in address


def expanded(pattern: str) -> list[str]:
    """The addresses named by a path, a URL or a glob, sorted; paths are absolute.

    A path, URL or example's name without wildcards is returned as it is, whether it exists or not. Globs do not match
    the ground truth that `simulate` writes next to its logs.

    Raises:
        RecordingError: a glob matches nothing, or a location cannot be listed.
        MissingExtraError: a URL is given, and fsspec or the package it needs for that protocol is not installed.
    """
    if not has_magic(pattern):
        return [pattern if is_url(pattern) else str(LogFile.of(pattern).path.absolute())]
    if is_url(pattern):
        system, path = _system(pattern)
        with foreign(pattern, "cannot be fetched"):
            found = [str(system.unstrip_protocol(name)) for name in system.glob(path)]
    else:
        found = [str(Path(name).absolute()) for name in glob(pattern, recursive=True)]
    found = sorted(name for name in found if ".truth." not in Path(name).name)
    if not found:
        raise RecordingError(f"{pattern}: matches no log")
    return found


@contextmanager
def fetched(address: str) -> Iterator[Path]:
    """Yields the log on this machine's disk for as long as it is used. RecordingError if it cannot be fetched,
    MissingExtraError as `expanded`.
    """
    if not is_url(address):
        if not Path(address).exists():
            raise RecordingError(f"{address}: no such file")
        yield Path(address)
        return
    system, path = _system(address)
    with TemporaryDirectory(prefix="stadera-") as folder:
        copy = Path(folder) / path.rstrip("/").rpartition("/")[2]
        with foreign(address, "cannot be fetched"):
            whole = system.isdir(path)
            system.get(path.rstrip("/") + "/" * whole, str(copy) + "/" * whole, recursive=whole)
        yield copy


def digest(path: Path) -> str:
    """SHA-256 of a file's content; of a folder, of its files' names and contents."""
    if path.is_dir():
        total = hashlib.sha256()
        for part in sorted(part for part in path.rglob("*") if part.is_file()):
            total.update(f"{part.relative_to(path).as_posix()}\0{digest(part)}\0".encode())
        return total.hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _system(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it."""
    try:
        from fsspec.core import url_to_fs  # type: ignore[import-untyped]
    except ImportError:
        raise MissingExtraError("fsspec", "fleet", f"a log at {url}") from None
    try:
        system, path = url_to_fs(url)
    except ImportError as error:  # fsspec's own, of the package for that protocol
        raise RecordingError(f"{url}: {error}") from None
    except ValueError as error:
        raise RecordingError(f"{url}: not a URL that can be read: {error}") from None
    return system, str(path)


KEY = "robot"
_CUSTOM = re.compile(r"^\s+" + KEY + r":\s*['\"]?([^'\"\s]+)['\"]?\s*$", re.MULTILINE)


def robot_named_in(path: Path) -> str:
    """The robot's name, or its model file's path. Raises RecordingError: the log does not name it."""
    named = _of_bag(path) if path.is_dir() else _of_table(path)
    if not named:
        raise RecordingError(
            f"{path}: which robot's log it is, its metadata do not say: name it by --robot, or in a manifest"
        )
    return named


def _of_table(path: Path) -> str | None:
    import pyarrow as pa
    from pyarrow import parquet

    try:
        metadata = parquet.read_schema(path).metadata or {}
    except (pa.ArrowException, OSError, ValueError):
        return None
    return metadata.get(KEY.encode(), b"").decode() or None


def _of_bag(path: Path) -> str | None:
    listed = path / "metadata.yaml"
    if not listed.is_file():
        return None
    _, _, custom = listed.read_text(encoding="utf-8").partition("custom_data:")
    found = _CUSTOM.search(custom)
    return found and found[1]
