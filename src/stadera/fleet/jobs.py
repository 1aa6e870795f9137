"""What is to be done with each log of a fleet: from paths, URLs and globs, or from a manifest."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from os import PathLike
from pathlib import Path

from stadera.errors import RecordingError, StaderaError, UnknownNameError
from stadera.fleet.source import expanded, is_url
from stadera.limits import Limits
from stadera.logs.reading import AS_RECORDED, Reading
from stadera.logs.topics import Topics
from stadera.robot import load_robot
from stadera.robot.model import Robot
from stadera.weigh.settings import check_choice, tare_of

COLUMNS = ("log", "robot", "tare", "legs", "name")
"""Of a manifest; only `log` has to be there."""


@dataclass(frozen=True)
class FleetOptions:
    """What is done with every log.

    Attributes:
        identify: whether legs are identified, from logs of robots on a stand; else trunks are weighed.
        method, stiffness, imu_frame, force, fix: as `stadera.weigh` takes them.
        topics: to read, of logs with several.
        reading: what columns are, and their units.

    Raises:
        UnknownNameError, IdentificationError: as `stadera.weigh`, before any log is read.
        StaderaError: options of weighing together with `identify`.
    """

    identify: bool = False
    method: str | None = None
    stiffness: tuple[float, float, float] | None = None
    imu_frame: str | None = None
    topics: Topics = field(default_factory=Topics)
    reading: Reading = AS_RECORDED
    force: bool = False
    fix: bool = False

    def __post_init__(self) -> None:
        check_choice(self.method, self.stiffness)
        if self.identify and (self.method or self.stiffness or self.imu_frame):
            raise StaderaError("a method, a stiffness and an IMU frame are of weighing, not of identifying legs")


@dataclass(frozen=True)
class LogJob:
    """One log, and how it is weighed.

    Attributes:
        log: absolute path, or URL.
        robot: name of a robot, or path of a model file; None for the one that the log's own metadata name.
        tare: "T0:T1" [s], or the address of another log; None for none.
        legs: path of a JSON of `stadera identify`; None for the model's.
        name: of this one robot among its like, as the table calls it; None for the model's.
        options: of every log.

    Raises:
        StaderaError: a tare's range that is none; a tare or legs together with `identify`.
    """

    log: str
    robot: str | None = None
    tare: str | None = None
    legs: str | None = None
    name: str | None = None
    options: FleetOptions = field(default_factory=FleetOptions)

    def __post_init__(self) -> None:
        if self.tare is not None:
            tare_of(self.tare)
        if self.options.identify and (self.tare or self.legs):
            raise StaderaError(f"{self.log}: a tare and identified legs are of weighing, not of identifying legs")


def jobs_of(
    logs: Iterable[str | PathLike[str]],
    robot: str | None = None,
    tare: str | None = None,
    legs: str | None = None,
    names: str | None = None,
    options: FleetOptions | None = None,
) -> list[LogJob]:
    """A job for each log, in the order given, each log once.

    Args:
        logs: paths, URLs, or globs of them.
        robot, tare, legs: of all of them, see `LogJob`.
        names: regular expression whose first group, searched for in a log's address, names the robot that it is of.
        options: None for the defaults.

    Raises:
        RecordingError: a glob that matches nothing, an address in which `names` finds nothing.
        StaderaError: `names` is no regular expression with a group; see `LogJob` and `FleetOptions`.
    """
    addresses = dict.fromkeys(address for pattern in logs for address in expanded(str(pattern)))
    named = _namer(names)
    robot, tare, legs = (None if given is None else _absolute(given) for given in (robot, tare, legs))
    return [LogJob(log, robot, tare, legs, named(log), options or FleetOptions()) for log in addresses]


def read_manifest(
    path: str | PathLike[str], robot: str | None = None, options: FleetOptions | None = None
) -> list[LogJob]:
    """The jobs of a CSV with a header: `log`, and where there are, `robot`, `tare`, `legs` and `name`, see `LogJob`.

    `log` may be a glob; relative paths are relative to the manifest. An empty cell counts as absent.

    Args:
        robot: where a line has none.

    Raises:
        RecordingError: a manifest that cannot be read or has no such column; names the line.
        UnknownNameError: a column that is none of these.
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


def check_models(jobs: Iterable[LogJob]) -> None:
    """Loads every model and reads every file of legs once, so that a wrong one is known before the work.

    Raises:
        ModelError, UnknownNameError: as `load_robot` and `with_identified_legs`.
    """
    for robot, legs, limits in dict.fromkeys((job.robot, job.legs, job.options.reading.limits) for job in jobs):
        if robot is not None:
            robot_of(robot, legs, limits)


@cache
def robot_of(robot: str, legs: str | None, limits: Limits) -> Robot:
    """The model of a job with its legs, loaded once a process."""
    from stadera.identify.schema import with_identified_legs

    model = load_robot(robot, limits)
    return model if legs is None else with_identified_legs(model, legs)


def _of_line(cells: Mapping[str, str], folder: Path, robot: str | None, options: FleetOptions) -> list[LogJob]:
    if "log" not in cells:
        raise RecordingError("no log")
    given = {name: _absolute(cells[name], folder) for name in ("robot", "tare", "legs") if name in cells}
    pattern = cells["log"] if is_url(cells["log"]) else str(folder / cells["log"])
    fields = {"robot": robot, **given, "name": cells.get("name")}
    return [LogJob(log, **fields, options=options) for log in expanded(pattern)]


def _absolute(given: str, folder: Path | None = None) -> str:
    """A path of a file that is there, absolute; a URL, a range of time or a robot's name as it is."""
    place = (folder or Path()) / given
    return str(place.absolute()) if not is_url(given) and place.is_file() else given


def _namer(names: str | None) -> Callable[[str], str | None]:
    """From an address to the robot's name."""
    if names is None:
        return lambda address: None
    try:
        expression = re.compile(names)
    except re.error as error:
        raise StaderaError(f"{names!r} is not a regular expression: {error}") from None
    if not expression.groups:
        raise StaderaError(f"{names!r} has no group in parentheses for the robot's name")

    def name(address: str) -> str | None:
        found = expression.search(address)
        if found is None:
            raise RecordingError(f"{address}: {names!r} finds no robot's name in it")
        return found[1]

    return name


def _lines(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """The number of each line, and its cells that are not empty."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            for column in reader.fieldnames or ():
                if column not in COLUMNS:
                    raise UnknownNameError("column", column, COLUMNS, str(path))
            if "log" not in (reader.fieldnames or ()):
                raise RecordingError(f"{path}: a manifest needs a column 'log'")
            for cells in reader:
                yield reader.line_num, {name: text.strip() for name, text in cells.items() if name and text}
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: not a CSV table: {error}") from None
