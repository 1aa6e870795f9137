"""Page of a fleet: departures, each robot over its logs, and a table of all logs that can be sorted and filtered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import nan
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from stadera.fleet.departures import Departure, departures, looks_at
from stadera.fleet.series import TRUNK, FleetSeries, LogRow, by_robot, series_of, when
from stadera.fleet.table import FleetTable
from stadera.report.fleet.tables import change_text, found_table, robots_table, time_text
from stadera.report.numbers import number, with_std
from stadera.report.page import render
from stadera.report.shown import SHOWN
from stadera.report.table import Cell, Row, TableData
from stadera.report.trust import Level
from stadera.types import Array

_WIDTH, _HEIGHT = 380, 150  # of the drawing, in its own units
_LEFT, _RIGHT, _TOP, _BOTTOM = 58, 8, 8, 20


def figure(series: FleetSeries, found: Sequence[Departure], named: bool = True) -> Markup:
    """Values over the logs with bars of two standard deviations, levels, departures, and tooltips if `named`."""
    count = len(series.value)
    low, high = _range(series)
    x = _LEFT + (np.arange(count) + 0.5) * (_WIDTH - _LEFT - _RIGHT) / count
    y, bar = (
        _height(series.value, low, high),
        _height(np.stack([series.value - 2 * series.std, series.value + 2 * series.std]), low, high),
    )
    out = np.zeros(count, dtype=bool)
    for departure in found:
        out[departure.first : departure.last + 1] = departure.kind != "since"
    doubtful = np.array([row["trust"] == "doubtful" for row in series.rows])
    parts = [_axis(series, low, high), Markup('<path class="bar" d="{}"/>').format(_bars(x, bar))]
    if named and count <= SHOWN.named:
        parts += [_point(series, k, x[k], y[k], out[k], doubtful[k]) for k in range(count)]
    else:
        for css, chosen in (("pt", ~out & ~doubtful), ("pt weak", ~out & doubtful), ("pt out", out)):
            parts.append(Markup('<path class="{} many" d="{}"/>').format(css, _dots(x[chosen], y[chosen])))
    parts.append(Markup('<path class="level" d="{}"/>').format(_levels(series, found, x, low, high)))
    title = f"{series.title} [{series.unit}] of {series.robot} over {count} logs"
    return Markup('<svg viewBox="0 0 {} {}" role="img" aria-label="{}">{}</svg>').format(
        _WIDTH, _HEIGHT, title, Markup("").join(parts)
    )


def _range(series: FleetSeries) -> tuple[float, float]:
    """Range of all values with their bars, truncated if some bars are far longer than the rest."""
    usual = 3.0 * float(np.median(series.std))
    reach = np.minimum(2.0 * series.std, usual)
    low, high = float((series.value - reach).min()), float((series.value + reach).max())
    return low, high if high > low else low + 1.0


def _height(value: Array | np.float64, low: float, high: float) -> Array:
    inside = _HEIGHT - _TOP - _BOTTOM
    return np.clip(_TOP + inside * (high - value) / (high - low), 0.0, _HEIGHT - _BOTTOM + 4.0)


def _axis(series: FleetSeries, low: float, high: float) -> Markup:
    """Least and largest value at the left, first and last time below."""
    step = 0.15 * (high - low)
    texts = [
        (f"{number(v, 3)}", _LEFT - 6, float(_height(np.array(v), low, high)) + 4, "end")
        for v in (low + step, high - step)
    ]
    first, last = when(series.rows[0]) or "first log", when(series.rows[-1]) or "last"
    texts += [(first[:10], _LEFT, _HEIGHT - 4, "start"), (last[:10], _WIDTH - _RIGHT, _HEIGHT - 4, "end")]
    lines = Markup('<path class="axis" d="M{0} {1}V{2}H{3}"/>').format(
        _LEFT, _TOP, _HEIGHT - _BOTTOM + 4, _WIDTH - _RIGHT
    )
    return lines + Markup("").join(
        Markup('<text x="{}" y="{:.0f}" text-anchor="{}">{}</text>').format(x, y, side, text)
        for text, x, y, side in texts
    )


def _bars(x: Array, bar: Array) -> str:
    return "".join(f"M{a:.1f} {b:.1f}V{c:.1f}" for a, b, c in zip(x, bar[0], bar[1], strict=True))


def _dots(x: Array, y: Array) -> str:
    return "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x, y, strict=True))


def _levels(series: FleetSeries, found: Sequence[Departure], x: Array, low: float, high: float) -> str:
    """A line at the mean of each stretch between departures."""
    count = len(series.value)
    edges = sorted({0, count, *(d.first for d in found), *(d.last + 1 for d in found)})
    half, out = 0.5 * (_WIDTH - _LEFT - _RIGHT) / count, []
    for begin, end in pairwise(edges):
        mean = np.average(series.value[begin:end], weights=series.std[begin:end] ** -2)
        out.append(f"M{x[begin] - half:.1f} {float(_height(mean, low, high)):.1f}H{x[end - 1] + half:.1f}")
    return "".join(out)


def _point(series: FleetSeries, k: int, x: float, y: float, out: bool, doubtful: bool) -> Markup:
    row = series.rows[k]
    name = str(row["log"]).rpartition("/")[2]
    said = f"{when(row)} {name}: {with_std(series.value[k], series.std[k])} {series.unit}, {row['trust']}".strip()
    css = "pt out" if out else "pt weak" if doubtful else "pt"
    return Markup('<circle class="{}" cx="{:.1f}" cy="{:.1f}" r="3"><title>{}</title></circle>').format(
        css, x, y, escape(said)
    )


_FIGURES = 1_400_000  # bytes of all figures, such that a page of 1,000 logs stays below 3 MB


@dataclass(frozen=True)
class FleetPanel:
    """A figure with its title."""

    title: str
    figure: Markup
    out: bool


@dataclass(frozen=True)
class RobotPanels:
    """Figures of a robot: the trunk's, then the joints', collapsed unless they contain departures."""

    name: str
    about: str
    trunk: tuple[FleetPanel, ...]
    joints: tuple[FleetPanel, ...]


def fleet_html(table: FleetTable, chance: float = 0.01) -> str:
    """The complete, self-contained page; `chance`: probability of reporting any departure from an unchanged fleet."""
    fleet = list(series_of(table))
    found = departures(fleet, chance)
    failed = [row for row in table.rows if row["status"] == "failed"]
    level: Level = "warning" if found or failed else "note"
    robots, drawn = by_robot(table.rows), _drawn(fleet, found)
    return render(
        "fleet.html.j2",
        title=f"Fleet of {len(robots)} robot{'s' if len(robots) > 1 else ''}, {len(table.rows)} logs",
        level=level,
        headline=_headline(found, fleet),
        word="to be looked at" if found or failed else "good",
        why=f"{looks_at(fleet):,} looks; that they report anything of a fleet in which nothing happens has a "
        f"probability of at most {number(100.0 * chance, 1)} %",
        next=_advice(found, failed),
        robots=robots_table(table),
        found=found_table(found) if found else None,
        panels=[_panels(name, rows, fleet, drawn) for name, rows in robots.items()],
        logs=_logs_table(table),
        errors=_errors(failed),
    )


def _headline(found: Sequence[Departure], fleet: Sequence[FleetSeries]) -> str:
    if not fleet:
        return "No log gave a figure"
    if not found:
        return "Nothing stands out"
    first = found[0]
    others = len({d.series.robot for d in found}) - 1
    more = (
        f", and {others} more robot{'s' if others > 1 else ''} stand{'' if others > 1 else 's'} out" if others else ""
    )
    return f"{first.series.robot}: {first.series.title} {change_text(first)} {time_text(first)}{more}"


def _advice(found: Sequence[Departure], failed: Sequence[LogRow]) -> list[str]:
    steps = []
    for departure in found[:3]:
        log = departure.series.rows[departure.first]["log"]
        steps.append(f"{departure.series.robot}: look at `stadera weigh {log} --robot R --report page.html`")
    if failed:
        steps.append(f"{len(failed)} failed; see what is wrong with one by `stadera inspect {failed[0]['log']}`")
    return steps


def _drawn(fleet: Sequence[FleetSeries], found: Sequence[Departure]) -> dict[FleetSeries, FleetPanel]:
    """Figures of all series if there is space; departures come first, then trunks, then joints."""
    outs: dict[FleetSeries, list[Departure]] = {series: [] for series in fleet}
    for departure in found:
        outs[departure.series].append(departure)
    panels: dict[FleetSeries, FleetPanel] = {}
    spent = 0
    for series in sorted(fleet, key=lambda series: (not outs[series], series.joint is not None)):
        svg = figure(series, outs[series], series.joint is None)
        spent += len(svg)
        if spent > _FIGURES:
            break
        panels[series] = FleetPanel(f"{series.title} [{series.unit}]", svg, bool(outs[series]))
    return panels


def _panels(
    name: str, rows: Sequence[LogRow], fleet: Sequence[FleetSeries], drawn: Mapping[FleetSeries, FleetPanel]
) -> RobotPanels:
    own = [series for series in fleet if series.robot == name]
    verdicts = Counter(row["trust"] or "failed" for row in rows)
    about = ", ".join(f"{verdicts[word]} {word}" for word in ("good", "doubtful", "bad", "failed") if verdicts[word])
    missing = len([series for series in own if series not in drawn])
    left = f"; {missing} of its figures left out, in which nothing stands out" if missing else ""
    trunk, joints = (
        tuple(drawn[s] for s in own if s in drawn and (s.joint is None) is of_trunk) for of_trunk in (True, False)
    )
    return RobotPanels(name, f"{len(rows)} logs: {about}{left}", trunk, joints)


def _logs_table(table: FleetTable) -> TableData:
    """All logs; columns without values are omitted."""
    shown = [name for name in TRUNK if any(row[name] is not None for row in table.rows)]
    titles = [f"{TRUNK[name][0]} [{TRUNK[name][1]}]" for name in shown]
    dated = any(map(when, table.rows))
    head = ("log", "robot", *(["begins"] if dated else []), "lasts [s]", "trust", *titles, "changes", "misfit")
    rows = [_log_row(row, shown, dated) for row in table.rows]
    return TableData.of("All logs", head, rows, sides="ll" + "l" * dated + "rl" + "r" * (len(shown) + 2))


def _log_row(row: LogRow, shown: Sequence[str], dated: bool) -> Row:
    def text(value: Any, digits: int = 3) -> str:
        return "" if value is None else number(value, digits)

    length = None if row["begin"] is None else row["end"] - row["begin"]
    verdict = row["trust"] if row["status"] == "ok" else "failed"
    return (
        str(row["log"]).rpartition("/")[2],
        row["robot"] or "unknown",
        *([when(row)] if dated else []),
        text(length, 4),
        Cell(verdict, good={"good": None, "doubtful": False}.get(verdict, False)),
        *(_trunk_value(row, name) for name in shown),
        "" if row["changes"] is None else str(row["changes"]),
        text(row["misfit"], 2),
    )


def _trunk_value(row: LogRow, name: str) -> str:
    """A value of the trunk with its error bar, in the unit shown; empty if it is missing."""
    factor, value, std = TRUNK[name][2], row[name], row[f"{name}_std"]
    return "" if value is None else with_std(factor * value, factor * (nan if std is None else std))


def _errors(failed: Sequence[LogRow]) -> list[tuple[str, int]]:
    """Error messages without paths, with their counts; the most frequent first."""
    reasons = Counter(str(row["error"]).removeprefix(f"{row['log']}: ") for row in failed)
    return reasons.most_common()
