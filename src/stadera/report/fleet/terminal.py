"""A fleet in the terminal: a line a robot, and the logs that failed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import nan
from typing import TYPE_CHECKING, Any

from rich.text import Text

from stadera.fleet.table import FleetTable
from stadera.report.numbers import with_std
from stadera.report.table import Cell, Row, TableData
from stadera.report.terminal import rich_table

if TYPE_CHECKING:
    from rich.console import RenderableType

_LISTED = 10  # of the logs that failed

LogRow = Mapping[str, Any]


def fleet_tables(table: FleetTable) -> Iterator[RenderableType]:
    """What a person wants to know when the work is done."""
    yield rich_table(robots_table(table))
    failed = [row for row in table.rows if row["status"] == "failed"]
    for row in failed[:_LISTED]:
        yield Text(f"failed: {row['error']}", style="yellow")
    if len(failed) > _LISTED:
        yield Text(f"and {len(failed) - _LISTED} more that failed", style="yellow")


def by_robot(rows: Sequence[LogRow]) -> dict[str, list[LogRow]]:
    """Rows by robot, robots by name; rows of an unknown robot under "unknown"."""
    robots: dict[str, list[LogRow]] = {}
    for row in sorted(rows, key=lambda row: str(row["robot"])):
        robots.setdefault(row["robot"] or "unknown", []).append(row)
    return robots


def robots_table(table: FleetTable) -> TableData:
    """A line a robot."""
    head = ("robot", "logs", "good", "doubtful", "failed", "hours", "trunk in the last log [kg]")
    return TableData.of("Fleet", head, (_line(name, rows) for name, rows in by_robot(table.rows).items()))


def _line(name: str, rows: Sequence[LogRow]) -> Row:
    done = [row for row in rows if row["status"] == "ok"]
    hours = sum(row["end"] - row["begin"] for row in done) / 3600.0
    weighed = [row for row in done if row["trunk_mass"] is not None]
    last = weighed[-1] if weighed else {}
    failed = len(rows) - len(done)
    return (
        name,
        f"{len(rows)}",
        f"{sum(row['trust'] == 'good' for row in done)}",
        f"{sum(row['trust'] == 'doubtful' for row in done)}",
        Cell(f"{failed}", good=False if failed else None),
        f"{hours:.2f}",
        with_std(last.get("trunk_mass", nan), last.get("trunk_mass_std", nan)),
    )
