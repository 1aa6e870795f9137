"""Computes the table's row for one log: the work of a worker."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import stadera
from stadera.errors import StaderaError, UntrustedError
from stadera.fleet.jobs import LogJob, digest, fetched, is_url, robot_named_in
from stadera.fleet.table import COLUMNS, SIDES
from stadera.logs.topics import LogFile
from stadera.results import finite_or_none
from stadera.weigh.settings import tare_of

if TYPE_CHECKING:
    from stadera.identify.result import Identification
    from stadera.results import Result
    from stadera.trust import Trust

Row = dict[str, Any]
"""One row by column, see `stadera.fleet.table`; None for missing values. A log's row also has its rows of `SIDES`."""


@dataclass(frozen=True)
class Task:
    """A log to be processed unless it has been already, and the key of its previous result; None if there is none."""

    job: LogJob
    known: str | None = None


@dataclass(frozen=True)
class Done:
    """Outcome of a log."""

    # hash of its content, the package's version and everything else the row depends on; None if the log could not be
    # read completely, so that another try may succeed
    key: str | None
    row: Row | None  # None if the result under this key exists already


def process(task: Task) -> Done:
    """Weighs one log, or identifies legs from it. Any error becomes part of the row."""
    job, begun = task.job, perf_counter()
    row = _empty(job) | {"status": "ok"}
    source, path = None, Path(job.log)
    with ExitStack() as stack:
        try:
            path = stack.enter_context(fetched(job.log))
            source = _Source.of(job, path, stack)
            if source.key == task.known:
                return Done(source.key, None)
            row |= {"sha256": source.sha256, "robot": job.name or source.robot}
            row |= _identified(job, source) if job.options.identify else _weighed(job, source)
        except Exception as error:  # whatever it is, the other logs go on
            row |= _failed(error, str(path), job.log)
            if isinstance(error, OSError | MemoryError):
                source = None
    row["seconds"] = perf_counter() - begun
    named = {"log": job.log, "robot": row["robot"]}
    row |= {name: [named | side for side in row[name]] for name in SIDES}
    return Done(None if source is None else source.key, row)


def page_path(folder: str | Path, log: str) -> Path:
    """The page of a log in a folder: the log's name, and enough of a hash that no other has it."""
    name = Path(log).stem or "log"
    return Path(folder) / f"{name}-{hashlib.sha256(log.encode()).hexdigest()[:8]}.html"


def is_done(task: Task) -> bool:
    """True if a local log would get the key under which it is known."""
    if task.known is None or is_url(task.job.log):
        return False
    try:
        with ExitStack() as stack:
            return _Source.of(task.job, stack.enter_context(fetched(task.job.log)), stack).key == task.known
    except (StaderaError, OSError):
        return False


def lost(job: LogJob, reason: str) -> Done:
    """Row of a log whose workers were lost, to be tried again another time."""
    return Done(None, _empty(job) | {"status": "failed", "error": f"{job.log}: {reason}"})


def _empty(job: LogJob) -> Row:
    named = {"log": job.log, "robot": job.name or job.robot, "version": stadera.__version__}
    return dict.fromkeys(COLUMNS) | {name: [] for name in SIDES} | named


def _failed(error: Exception, path: str, log: str) -> Row:
    """Row of a failed log, with the log's own name in the message."""
    said = " ".join(str(error).split()).replace(path, log)
    if not isinstance(error, StaderaError):
        said = f"internal error, {type(error).__name__}: {said}"
    return {"status": "failed", "error": said, "trust": "bad" if isinstance(error, UntrustedError) else None}


@dataclass(frozen=True)
class _Source:
    """Inputs of a row: log and tare on disk, the robot, and the key of everything the row depends on."""

    path: Path
    tare: tuple[float, float] | Path | None
    robot: str
    sha256: str
    key: str

    @classmethod
    def of(cls, job: LogJob, path: Path, stack: ExitStack) -> _Source:
        """Fetches them. Raises RecordingError, ModelError or UnknownNameError if tare or robot cannot be found."""
        given = None if job.tare is None else tare_of(job.tare)
        tare = stack.enter_context(fetched(given)) if isinstance(given, str) else given
        robot, sha256 = job.robot or robot_named_in(path), digest(path)
        files = [
            job.model(robot).source,
            job.legs,
            tare if isinstance(tare, Path) else None,
        ]
        contents = [None if file is None else _digest(Path(file)) for file in files]
        text = repr((sha256, stadera.__version__, job, robot, contents))
        return cls(path, tare, robot, sha256, hashlib.sha256(text.encode()).hexdigest())


def _digest(path: Path) -> str:
    """Hash of a file that many rows depend on, cached until it changes."""
    state = path.stat()
    return _digest_at(path, state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=64)
def _digest_at(path: Path, size: int, modified: int) -> str:
    return digest(path)


def _weighed(job: LogJob, source: _Source) -> Row:
    from stadera.weigh.weigh import weigh

    options = job.options
    tare = _log(job, source.tare) if isinstance(source.tare, Path) else source.tare
    result = weigh(
        job.model(source.robot),
        _log(job, source.path),
        tare,
        options.method,
        imu_frame=options.imu_frame,
        stiffness=options.stiffness,
        force=options.force,
        fix=options.fix,
    )
    _write_page(job, result)
    row: Row = {"begin": result.begin, "end": result.end, "changes": len(result.changes)}
    row |= _pair("trunk_mass", result.mass, result.mass_std)
    for axis, value, std in zip("xyz", result.com, result.com_std, strict=True):
        row |= _pair(f"com_{axis}", value, std)
    if result.payload is not None:
        row |= _pair("payload_mass", result.payload.mass, result.payload.mass_std)
    return row | _trust(result.trust)


def _identified(job: LogJob, source: _Source) -> Row:
    from stadera.identify.legs import identify
    from stadera.identify.log import has_effort, time_span
    from stadera.identify.settings import IdentifySettings

    options = job.options
    robot = job.model(source.robot)
    log = _log(job, source.path)
    legs = tuple(leg.name for leg in robot.legs if has_effort(log, leg.joints))
    result = identify(robot, log, IdentifySettings(legs=legs or None), fix=options.fix, force=options.force)
    if result.trust.verdict == "bad" and not options.force:
        raise UntrustedError(f"{log.source}: not to be trusted: {'; '.join(result.trust.reasons)}")
    _write_page(job, result)
    begin, end = time_span(log, result.legs[0].leg.joints)
    sides = {"joints": list(_joints(result)), "legs": list(_legs(result))}
    return {"begin": begin, "end": end} | _trust(result.trust) | sides


def _write_page(job: LogJob, result: Result) -> None:
    """The log's page, if pages are asked for."""
    if job.options.pages is not None:
        page_path(job.options.pages, job.log).write_text(result.to_html(), encoding="utf-8")


def _log(job: LogJob, path: Path) -> LogFile:
    return LogFile(path, job.options.topics, job.options.reading)


def _joints(result: Identification) -> Iterator[Row]:
    """Rows of each joint's rotor inertia, friction and torque offset, which show wear."""
    for leg in result.legs:
        for name, quantity in leg.parameters.items():
            joint, parameter = name.rsplit(".", 1)
            if joint in leg.leg.joints:
                std = None if quantity.is_held else quantity.std
                yield {"joint": joint, "parameter": parameter, "value": quantity.value, "std": std}


def _legs(result: Identification) -> Iterator[Row]:
    """Rows of the log's information on each leg, for merging with other logs."""
    for leg in result.legs:
        known = leg.information
        if known is not None:
            row = {"leg": leg.leg.name, "columns": list(known.names), "R": known.R.ravel().tolist()}
            yield row | {"z": known.z.tolist(), "cost": known.cost, "count": known.count}


def _pair(name: str, value: float, std: float) -> Row:
    """A value and its standard deviation, both None if not observed."""
    seen = isfinite(value) and isfinite(std)
    return {name: float(value) if seen else None, f"{name}_std": float(std) if seen else None}


def _trust(trust: Trust) -> Row:
    return {"trust": trust.verdict, "misfit": finite_or_none(trust.misfit)}
