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
from stadera.fleet.jobs import LogJob, check_models
from stadera.fleet.journal import journal, read_journal
from stadera.fleet.pool import Failure, Pool, run_tasks
from stadera.fleet.row import Done, Row, Task, is_done, lost, process
from stadera.fleet.source import is_url, size_of
from stadera.fleet.table import SIDES, FleetTable, read_fleet, side_path, table_path

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
    check_models(jobs)
    fleet = _Fleet(target, jobs, saved_every)
    by_log = {job.log: job for job in jobs}
    tasks = {log: Task(job, fleet.key(log)) for log, job in by_log.items()}
    waiting = {log: task for log, task in tasks.items() if not is_done(task)}
    progress = _Progress([by_log[log] for log in waiting], watch)
    try:
        with journal(fleet.journal) as append, closing(run_tasks(process, waiting, pool or Pool())) as outcomes:
            for log, outcome in outcomes:
                done = lost(by_log[log], outcome.reason) if isinstance(outcome, Failure) else outcome
                if done.row is not None:
                    append({"key": done.key, "row": done.row, **done.sides})
                    fleet.add(log, done)
                progress.finished(log)
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
            sides = {name: tuple(entry[name]) for name in SIDES}
            self._done[entry["row"]["log"]] = Done(entry["key"], entry["row"], sides)
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
        done = [self._done[log] for log in order]
        sides = {name: tuple(row for one in done for row in one.sides.get(name, ())) for name in SIDES}
        return FleetTable(tuple(one.row or {} for one in done), keys=tuple(one.key for one in done), **sides)

    def _read(self, table: FleetTable) -> None:
        sides: dict[str, dict[str, list[Row]]] = {row["log"]: {name: [] for name in SIDES} for row in table.rows}
        for name in SIDES:
            for row in getattr(table, name):
                sides[row["log"]][name].append(row)
        for row, key in zip(table.rows, table.keys, strict=True):
            own = {name: tuple(rows) for name, rows in sides[row["log"]].items()}
            self._done[row["log"]] = Done(key, row, own)


class _Progress:
    """Progress by the logs' sizes, which determine their time; by number if some are remote."""

    def __init__(self, jobs: Sequence[LogJob], watch: Watch | None) -> None:
        self._watch, self._done = watch, 0
        remote = watch is None or any(is_url(job.log) for job in jobs)
        self._sizes = {job.log: 1 if remote else max(size_of(job.log), 1) for job in jobs}
        self._total, self._logs = sum(self._sizes.values()), 0
        self._show()

    def finished(self, log: str) -> None:
        """Counts a finished log."""
        self._done, self._logs = self._done + self._sizes[log], self._logs + 1
        self._show()

    def _show(self) -> None:
        if self._watch is not None:
            self._watch("weighing logs", self._done, self._total, f"{self._logs} of {len(self._sizes)}")
