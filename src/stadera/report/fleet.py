"""Tables and page of a fleet: failures, departures, each robot over its logs, and a table that can be sorted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.text import Text

from stadera.constants import DAY
from stadera.fleet.departures import (
    JOINT,
    TRUNK,
    Departure,
    FleetSeries,
    LogRow,
    by_robot,
    departures,
    looks_at,
    series_of,
    when,
)
from stadera.fleet.table import FleetTable
from stadera.report.figures import Axis, Figure, Panel, Series, plotly
from stadera.report.numbers import counted, number, with_std
from stadera.report.page import render
from stadera.report.table import SHOWN, Cell, Row, TableData, rich_table
from stadera.trunk.drives import TERMS
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.memory import UNCHANGED, Memory
from stadera.trunk.settings import ModelErrors
from stadera.types import Array

if TYPE_CHECKING:
    from rich.console import RenderableType

    from stadera.robot.model import Robot


def robots_table(table: FleetTable) -> TableData:
    """One row for each robot."""
    head = ("robot", "logs", "good", "doubtful", "failed", "recorded", "trunk in the last log [kg]")
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
        f"{hours:.1f} h" if hours >= 1.0 else f"{60.0 * hours:.1f} min",
        with_std(last.get("trunk_mass", nan), last.get("trunk_mass_std", nan)),
    )


def change_text(departure: Departure) -> str:
    """The change with its standard deviation and unit."""
    sign = "+" if departure.change > 0 else ""
    return f"{sign}{with_std(departure.change, departure.std)} {departure.series.unit}"


def time_text(departure: Departure) -> str:
    """The time in words: the time of day or the number of the log."""
    rows, numbers = departure.series.rows, departure.series.numbers
    first, last = (when(rows[k]) or f"log {numbers[k]}" for k in (departure.first, departure.last))
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


def figure(series: FleetSeries, found: Sequence[Departure], pages: Mapping[str, str]) -> Figure:
    """Values over the logs with bars of two standard deviations, levels, and what departs in red; a point opens its
    log's page.
    """
    value, std, rows = series.value, series.std, series.rows
    out = np.zeros(len(value), dtype=bool)
    for departure in found:
        out[departure.first : departure.last + 1] = departure.kind != "since"
    doubtful = np.array([row["trust"] == "doubtful" for row in rows])
    named = series.joint is None and len(rows) <= SHOWN.named
    x, axis = _time_axis(series)
    marks = [Series(x, value, "", "steel", 0.8)] if series.joint is None else []
    for colour, marker, chosen in (
        ("blue", "dot", ~out & ~doubtful),
        ("blue", "ring", ~out & doubtful),
        ("red", "dot", out),
    ):
        if chosen.any():
            half = 2.0 * std[chosen]
            bars = value[chosen] - half, value[chosen] + half
            look: dict[str, Any] = {"marker": marker, "size": 7.0, "y_range": bars}
            if named:
                look |= _texts(series, np.flatnonzero(chosen).tolist(), pages)
            marks.append(Series(x[chosen], value[chosen], "", colour, 0.0, **look))
    edges = sorted({0, len(value), *(d.first for d in found), *(d.last + 1 for d in found)})
    for begin, end in pairwise(edges):
        mean = float(np.average(value[begin:end], weights=std[begin:end] ** -2))
        marks.append(Series(x[[begin, end - 1]], np.array([mean, mean]), "", "orange", 1.5))
    reach = np.minimum(2.0 * std, 3.0 * float(np.median(std)))  # bars far longer than the rest are cut off
    low, high = float((value - reach).min()), float((value + reach).max())
    y = Axis(f"{series.title} [{series.unit}]", limits=(low, high) if high > low else None)
    title = f"{y.title} of {series.robot} over {counted(len(value), 'log')}"
    return Figure(title, ((Panel(axis, y, tuple(marks)),),), row_height=260.0, width=540.0)


def _time_axis(series: FleetSeries) -> tuple[Array, Axis]:
    """Places of the logs, by the time of day where all have one, else by number; ticks at whole ones."""
    rows, x, title = series.rows, series.numbers.astype(float), "number of the log"
    if all(map(when, rows)):
        x = np.array([row["begin"] for row in rows]) - rows[0]["begin"]
        unit, name = next(((u, n) for u, n in _UNITS if x.max() >= 2.0 * u), _UNITS[-1])
        x, title = x / unit, f"{name} since {when(rows[0])}"
    span = float(np.ptp(x))
    step = next(digit * 10.0**k for k in range(9) for digit in (1, 2, 5) if digit * 10**k >= span / 8.0)
    room = 0.04 * span or 0.5
    return x, Axis(title, limits=(float(x.min()) - room, float(x.max()) + room), step=step)


_UNITS = ((DAY, "days"), (3600.0, "hours"), (60.0, "minutes"))


def _texts(series: FleetSeries, which: Sequence[int], pages: Mapping[str, str]) -> dict[str, Any]:
    """What a pointer over the points of these logs shows, and the pages that they open."""
    hover, links = [], []
    for k in which:
        row, log = series.rows[k], str(series.rows[k]["log"])
        name = f"{when(row)} {log.rpartition('/')[2]}".strip()
        hover.append(f"{name}: {with_std(series.value[k], series.std[k])} {series.unit}, {row['trust']}")
        links.append(pages.get(log, ""))
    return {"hover": tuple(hover), "links": tuple(links)}


def fleet_html(table: FleetTable, pages: Mapping[str, str], memories: Mapping[str, tuple[Robot, Memory]]) -> str:
    """The complete, self-contained page.

    Args:
        pages: addresses of logs' pages, by log; those of other logs do not exist.
        memories: model and memory of robots, by name.
    """
    fleet = list(series_of(table))
    found = departures(fleet)
    failed = [row for row in table.rows if row["status"] == "failed"]
    robots, drawn = by_robot(table.rows), _drawn(fleet, found, pages)
    return render(
        "fleet.html.j2",
        title=f"Fleet of {counted(len(robots.keys() - {'unknown'}), 'robot')}, {counted(len(table.rows), 'log')}",
        level="warning" if found or failed else "note",
        headline=_headline(found, fleet, len(failed), len(table.rows)),
        word="to be looked at" if found or failed else "good",
        why=f"{counted(looks_at(fleet), 'comparison')}; the chance that any of them reports an unchanged fleet is at "
        f"most {number(100.0 * Departure.USUAL, 1)} %.",
        next=_advice(found, failed),
        robots=robots_table(table),
        failed=_failed_table(failed) if failed else None,
        more=len(failed) - SHOWN.rows,
        found=found_table(found) if found else None,
        panels=[
            _panels(name, rows, fleet, drawn) | _remembered(rows, memories.get(name)) for name, rows in robots.items()
        ],
        logs=_logs_table(table, pages),
        opens=bool(pages),
    )


def _headline(found: Sequence[Departure], fleet: Sequence[FleetSeries], failed: int, logs: int) -> str:
    said = [f"{failed} of {counted(logs, 'log')} failed"] if failed else []
    if not fleet:
        said.append("no log gave a figure")
    elif found:
        first, others = found[0], len({d.series.robot for d in found}) - 1
        verb = "stands" if others == 1 else "stand"
        more = f", and {counted(others, 'more robot')} {verb} out" if others else ""
        said.append(f"{first.series.robot}: {first.series.title} {change_text(first)} {time_text(first)}{more}")
    else:
        said.append("the others agree with each other" if failed else "nothing stands out")
    text = "; ".join(said)
    return text if found and not failed else f"{text[:1].upper()}{text[1:]}"


def _advice(found: Sequence[Departure], failed: Sequence[LogRow]) -> list[str]:
    first = [(d.series.robot, d.series.rows[d.first]["log"]) for d in found[:3]]
    steps = [f"{robot}: look at `stadera weigh {log} --robot R --report page.html`" for robot, log in first]
    which = "the log" if len(failed) == 1 else "one of the logs"
    wrong = [f"See what is wrong with {which} that failed: `stadera inspect {row['log']}`" for row in failed[:1]]
    return steps + wrong


def _drawn(
    fleet: Sequence[FleetSeries], found: Sequence[Departure], pages: Mapping[str, str]
) -> dict[FleetSeries, dict[str, Any]]:
    """Figures of all series if there is space, with their JSON; departures come first, then trunks, then joints."""
    outs = {series: [d for d in found if d.series is series] for series in fleet}
    panels: dict[FleetSeries, dict[str, Any]] = {}
    spent = 0
    for series in sorted(fleet, key=lambda series: (not outs[series], series.joint is not None)):
        shown = figure(series, outs[series], pages)
        data = plotly.data(shown)
        spent += len(data) + 600  # and what is around it
        if spent > SHOWN.figures:
            break
        panels[series] = {"figure": shown, "data": data, "out": bool(outs[series])}
    return panels


def _panels(
    name: str, rows: Sequence[LogRow], fleet: Sequence[FleetSeries], drawn: Mapping[FleetSeries, dict[str, Any]]
) -> dict[str, Any]:
    """The template's values for a robot: the trunk's figures, and the joints', which are folded unless one departs."""
    own = [series for series in fleet if series.robot == name]
    verdicts = Counter(row["trust"] if row["status"] == "ok" else "failed" for row in rows)
    about = ", ".join(f"{verdicts[word]} {word}" for word in ("good", "doubtful", "bad", "failed") if verdicts[word])
    missing = sum(series not in drawn for series in own)
    left = f"; {missing} of its figures left out, in which nothing stands out" if missing else ""
    trunk = [drawn[s] for s in own if s in drawn and s.joint is None]
    joints = [drawn[s] for s in own if s in drawn and s.joint is not None]
    return {"name": name, "about": f"{counted(len(rows), 'log')}: {about}{left}", "trunk": trunk, "joints": joints}


def _remembered(rows: Sequence[LogRow], known: tuple[Robot, Memory] | None) -> dict[str, Any]:
    """The template's values of what is remembered of a robot, and of logs that contradict it."""
    said = [f"{str(row['log']).rpartition('/')[2]}: {row['memory']}" for row in rows if row["memory"]]
    apart = [sentence for sentence in said if UNCHANGED in sentence]
    if known is None:
        return {"apart": apart, "memory": None}
    robot, memory = known
    found, model = memory.marginals(), ErrorModel(robot, ModelErrors())
    body = []
    for k, joint in enumerate(joint for leg in robot.legs for joint in leg.joints):
        cells = []
        for term, kind in TERMS.items():
            size = float(np.sqrt(model.variance[model.layout.places[kind]][k]))
            mean, std = (size * value for value in found[f"{kind}.{joint}"])
            cells.append(with_std(getattr(robot.dynamics[joint], term) + mean, std))
        body.append((joint, *cells))
    head = ("joint", *(f"{JOINT[term][0]} [{JOINT[term][1]}]" for term in TERMS))
    return {"apart": apart, "memory": TableData.of(f"Remembered of {counted(memory.logs, 'log')}", head, body)}


def _failed_table(failed: Sequence[LogRow]) -> TableData:
    """Logs that failed and why, those with the commonest reason first."""
    why = [str(row["error"]).removeprefix(f"{row['log']}: ") for row in failed]
    count = Counter(why)
    rows = sorted(zip(failed, why, strict=True), key=lambda pair: (-count[pair[1]], pair[1]))[: SHOWN.rows]
    named = ((str(row["log"]).rpartition("/")[2], row["robot"] or "unknown", reason) for row, reason in rows)
    return TableData.of("Logs that failed", ("log", "robot", "because"), named, sides="llw")


def _logs_table(table: FleetTable, pages: Mapping[str, str]) -> TableData:
    """All logs, the failed ones first; columns without values are omitted."""
    shown = [name for name in TRUNK if any(row[name] is not None for row in table.rows)]
    titles = [f"{TRUNK[name][0]} [{TRUNK[name][1]}]" for name in shown]
    dated = any(map(when, table.rows))
    head = ("log", "robot", *(["begins"] if dated else []), "lasts [s]", "trust", *titles, "changes", "misfit")
    first = sorted(table.rows, key=lambda row: row["status"] != "failed")
    rows = [_log_row(row, shown, dated, pages.get(str(row["log"]), "")) for row in first]
    return TableData.of("All logs", head, rows, sides="ll" + "l" * dated + "rl" + "r" * (len(shown) + 2))


def _log_row(row: LogRow, shown: Sequence[str], dated: bool, page: str) -> Row:
    verdict = row["trust"] if row["status"] == "ok" else "failed"
    trunk = [(TRUNK[name][2], row[name], row[f"{name}_std"]) for name in shown]
    return (
        Cell(str(row["log"]).rpartition("/")[2], link=page),
        row["robot"] or "unknown",
        *([when(row)] if dated else []),
        "" if row["begin"] is None else number(row["end"] - row["begin"], 4),
        Cell(verdict, good={"good": None, "doubtful": False}.get(verdict, False)),
        *("" if value is None else with_std(k * value, k * (nan if std is None else std)) for k, value, std in trunk),
        "" if row["changes"] is None else str(row["changes"]),
        "" if row["misfit"] is None else number(row["misfit"], 2),
    )
