"""Reproduced experiments for the terminal: tables in Table I's colours, the judgement last."""

from __future__ import annotations

from collections.abc import Iterator

from rich import box
from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from stadera.experiments.result import Cell, ExperimentResult, Skipped, TableData
from stadera.report.judged import judged_records, judgement, record_table
from stadera.report.quantities import MARKS
from stadera.report.tables import STYLES
from stadera.report.terminal import titled_table

_BELOW = (0, 0, 1, 1)


def experiment_renderables(result: ExperimentResult | Skipped) -> Iterator[RenderableType]:
    """One experiment."""
    if isinstance(result, Skipped):
        yield Text(f"{result.name} skipped: {result.reason}\n", style="yellow")
        return
    yield Padding(Text(result.title, style="bold reverse"), (0, 0, 1, 0))
    yield Padding(Text(result.lead), (0, 0, 1, 0))
    for table in result.tables:
        yield data_table(table)
        below = _legend() if table.has_verdicts else Text()
        below.append(table.note, style="dim")
        yield Padding(below, _BELOW)
    if records := judged_records(result):
        yield data_table(record_table(records))
    yield Text(f"{result.name}: {judgement(result)}\n", style="bold red" if result.missed else "bold green")


def data_table(data: TableData) -> Table:
    """A table with its groups under headings."""
    table = titled_table(data.title, data.head, fold=True, box=box.SIMPLE_HEAD, edge=False)
    for heading, rows in data.groups:
        if heading:
            table.add_row(Text(heading, style="italic"))
        for row in rows:
            table.add_row(*(_cell(cell) for cell in row))
        table.add_section()
    return table


def _cell(cell: Cell) -> Text:
    if cell.verdict is not None:
        mark = MARKS[cell.verdict]
        return Text(f"{mark.symbol} {cell.text}", style=STYLES[mark.colour])
    if cell.good is not None:
        return Text(cell.text, style="green" if cell.good else "bold red")
    return Text(cell.text, style="bold" if cell.strong else "")


def _legend() -> Text:
    text = Text()
    for mark in MARKS.values():
        text.append(f"{mark.symbol} {mark.word}  ", style=STYLES[mark.colour])
    return text
