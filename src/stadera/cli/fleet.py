"""`stadera fleet`: weighs many logs into one table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.boundary import foreign
from stadera.cli import options as opt
from stadera.cli import parse
from stadera.cli.options import argument, flag, grouped, option, refuse
from stadera.cli.outputs import check_outputs, check_report, json_of, page_of, write_outputs
from stadera.cli.terminal import progress, show
from stadera.errors import StaderaError
from stadera.report.numbers import counted

if TYPE_CHECKING:
    from stadera.fleet.jobs import FleetOptions, LogJob
    from stadera.fleet.pool import Pool
    from stadera.fleet.table import FleetTable
    from stadera.robot.model import Robot
    from stadera.trunk.memory import Memory


@dataclass(frozen=True)
class FleetLogs:
    """Options for the logs and the robots that they are of."""

    logs: Annotated[list[str] | None, argument("[LOG_OR_GLOB]...", "Paths, URLs, or globs of them.")] = None
    robot: Annotated[
        str | None, option("R", "A robot's name, or a path to a URDF or MJCF [default: from each log].")
    ] = None
    manifest: Annotated[
        Path | None, option("F.csv", "One log per line: log, and optionally robot, tare, legs, name.")
    ] = None
    names: Annotated[
        str | None, option("REGEX", "Names the individual robot: the first group matched in a log's path.")
    ] = None
    tare: opt.Tare = None
    legs: opt.LegsFile = None

    def check(self) -> None:
        """Raises BadParameter unless there are either logs or a manifest, whose lines have the other options."""
        if (self.manifest is None) == (not self.logs):
            raise typer.BadParameter("name logs or a --manifest", param_hint="LOG_OR_GLOB")
        if self.manifest is not None:
            refuse("is of the manifest's lines", {"--tare": self.tare, "--legs": self.legs, "--names": self.names})

    def jobs(self, options: FleetOptions) -> list[LogJob]:
        """A job for each log. Raises as `read_manifest` and `jobs_of`."""
        from stadera.fleet.jobs import jobs_of, read_manifest

        if self.manifest is not None:
            return read_manifest(self.manifest, self.robot, options)
        legs = None if self.legs is None else str(self.legs)
        return jobs_of(self.logs or (), self.robot, self.tare, legs, self.names, options)


@dataclass(frozen=True)
class FleetFiles:
    """Options for what is written besides the table."""

    json: opt.JsonFile = None
    report: opt.ReportFile = None
    pages: Annotated[
        Path | None, option("FOLDER", "Write a page of each log; points and rows of the --report open them.")
    ] = None

    def check(self, *others: Path | None) -> None:
        """Checks these and other files before the computation, and makes the folder. Raises StaderaError."""
        check_outputs((*others, self.json, self.report))
        check_report(self.report)
        if self.pages is not None:
            with foreign(self.pages, "no folder can be made there", StaderaError):
                self.pages.mkdir(parents=True, exist_ok=True)


@grouped
def fleet(
    out: Annotated[Path, option("F.parquet", "The table; logs that it already contains are skipped.")],
    identify: Annotated[
        bool, flag("Identify legs, from logs of robots on a stand, instead of weighing.", "--identify")
    ] = False,
    merge: Annotated[
        Path | None,
        option("LEGS.json", "With --identify: each robot's legs from all its logs, for `weigh --legs`; LEGS-NAME."),
    ] = None,
    method: opt.Method = None,
    stiffness: opt.Stiffness = None,
    imu_frame: opt.ImuFrame = None,
    force: opt.Force = False,
    memory: Annotated[
        Path | None,
        option(
            "F.json", "The robot as known from earlier logs; read if it is there, and written anew; F-NAME of several."
        ),
    ] = None,
    worker_memory: Annotated[
        float, option("GB", "Memory of a local worker, above which it is restarted.", "--worker-memory")
    ] = 2.0,
    *,
    given: FleetLogs,
    files: FleetFiles,
    processes: opt.PoolOptions,
    options: opt.LogOptions,
    shape: opt.ModelOptions,
) -> None:
    """Weigh the logs of many robots, on all cores or a Dask cluster, and write one table with a row per log.

    A log that fails becomes a row with its error. Rows are saved as they arrive: after an interruption the same command
    resumes, and finished logs are skipped while log, options and version are unchanged.
    """
    given.check()
    pool = processes.pool(memory=round(1e9 * worker_memory))
    if not identify:
        refuse("needs --identify", {"--merge": merge})
    springs = None if stiffness is None else parse.point(stiffness)

    from stadera.fleet.jobs import FleetOptions
    from stadera.fleet.run import memory_paths
    from stadera.report.fleet import fleet_tables

    folder = None if files.pages is None else str(files.pages.absolute())
    shared = FleetOptions(
        identify, method, springs, imu_frame, options.topics, options.reading, force, options.fix,
        parse.names(shape.feet) or (), shape.trunk, folder,
    )  # fmt: skip
    jobs = given.jobs(shared)
    known = {} if memory is None else memory_paths(memory, jobs)
    files.check(out, merge, *known.values())
    table = _run(jobs, out, pool, memory)
    page = page_of(lambda: table.to_html(_links(table, files.pages, files.report), _memories(jobs, known)))
    write_outputs((files.json, json_of(table.to_dict)), (files.report, page))
    if merge is not None:
        _merge(table, jobs, merge)
    show(*fleet_tables(table))
    _require_one(table)


def _run(jobs: list[LogJob], out: Path, pool: Pool, memory: Path | None) -> FleetTable:
    """Runs the fleet. Raises StaderaError after Ctrl-C; finished rows are kept."""
    from stadera.fleet.run import run_fleet

    try:
        with progress() as watch:
            return run_fleet(jobs, out, pool, watch, memory=memory)
    except KeyboardInterrupt:
        kept = f"; what is done is in {out}, and the same command goes on from there" if out.exists() else ""
        raise StaderaError(f"broken off{kept or ' before any log was done'}") from None


def _require_one(table: FleetTable) -> None:
    """Raises StaderaError: all logs failed, so that the call is probably wrong."""
    if all(row["status"] == "failed" for row in table.rows):
        many = f"all {len(table.rows)} logs failed, the first" if len(table.rows) > 1 else "the only log failed"
        raise StaderaError(f"{many}: {table.rows[0]['error']}")


def _memories(jobs: list[LogJob], files: Mapping[str, Path]) -> dict[str, tuple[Robot, Memory]]:
    """Model and memory of each robot that has one, by its name in the table."""
    from stadera.fleet.jobs import robot_named_in
    from stadera.fleet.run import owner_of
    from stadera.trunk.memory import Memory

    models = {owner_of(job): job for job in jobs if files}
    found = {
        of: job.model(job.robot or robot_named_in(Path(job.log))) for of, job in models.items() if files[of].exists()
    }
    return {of: (robot, Memory.read(files[of], robot)) for of, robot in found.items()}


def _links(table: FleetTable, pages: Path | None, report: Path | None) -> dict[str, str]:
    """Addresses, as seen from the report, of the logs' pages that exist."""
    from os.path import relpath
    from urllib.parse import quote

    from stadera.fleet.run import page_path

    if pages is None or report is None:
        return {}
    found = {row["log"]: page_path(pages, row["log"]) for row in table.rows}
    return {log: quote(relpath(page, report.parent)) for log, page in found.items() if page.is_file()}


def _merge(table: FleetTable, jobs: list[LogJob], path: Path) -> None:
    from stadera.fleet.merge import merge_fleet

    merged = merge_fleet(table, jobs)
    paths = {name: path if len(merged) == 1 else path.with_stem(f"{path.stem}-{Path(name).stem}") for name in merged}
    write_outputs(*((paths[name], json_of(legs.to_dict)) for name, legs in merged.items()))
    for name, legs in merged.items():
        show(f"{name}: legs by {counted(len(legs.logs), 'log')}, {legs.trust.verdict}, misfit {legs.trust.misfit:.2g}")
