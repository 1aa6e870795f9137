"""Tables, legends and notes for the terminal, in a common style."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from stadera.report.table import MARKS, Cell, TableData

_SIDES: dict[str, Literal["left", "right"]] = {"l": "left", "w": "left", "r": "right"}


def rich_table(data: TableData) -> Table:
    """Converts a table, with literal title and headings: rich would interpret "[kg]" as markup and drop it."""
    drawn = Table(title=Text(data.title), title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False)
    for heading, side in zip(data.head, data.columns, strict=True):
        drawn.add_column(Text(heading), justify=_SIDES[side], overflow="fold")
    for heading, rows in data.groups:
        if heading:
            drawn.add_row(Text(heading, style="italic"))
        for row in rows:
            drawn.add_row(*map(_cell, row))
        drawn.add_section()
    return drawn


def legend(note: str = "") -> Text:
    """Legend of the symbols and colours of observability."""
    text = Text()
    for mark in MARKS.values():
        text.append(f"{mark.symbol} {mark.word}  ", style=mark.style)
    return text.append(note, style="dim")


def notes(sentences: Iterable[str]) -> Iterator[Text]:
    """Notes on a result, one line each."""
    return (Text(f"note: {sentence}", style="dim") for sentence in sentences)


def _cell(cell: Cell) -> Text:
    text = Text(cell.marked, style=_style(cell))
    return text.append(f" {cell.note}", style="dim") if cell.note else text


def _style(cell: Cell) -> str:
    if cell.mark:
        return cell.mark.style
    if cell.good is not None:
        return "green" if cell.good else "bold red"
    return "bold" if cell.strong else ""
