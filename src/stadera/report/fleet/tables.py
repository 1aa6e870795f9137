"""Tables of a fleet, for terminal and page, and its terminal output with the logs that failed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import nan
from typing import TYPE_CHECKING

from rich.text import Text

from stadera.fleet.departures import Departure, departures
from stadera.fleet.series import LogRow, by_robot, series_of, when
from stadera.fleet.table import FleetTable
from stadera.report.numbers import number, with_std
from stadera.report.table import SHOWN, Cell, Row, TableData
from stadera.report.terminal import rich_table

if TYPE_CHECKING:
    from rich.console import RenderableType


def robots_table(table: FleetTable) -> TableData:
    """One row for each robot."""
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


def change_text(departure: Departure) -> str:
    """The change with its standard deviation and unit."""
    sign = "+" if departure.change > 0 else ""
    return f"{sign}{with_std(departure.change, departure.std)} {departure.series.unit}"


def time_text(departure: Departure) -> str:
    """The time in words: the time of day or the number of the log."""
    rows = departure.series.rows
    first, last = (when(rows[k]) or f"log {k + 1}" for k in (departure.first, departure.last))
    return {"since": f"since {first}", "once": f"in {first}", "while": f"from {first} to {last}"}[departure.kind]


def found_table(found: Sequence[Departure]) -> TableData:
    """Departures, one row each."""
    head = ("robot", "quantity", "when", "change", "of its bars", "chance", "first log")
    rows = [
        (
            Cell(d.series.robot, strong=True),
            f"{d.series.title} [{d.series.unit}]",
            time_text(d),
            change_text(d),
            f"{number(d.bars, 2)} σ",
            "below 10⁻⁹" if d.chance < 1e-9 else number(d.chance, 1),
            str(d.series.rows[d.first]["log"]).rpartition("/")[2],
        )
        for d in found
    ]
    return TableData.of("What stands out", head, rows, sides="lllrrrl")


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
