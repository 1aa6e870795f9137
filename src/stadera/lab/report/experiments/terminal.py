"""Terminal output of reproduced experiments: tables in Table I's colours, the outcome last."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType
from rich.padding import Padding
from rich.text import Text

from stadera.lab.experiments.result import ExperimentResult, Skipped
from stadera.lab.report.experiments.bounds import compared_records, outcome, record_table
from stadera.report.terminal import legend, rich_table


def experiment_renderables(result: ExperimentResult | Skipped) -> Iterator[RenderableType]:
    """One experiment."""
    if isinstance(result, Skipped):
        yield Text(f"{result.name} skipped: {result.reason}\n", style="yellow")
        return
    yield Padding(Text(result.title, style="bold reverse"), (0, 0, 1, 0))
    yield Padding(Text(result.lead), (0, 0, 1, 0))
    for table in result.tables:
        yield rich_table(table)
        below = legend(table.note) if table.has_verdicts else Text(table.note, style="dim")
        yield Padding(below, (0, 0, 1, 1))
    if records := compared_records(result):
        yield rich_table(record_table(records))
    yield Text(f"{result.name}: {outcome(result)}\n", style="bold red" if result.missed else "bold green")
