"""Runs a fleet: skips known logs, processes the rest, each to a row of the table, and saves every row immediately.

Rows are appended to a journal next to the table as they arrive. The complete table is written at intervals, at the end,
and on interruption; then the journal is deleted. A log is finished if its content, the options, the robot's files and
the package's version equal those of its row.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite
from os import PathLike
from pathlib import Path
from time import monotonic, perf_counter
from typing import TYPE_CHECKING, Any

import stadera
from stadera.errors import StaderaError, UntrustedError
from stadera.files import require_writable
from stadera.fleet.jobs import LogJob, digest, fetched, is_url, robot_named_in
from stadera.fleet.pool import Failure, Pool, journal, read_journal, run_tasks
from stadera.fleet.table import COLUMNS, SIDES, FleetTable, read_fleet, side_path, table_path
from stadera.logs.topics import LogFile
from stadera.report.numbers import counted
from stadera.results import finite_or_none
from stadera.trunk.memory import UNCHANGED, Memory
from stadera.weigh.settings import tare_of

if TYPE_CHECKING:
    from stadera.identify.result import Identification
    from stadera.results import Result
    from stadera.trust import Trust
    from stadera.types import Progress
    from stadera.weigh.result import Weighing


Row = dict[str, Any]
"""One row by column, see `stadera.fleet.table`; None for missing values. A log's row also has its rows of `SIDES`."""


@dataclass(frozen=True)
class Task:
    """A log to be processed unless it has been already."""

    job: LogJob
    known: str | None = None  # key of its previous result; None if there is none
    memory: Path | None = None  # file of the robot's memory, see `stadera.trunk.memory`; None for none


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
            source = _Source.of(task, path, stack)
            if source.key == task.known:
                return Done(source.key, None)
            row |= {"sha256": source.sha256, "robot": job.name or source.robot}
            memory = None if task.memory is None else Memory.read(task.memory, job.model(source.robot))
            result, found = (_identified if job.options.identify else _weighed)(job, source, memory)
            row |= found
            if task.memory is not None:
                row["memory"] = _learnt(result)
            if result.memory is not None and task.memory is not None:
                result.memory.save_json(task.memory)
        except Exception as error:  # whatever it is, the other logs go on
            said = " ".join(str(error).split()).replace(str(path), job.log)
            internal = "" if isinstance(error, StaderaError) else f"internal error, {type(error).__name__}: "
            row |= {"status": "failed", "error": f"{internal}{said}"}
            row["trust"] = "bad" if isinstance(error, UntrustedError) else None
            if isinstance(error, OSError | MemoryError):
                source = None
    row["seconds"] = perf_counter() - begun
    named = {"log": job.log, "robot": row["robot"]}
    row |= {name: [named | side for side in row[name]] for name in SIDES}
    return Done(None if source is None else source.key, row)


def _learnt(result: Weighing | Identification) -> str:
    """What became of a robot's memory."""
    if result.memory is None:
        return next((note for note in result.notes if note.startswith(UNCHANGED)), f"{UNCHANGED}: nothing was learnt")
    return f"of {counted(result.memory.logs - 1, 'earlier log')}"


def memory_paths(path: str | PathLike[str], jobs: Sequence[LogJob]) -> dict[str, Path]:
    """File of each robot's memory: the path itself if it is of all jobs, with the robots' names where they have any.
    Raises StaderaError: neither a job nor a log on disk says which robot it is.
    """
    path, owners = Path(path), dict.fromkeys(map(owner_of, jobs))
    if len(owners) == 1 and all(job.name is None for job in jobs):
        return dict.fromkeys(owners, path)
    return {owner: path.with_stem(f"{path.stem}-{Path(owner).stem}") for owner in owners}


def owner_of(job: LogJob) -> str:
    """The individual robot of a job, else the model. Raises StaderaError: neither it nor a log on disk says."""
    return job.name or job.robot or robot_named_in(Path(job.log))


def page_path(folder: str | Path, log: str) -> Path:
    """The page of a log in a folder: the log's name, and enough of a hash that no other has it."""
    name = Path(log).stem or "log"
    return Path(folder) / f"{name}-{hashlib.sha256(log.encode()).hexdigest()[:8]}.html"


def _is_done(task: Task) -> bool:
    """True if a local log would get the key under which it is known."""
    if task.known is None or is_url(task.job.log):
        return False
    try:
        with ExitStack() as stack:
            return _Source.of(task, stack.enter_context(fetched(task.job.log)), stack).key == task.known
    except (StaderaError, OSError):
        return False


def _empty(job: LogJob) -> Row:
    named = {"log": job.log, "robot": job.name or job.robot, "version": stadera.__version__}
    return dict.fromkeys(COLUMNS) | {name: [] for name in SIDES} | named


@dataclass(frozen=True)
class _Source:
    """Inputs of a row: log and tare on disk, the robot, and the key of everything the row depends on."""

    path: Path
    tare: tuple[float, float] | Path | None
    robot: str
    sha256: str
    key: str

    @classmethod
    def of(cls, task: Task, path: Path, stack: ExitStack) -> _Source:
        """Fetches them. Raises RecordingError, ModelError or UnknownNameError if tare or robot cannot be found."""
        job = task.job
        given = None if job.tare is None else tare_of(job.tare)
        tare = stack.enter_context(fetched(given)) if isinstance(given, str) else given
        robot, sha256 = job.robot or robot_named_in(path), digest(path)
        files = [job.model(robot).source, job.legs, tare if isinstance(tare, Path) else None]
        states = [(Path(file), Path(file).stat()) if file is not None else None for file in files]
        contents = [known and _digest(known[0], known[1].st_size, known[1].st_mtime_ns) for known in states]
        text = repr((sha256, stadera.__version__, job, robot, contents)) + " with memory" * (task.memory is not None)
        return cls(path, tare, robot, sha256, hashlib.sha256(text.encode()).hexdigest())


@lru_cache(maxsize=64)
def _digest(path: Path, size: int, modified: int) -> str:
    """Hash of a file that many rows depend on, cached until it changes."""
    return digest(path)


def _weighed(job: LogJob, source: _Source, memory: Memory | None) -> tuple[Weighing, Row]:
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
        memory=memory,
    )
    _write_page(job, result)
    row: Row = {"begin": result.begin, "end": result.end, "changes": len(result.changes)}
    row |= _pair("trunk_mass", result.mass, result.mass_std)
    for axis, value, std in zip("xyz", result.com, result.com_std, strict=True):
        row |= _pair(f"com_{axis}", value, std)
    if result.payload is not None:
        row |= _pair("payload_mass", result.payload.mass, result.payload.mass_std)
    return result, row | _trust(result.trust)


def _identified(job: LogJob, source: _Source, memory: Memory | None) -> tuple[Identification, Row]:
    from stadera.identify.legs import identify
    from stadera.identify.log import has_effort, time_span
    from stadera.identify.settings import IdentifySettings

    options = job.options
    robot = job.model(source.robot)
    log = _log(job, source.path)
    legs = tuple(leg.name for leg in robot.legs if has_effort(log, leg.joints))
    how = IdentifySettings(legs=legs or None)
    result = identify(robot, log, how, fix=options.fix, force=options.force, memory=memory)
    if result.trust.verdict == "bad" and not options.force:
        raise UntrustedError(f"{log.source}: not to be trusted: {'; '.join(result.trust.reasons)}")
    _write_page(job, result)
    begin, end = time_span(log, result.legs[0].leg.joints)
    sides = {"joints": list(_joints(result)), "legs": list(_legs(result))}
    return result, {"begin": begin, "end": end} | _trust(result.trust) | sides


def _write_page(job: LogJob, result: Result) -> None:
    if job.options.pages is not None:
        page_path(job.options.pages, job.log).write_text(result.to_html(), encoding="utf-8")


def _log(job: LogJob, path: Path) -> LogFile:
    return LogFile(path, job.options.topics, job.options.reading)


def _joints(result: Identification) -> Iterator[Row]:
    for leg in result.legs:
        for joint, terms in leg.joint_terms.items():
            for parameter, q in terms.items():
                yield {"joint": joint, "parameter": parameter, "value": q.value, "std": None if q.is_held else q.std}


def _legs(result: Identification) -> Iterator[Row]:
    for leg in result.legs:
        known = leg.information
        if known is not None:
            row = {"leg": leg.leg.name, "columns": list(known.names), "R": known.R.ravel().tolist()}
            rest = {"cost": known.cost, "count": known.count, "G": known.G.ravel().tolist()}
            yield row | {"z": known.z.tolist(), **rest}


def _pair(name: str, value: float, std: float) -> Row:
    """A value and its standard deviation, both None if not observed."""
    seen = isfinite(value) and isfinite(std)
    return {name: float(value) if seen else None, f"{name}_std": float(std) if seen else None}


def _trust(trust: Trust) -> Row:
    return {"trust": trust.verdict, "misfit": finite_or_none(trust.misfit)}


def run_fleet(
    jobs: Sequence[LogJob],
    out: str | PathLike[str],
    pool: Pool | None = None,
    watch: Progress | None = None,
    memory: str | PathLike[str] | None = None,
) -> FleetTable:
    """Weighs a fleet's logs, or identifies legs from them, and writes the table every half minute and at the end.

    Args:
        jobs: one for each log; the table itself, which a glob may have matched, is ignored. Rows of other logs in an
            existing table are kept, before these.
        out: path of the table, .parquet; logs that it already contains are skipped.
        pool: where logs are processed; None for one process per core.
        memory: file of what is remembered of each robot, see `memory_paths`, which every log is weighed with and adds
            to; the logs of one robot are then processed in turn.

    Raises:
        StaderaError: the table cannot be written or read, or there is no scheduler. Never raised for a log, whose row
            states the error.
        MissingExtraError: Dask is needed and not installed.
    """
    target = require_writable(table_path(out))
    tables = (target, *(side_path(target, name) for name in SIDES))
    jobs = [job for job in jobs if Path(job.log) not in tables]
    for job in jobs:
        if job.robot is not None:
            job.model()  # errors appear before the computation
    files = {} if memory is None else memory_paths(memory, jobs)
    with _journal(target) as append:
        fleet = _Fleet(target, jobs)
        tasks = _tasks(fleet, jobs, files)
        owners = {log: str(task.memory) for log, task in tasks.items() if task.memory is not None}
        report = _report_of(list(tasks), watch)
        try:
            with closing(run_tasks(process, tasks, pool or Pool(), owners)) as outcomes:
                for log, outcome in outcomes:
                    done = lost(tasks[log].job, outcome.reason) if isinstance(outcome, Failure) else outcome
                    if done.row is not None:
                        append({"key": done.key, "row": done.row})
                        fleet.add(log, done)
                    report(log)
        finally:
            fleet.save()
    return fleet.table()


@contextmanager
def _journal(target: Path) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """The journal of a table while it is written by this run alone, deleted at the end."""
    stack, path = ExitStack(), journal_path(target)
    append = stack.enter_context(journal(path))  # raises where it is another run's, which is not to be deleted
    try:
        with stack:
            yield append
    finally:
        path.unlink(missing_ok=True)


def journal_path(target: Path) -> Path:
    """The journal of a table."""
    return target.with_name(f".{target.stem}.journal.jsonl")


def lost(job: LogJob, reason: str) -> Done:
    """Row of a log whose workers were lost, to be tried again another time."""
    return Done(None, _empty(job) | {"status": "failed", "error": f"{job.log}: {reason}"})


def _tasks(fleet: _Fleet, jobs: Sequence[LogJob], files: Mapping[str, Path]) -> dict[str, Task]:
    """Tasks that are not done yet, by log, with the memories of their owners."""
    every = {job.log: Task(job, fleet.key(job.log), files[owner_of(job)] if files else None) for job in jobs}
    return {log: task for log, task in every.items() if not _is_done(task)}


def _report_of(logs: Sequence[str], watch: Progress | None) -> Callable[[str | None], None]:
    """What tells of logs that are done; progress is by the logs' sizes, which determine their time, if all are here."""
    sizes = dict.fromkeys(logs, 1) if any(map(is_url, logs)) else {log: _size(Path(log)) for log in logs}
    finished: list[str] = []

    def report(log: str | None) -> None:
        finished.extend(() if log is None else (log,))
        if watch is not None:
            amount = sum(sizes[log] for log in finished)
            watch("weighing logs", amount, sum(sizes.values()), f"{len(finished)} of {len(sizes)}")

    report(None)
    return report


class _Fleet:
    """Finished rows, from the table, the journal and the present run."""

    saved_every = 30.0  # [s]

    def __init__(self, target: Path, jobs: Sequence[LogJob]) -> None:
        self._target, self._jobs = target, jobs
        self._done: dict[str, Done] = {}
        if target.exists():
            self._read(read_fleet(target))
        self._changed, self._saved = False, monotonic()
        for entry in read_journal(journal_path(target)):
            self._done[entry["row"]["log"]] = Done(entry["key"], entry["row"])
            self._changed = True

    def key(self, log: str) -> str | None:
        return self._done[log].key if log in self._done else None

    def add(self, log: str, done: Done) -> None:
        """Adds a row, and saves the table if the last save was long ago."""
        self._done[log], self._changed = done, True
        if monotonic() - self._saved > self.saved_every:
            self.save()

    def save(self) -> None:
        if self._changed:
            self.table().save(self._target)
        self._changed, self._saved = False, monotonic()

    def table(self) -> FleetTable:
        """Logs of earlier runs, then those of this one in their order."""
        now = dict.fromkeys(job.log for job in self._jobs)
        order = [*(log for log in self._done if log not in now), *(log for log in now if log in self._done)]
        rows = [self._done[log].row or {} for log in order]
        sides = {name: tuple(side for row in rows for side in row[name]) for name in SIDES}
        keys = tuple(self._done[log].key for log in order)
        return FleetTable(tuple({name: row[name] for name in COLUMNS} for row in rows), keys=keys, **sides)

    def _read(self, table: FleetTable) -> None:
        rows = {row["log"]: row | {name: [] for name in SIDES} for row in table.rows}
        for name in SIDES:
            for side in getattr(table, name):
                rows[side["log"]][name].append(side)
        for (log, row), key in zip(rows.items(), table.keys, strict=True):
            self._done[log] = Done(key, row)


def _size(path: Path) -> int:
    """Size in bytes of a file or a folder, at least 1."""
    try:
        files = path.rglob("*") if path.is_dir() else [path]
        return max(1, sum(file.stat().st_size for file in files if file.is_file()))
    except OSError:  # reported in the log's own row
        return 1
