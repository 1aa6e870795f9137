"""Terminal output of a fleet: one row for each robot, and the logs that failed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.text import Text

from stadera.fleet.departures import departures
from stadera.fleet.series import series_of
from stadera.fleet.table import FleetTable
from stadera.report.fleet.tables import found_table, robots_table
from stadera.report.shown import SHOWN
from stadera.report.terminal import rich_table

if TYPE_CHECKING:
    from rich.console import RenderableType


def fleet_tables(table: FleetTable) -> Iterator[RenderableType]:
    """Summary after the run."""
    yield rich_table(robots_table(table))
    if found := departures(list(series_of(table))):
        yield rich_table(found_table(found))
    failed = [row for row in table.rows if row["status"] == "failed"]
    for row in failed[: SHOWN.failed]:
        yield Text(f"failed: {row['error']}", style="yellow")
    if len(failed) > SHOWN.failed:
        yield Text(f"and {len(failed) - SHOWN.failed} more that failed", style="yellow")
