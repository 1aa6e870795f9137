"""`stadera reproduce`: the paper's tables and figures, done again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli.options import JsonFile, ReportFile, Scheduler, Workers, check_workers
from stadera.cli.outputs import check_outputs, check_report, json_of, text_of, write_outputs
from stadera.cli.terminal import progress, show

if TYPE_CHECKING:
    from stadera.lab.experiments.result import ExperimentResult, Skipped


def reproduce(
    name: Annotated[
        str,
        typer.Argument(
            metavar="table1..table5|fig4..fig6|inertial_share|survival|walking|alarms|reality|all",
            help="Which table or figure; all leaves out survival, walking, alarms and reality, studies of an hour.",
        ),
    ],
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of every random draw.")] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="A short, coarse version, for a first look.")] = False,
    data: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Of real logs [default: $STADERA_DATA, else ../shared/data]."),
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Where long studies keep finished runs, to go on from if broken off."),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Of walking, alarms and reality: as many repetitions of the whole grid."),
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    json: JsonFile = None,
    report: ReportFile = None,
) -> None:
    """Reproduce tables and figures of the paper, and compare them with their bounds.

    A bound that is not met is reported in terminal, page and JSON; it is a measurement, not an error.
    """
    check_workers(workers, scheduler)

    from stadera.lab import require_lab

    require_lab("stadera reproduce")
    from stadera.fleet.pool import Pool
    from stadera.lab.experiments import ReproduceSettings, experiments_named, run_experiments
    from stadera.lab.report.experiments.terminal import experiment_renderables

    experiments = experiments_named(name)
    check_outputs((json, report))
    check_report(report)
    results = []
    with progress() as watch:
        settings = ReproduceSettings(seed, quick, data, keep, seeds, Pool(workers, scheduler))
        for result in run_experiments(experiments, settings, watch or (lambda *_: None)):
            results.append(result)
    _write(results, json, report)
    for result in results:
        show(*experiment_renderables(result))


def _write(results: list[ExperimentResult | Skipped], json: Path | None, report: Path | None) -> None:
    """Both outputs or none."""
    from stadera.lab.experiments.result import ExperimentResult
    from stadera.lab.report.experiments.page import experiments_html

    records = [r.to_dict() for result in results if isinstance(result, ExperimentResult) for r in result.records]
    write_outputs((json, json_of(lambda: records)), (report, text_of(lambda: experiments_html(results))))
