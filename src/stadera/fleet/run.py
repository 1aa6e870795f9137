"""Runs a fleet: skips known logs, processes the rest, and saves every row immediately.

Rows are appended to a journal next to the table as they arrive. The complete table is written at intervals, at the end,
and on interruption; then the journal is deleted. A log is finished if its content, the options, the robot's files and
the package's version equal those of its row.
"""

from collections.abc import Callable, Sequence
from contextlib import closing
from os import PathLike
from pathlib import Path
from time import monotonic

from stadera.files import require_writable
from stadera.fleet.jobs import LogJob, is_url
from stadera.fleet.pool import Failure, Pool, journal, read_journal, run_tasks
from stadera.fleet.row import Done, Task, is_done, lost, process
from stadera.fleet.table import COLUMNS, SIDES, FleetTable, read_fleet, side_path, table_path

Watch = Callable[[str, int, int, str], None]
"""Called with the step's name, the amount done, the total amount, and the number of logs in words."""


def run_fleet(
    jobs: Sequence[LogJob],
    out: str | PathLike[str],
    pool: Pool | None = None,
    watch: Watch | None = None,
    saved_every: float = 30.0,
) -> FleetTable:
    """Weighs a fleet's logs, or identifies legs from them, and writes the table every `saved_every` [s] and at the end.

    Args:
        jobs: one for each log; the table itself, which a glob may have matched, is ignored. Rows of other logs in an
            existing table are kept, before these.
        out: path of the table, .parquet; logs that it already contains are skipped.
        pool: where logs are processed; None for one process per core.

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
    fleet = _Fleet(target, jobs, saved_every)
    by_log = {job.log: job for job in jobs}
    tasks = {log: Task(job, fleet.key(log)) for log, job in by_log.items()}
    waiting = {log: task for log, task in tasks.items() if not is_done(task)}
    finished = _progress(list(waiting), watch)
    try:
        with journal(fleet.journal) as append, closing(run_tasks(process, waiting, pool or Pool())) as outcomes:
            for log, outcome in outcomes:
                done = lost(by_log[log], outcome.reason) if isinstance(outcome, Failure) else outcome
                if done.row is not None:
                    append({"key": done.key, "row": done.row})
                    fleet.add(log, done)
                finished(log)
    finally:
        fleet.save()
        fleet.journal.unlink(missing_ok=True)
    return fleet.table()


class _Fleet:
    """Finished rows, from the table, the journal and the present run."""

    def __init__(self, target: Path, jobs: Sequence[LogJob], saved_every: float) -> None:
        self.journal = target.with_name(f".{target.stem}.journal.jsonl")
        self._target, self._jobs, self._every = target, jobs, saved_every
        self._done: dict[str, Done] = {}
        if target.exists():
            self._read(read_fleet(target))
        self._changed, self._saved = False, monotonic()
        for entry in read_journal(self.journal):
            self._done[entry["row"]["log"]] = Done(entry["key"], entry["row"])
            self._changed = True

    def key(self, log: str) -> str | None:
        """Key of a finished log."""
        return self._done[log].key if log in self._done else None

    def add(self, log: str, done: Done) -> None:
        """Adds a row, and saves the table if the last save was long ago."""
        self._done[log], self._changed = done, True
        if monotonic() - self._saved > self._every:
            self.save()

    def save(self) -> None:
        """Writes the table, if it has changed."""
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


def _progress(logs: Sequence[str], watch: Watch | None) -> Callable[[str], None]:
    """Returns the function that counts a finished log: by the logs' sizes, which determine their time; by number if
    some are remote.
    """
    if watch is None:
        return lambda log: None
    remote = any(map(is_url, logs))
    sizes = {log: 1 if remote else _size(Path(log)) for log in logs}
    total, done = sum(sizes.values()), list[str]()

    def finished(log: str) -> None:
        done.append(log)
        watch("weighing logs", sum(sizes[log] for log in done), total, f"{len(done)} of {len(logs)}")

    watch("weighing logs", 0, total, f"0 of {len(logs)}")
    return finished


def _size(path: Path) -> int:
    """Size in bytes of a file or a folder, at least 1."""
    try:
        files = path.rglob("*") if path.is_dir() else [path]
        return max(1, sum(file.stat().st_size for file in files if file.is_file()))
    except OSError:  # reported in the log's own row
        return 1
