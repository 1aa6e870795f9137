"""`stadera reproduce`: recomputes the paper's tables and figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from stadera.cli.options import PoolOptions, argument, flag, grouped, option
from stadera.cli.outputs import ResultFiles
from stadera.cli.terminal import progress, show

if TYPE_CHECKING:
    from stadera.lab.experiments.result import ExperimentResult, Skipped
    from stadera.report.figures import Figure
    from stadera.report.table import TableData


@grouped
def reproduce(
    name: Annotated[
        str,
        argument(
            "table1..table5|fig4..fig6|inertial_share|alarms|reality|faults|humanoids|identified|mini_cheetah|all",
            "Table or figure; all excludes the studies alarms, reality, faults, humanoids, identified, mini_cheetah.",
        ),
    ],
    folder: Annotated[Path | None, argument("FOLDER", "Folder of real logs, as --data.")] = None,
    seed: Annotated[int, option("N", "Seed of all random draws.", min=0)] = 0,
    quick: Annotated[bool, flag("A short, coarse version.", "--quick")] = False,
    data: Annotated[
        Path | None, option("FOLDER", "Folder of real logs [default: $STADERA_DATA, else ../shared/data].")
    ] = None,
    keep: Annotated[
        Path | None, option("FOLDER", "Folder in which long studies keep finished runs, to resume from.")
    ] = None,
    seeds: Annotated[
        int | None,
        option("N", "For alarms, reality, faults, humanoids, identified: repetitions of the whole grid.", min=1),
    ] = None,
    *,
    processes: PoolOptions,
    files: ResultFiles,
) -> None:
    """Reproduce tables and figures of the paper, and compare them with their bounds.

    A bound that is not met is reported in terminal, page and JSON; it is a measurement, not an error.
    """
    pool = processes.pool()

    from stadera.lab import require_lab

    require_lab("stadera reproduce")
    from stadera.lab.experiments import ReproduceSettings, experiments_named, run_experiments
    from stadera.lab.report.experiments import experiment_renderables

    experiments = experiments_named(name)
    files.check()
    results = []
    with progress() as watch:
        settings = ReproduceSettings(seed, quick, folder or data, keep, seeds, pool)
        for result in run_experiments(experiments, settings, watch or (lambda *_: None)):
            results.append(result)
    _write(results, files)
    for result in results:
        show(*experiment_renderables(result))


def _write(results: list[ExperimentResult | Skipped], files: ResultFiles) -> None:
    """Writes all outputs or none. Figures of several experiments are prefixed with the experiment's name:
    fig6-figure-1.
    """
    from stadera.lab.experiments.result import ExperimentResult
    from stadera.lab.report.experiments import experiments_html
    from stadera.report.latex import latex as latex_of

    done = [result for result in results if isinstance(result, ExperimentResult)]
    records = [record.to_dict() for result in done for record in result.records]

    def drawn() -> Mapping[str, Figure | TableData]:
        if len(done) == 1:
            return done[0].to_figures()
        return {f"{result.name}-{name}": shown for result in done for name, shown in result.to_figures().items()}

    files.write(
        values=lambda: records,
        page=lambda: experiments_html(results),
        latex=lambda: latex_of(table for result in done for table in result.tables),
        figures=drawn,
    )
