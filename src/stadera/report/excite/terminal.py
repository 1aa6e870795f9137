"""Terminal output of an excitation."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType
from rich.text import Text

from stadera.excite.result import Excitation
from stadera.report.excite.tables import limits_table, verdict, worth_table
from stadera.report.terminal import notes, rich_table


def excitation_tables(result: Excitation) -> Iterator[RenderableType]:
    """The motion's extremes by joint, its expected information, and the comparison with random draws."""
    yield rich_table(limits_table(result))
    yield rich_table(worth_table(result))
    yield from notes(result.experiment.bounds.clearance.notes)
    yield Text(verdict(result))
