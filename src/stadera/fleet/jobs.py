"""Jobs of a fleet, one for each log: from paths, URLs and globs, or from a manifest.

A log is a file, or a folder that is a bag, on disk or at any URL that fsspec reads (s3://, gs://, az://, https://,
sftp://, ...), from which it is fetched into a temporary folder and deleted after use. A Parquet table names its robot
under the key "robot" of its metadata; a rosbag2 folder in its metadata.yaml, as written by
`ros2 bag record --custom-data robot=go2`.
"""

import csv
import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from glob import glob, has_magic
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from stadera.boundary import foreign, require_input
from stadera.errors import RecordingError, StaderaError, UnknownNameError, of_extra
from stadera.limits import Limits
from stadera.logs.reader import READERS
from stadera.logs.topics import AS_RECORDED, LogFile, ReadOptions, Topics
from stadera.robot import load_robot
from stadera.robot.model import Robot
from stadera.weigh.settings import check_choice, tare_of


def is_url(address: str) -> bool:
    """True if an address is a URL instead of a path on disk."""
    return "://" in address


def expanded(pattern: str) -> list[str]:
    """The addresses named by a path, a URL or a glob, sorted; paths are absolute.

    A path, URL or example's name without wildcards is returned as it is, whether it exists or not. Globs do not match
    folders that are no bags, and the ground truth that `simulate` writes next to its logs.

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
        paths = [Path(name).absolute() for name in glob(pattern, recursive=True)]
        found = [str(path) for path in paths if path.is_file() or any(reader.accepts(path) for reader in READERS)]
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
    with of_extra("fsspec", "fleet", f"a log at {url}"):
        from fsspec.core import url_to_fs  # type: ignore[import-untyped]
    try:
        system, path = url_to_fs(url)
    except ImportError as error:  # fsspec's own, of the package for that protocol
        packages = " ".join(re.findall(r'"([\w.-]+)"', str(error)))
        raise RecordingError(f"{url}: {error}{packages and f': pip install {packages}'}") from None
    except ValueError as error:
        raise RecordingError(f"{url}: not a URL that can be read: {error}") from None
    return system, str(path)


KEY = "robot"
_CUSTOM = re.compile(r"^\s+" + KEY + r":\s*['\"]?([^'\"\s]+)['\"]?\s*$", re.MULTILINE)


def robot_named_in(path: Path) -> str:
    """The robot's name, or its model file's path. Raises RecordingError: the log does not name it."""
    named = _named_in_metadata(path)
    if not named:
        raise RecordingError(
            f"{path}: which robot's log it is, its metadata do not say: name it by --robot, or in a manifest"
        )
    return named


def _named_in_metadata(path: Path) -> str | None:
    if path.is_dir():
        listed = path / "metadata.yaml"
        found = listed.is_file() and _CUSTOM.search(listed.read_text(encoding="utf-8").partition("custom_data:")[2])
        return found[1] if found else None
    import pyarrow as pa
    from pyarrow import parquet

    try:
        metadata = parquet.read_schema(path).metadata or {}
    except (pa.ArrowException, OSError, ValueError):
        return None
    return metadata.get(KEY.encode(), b"").decode() or None


COLUMNS = ("log", "robot", "tare", "legs", "name")
"""Columns of a manifest; only `log` is required."""


@dataclass(frozen=True)
class FleetOptions:
    """Options common to all logs: those of `stadera.weigh`, topics and columns to read, or to identify legs, from logs
    of robots on a stand, instead of weighing trunks.

    Raises:
        UnknownNameError, IdentificationError: as in `stadera.weigh`, before any log is read.
        StaderaError: options of weighing are combined with `identify`.
    """

    identify: bool = False
    method: str | None = None
    stiffness: tuple[float, float, float] | None = None
    imu_frame: str | None = None
    topics: Topics = field(default_factory=Topics)
    reading: ReadOptions = AS_RECORDED
    force: bool = False
    fix: bool = False
    feet: tuple[str, ...] = ()  # as of `load_robot`
    trunk: str | None = None
    pages: str | None = None  # folder for a page of each log, see `stadera.fleet.run.page_path`; None for no pages

    def __post_init__(self) -> None:
        check_choice(self.method, self.stiffness)
        if self.identify and (self.method or self.stiffness or self.imu_frame):
            raise StaderaError("a method, a stiffness and an IMU frame are of weighing, not of identifying legs")


@dataclass(frozen=True)
class LogJob:
    """One log, an absolute path or URL, with its instructions. Raises StaderaError: an invalid tare, or a tare or legs
    combined with `identify`.
    """

    log: str
    robot: str | None = None  # name of a robot, or path of a model file; None to use the log's metadata
    tare: str | None = None  # "T0:T1" [s], or the address of another log; None for no tare
    legs: str | None = None  # path of a JSON from `stadera identify`; None for the model's legs
    name: str | None = None  # of the individual robot in the table; None for the model's name
    options: FleetOptions = field(default_factory=FleetOptions)

    def __post_init__(self) -> None:
        if self.tare is not None:
            tare_of(self.tare)
        if self.options.identify and (self.tare or self.legs):
            raise StaderaError(f"{self.log}: a tare and identified legs are of weighing, not of identifying legs")

    def model(self, robot: str | None = None) -> Robot:
        """The robot with its legs, loaded once per process; `robot`: the log's, if the job has none. Raises ModelError,
        UnknownNameError, UntrustedError: as in `load_robot` and `with_identified_legs`.
        """
        name = self.robot or robot
        assert name is not None
        options = self.options
        return _model(name, self.legs, options.reading.limits, options.feet, options.trunk, options.force)


def jobs_of(
    logs: Iterable[str | PathLike[str]],
    robot: str | None = None,
    tare: str | None = None,
    legs: str | None = None,
    names: str | None = None,
    options: FleetOptions | None = None,
) -> list[LogJob]:
    """Makes a job for each log of paths, URLs, or globs of them, in the given order, without duplicates.

    Args:
        robot, tare, legs, options: common to all logs, see `LogJob`.
        names: regular expression whose first group, searched for in a log's address, names the individual robot.

    Raises:
        RecordingError: a glob matches nothing, or `names` does not match an address.
        StaderaError: `names` is not a regular expression with a group; see also `LogJob` and `FleetOptions`.
    """
    addresses = dict.fromkeys(address for pattern in logs for address in expanded(str(pattern)))
    robot, tare, legs = (None if given is None else _absolute(given) for given in (robot, tare, legs))
    return [LogJob(log, robot, tare, legs, _named(names, log), options or FleetOptions()) for log in addresses]


def read_manifest(
    path: str | PathLike[str], robot: str | None = None, options: FleetOptions | None = None
) -> list[LogJob]:
    """Reads jobs from a CSV with a header: `log`, and optionally `robot` (else this one), `tare`, `legs` and `name`,
    see `LogJob`. RecordingError, with the line, if it cannot be read or lacks a column, UnknownNameError for an unknown
    column.

    `log` may be a glob; relative paths are relative to the manifest. An empty cell counts as missing.
    """
    path, options = Path(path), options or FleetOptions()
    jobs: dict[str, LogJob] = {}
    for line, cells in _lines(path):
        try:
            for job in _of_line(cells, path.parent.absolute(), robot, options):
                if job.log in jobs:
                    raise RecordingError(f"{job.log} is there twice")
                jobs[job.log] = job
        except StaderaError as error:
            raise RecordingError(f"{path}, line {line}: {error}") from None
    if not jobs:
        raise RecordingError(f"{path}: no logs in it")
    return list(jobs.values())


@cache
def _model(
    robot: str, legs: str | None, limits: Limits, feet: tuple[str, ...], trunk: str | None, force: bool
) -> Robot:
    from stadera.identify.schema import with_identified_legs

    model = load_robot(robot, limits, feet, trunk)
    return model if legs is None else with_identified_legs(model, legs, force)


def _of_line(cells: Mapping[str, str], folder: Path, robot: str | None, options: FleetOptions) -> list[LogJob]:
    if "log" not in cells:
        raise RecordingError("no log")
    given = {name: _absolute(cells[name], folder) for name in ("robot", "tare", "legs") if name in cells}
    pattern = cells["log"] if is_url(cells["log"]) else str(folder / cells["log"])
    fields = {"robot": robot, **given, "name": cells.get("name")}
    return [LogJob(log, **fields, options=options) for log in expanded(pattern)]


def _absolute(given: str, folder: Path | None = None) -> str:
    """The absolute path of an existing file; a URL, a range of time or a robot's name is returned unchanged."""
    place = (folder or Path()) / given
    return str(place.absolute()) if not is_url(given) and place.is_file() else given


def _named(names: str | None, address: str) -> str | None:
    """The robot's name in an address; None without an expression for it."""
    if names is None:
        return None
    try:
        expression = re.compile(names)
    except re.error as error:
        raise StaderaError(f"'{names}' is not a regular expression: {error}") from None
    if not expression.groups:
        raise StaderaError(f"'{names}' has no group in parentheses for the robot's name")
    if (found := expression.search(address)) is None:
        raise RecordingError(f"{address}: '{names}' finds no robot's name in it")
    return found[1]


def _lines(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    require_input(path)
    with foreign(path, "not a CSV table"), path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.DictReader(file)
        for column in reader.fieldnames or ():
            if column not in COLUMNS:
                raise UnknownNameError("column", column, COLUMNS, str(path))
        if "log" not in (reader.fieldnames or ()):
            raise RecordingError(f"{path}: a manifest needs a column 'log'")
        for cells in reader:
            yield reader.line_num, {name: text.strip() for name, text in cells.items() if name and text}
