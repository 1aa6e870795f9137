"""Page of a fleet: failures and departures, each robot over its logs, and a table of all logs that can be sorted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import nan

import numpy as np
from markupsafe import Markup

from stadera.fleet.departures import Departure, departures, looks_at
from stadera.fleet.series import TRUNK, FleetSeries, LogRow, by_robot, series_of, when
from stadera.fleet.table import FleetTable
from stadera.report.fleet.tables import change_text, found_table, robots_table, time_text
from stadera.report.numbers import counted, number, with_std
from stadera.report.page import render
from stadera.report.table import SHOWN, Cell, Row, TableData
from stadera.types import Array


@dataclass(frozen=True)
class _Place:
    """Where values are drawn, in the drawing's own units: so many figures are too many for Plotly."""

    series: FleetSeries
    width: float = 380.0
    height: float = 150.0
    left: float = 58.0
    right: float = 8.0
    top: float = 8.0
    bottom: float = 20.0

    @property
    def x(self) -> Array:
        """(logs,)."""
        count = len(self.series.value)
        return self.left + (np.arange(count) + 0.5) * (self.width - self.left - self.right) / count

    @property
    def range(self) -> tuple[float, float]:
        """Range of all values with their bars, truncated if some bars are far longer than the rest."""
        value, std = self.series.value, self.series.std
        reach = np.minimum(2.0 * std, 3.0 * float(np.median(std)))
        low, high = float((value - reach).min()), float((value + reach).max())
        return low, high if high > low else low + 1.0

    def y(self, value: Array | float) -> Array:
        """Heights of values, within the drawing."""
        low, high = self.range
        inside = self.height - self.top - self.bottom
        return np.clip(
            self.top + inside * (high - np.asarray(value)) / (high - low), 0.0, self.height - self.bottom + 4
        )


def figure(series: FleetSeries, found: Sequence[Departure], named: bool = True) -> Markup:
    """Values over the logs with bars of two standard deviations, levels, departures, and tooltips if `named`."""
    place, count = _Place(series), len(series.value)
    x, y = place.x, place.y(series.value)
    out = np.zeros(count, dtype=bool)
    for departure in found:
        out[departure.first : departure.last + 1] = departure.kind != "since"
    doubtful = np.array([row["trust"] == "doubtful" for row in series.rows])
    css = np.where(out, "pt out", np.where(doubtful, "pt weak", "pt")).tolist()
    ends = place.y(series.value - 2 * series.std), place.y(series.value + 2 * series.std)
    bars = "".join(f"M{a:.1f} {b:.1f}V{c:.1f}" for a, b, c in zip(x, *ends, strict=True))
    parts = [_axis(place), Markup('<path class="bar" d="{}"/>').format(bars)]
    if named and count <= SHOWN.named:
        parts += [_point(series, k, css[k], x[k], y[k]) for k in range(count)]
    else:
        for kind in dict.fromkeys(css):
            dots = "".join(f"M{a:.1f} {b:.1f}h0" for a, b, c in zip(x, y, css, strict=True) if c == kind)
            parts.append(Markup('<path class="{} many" d="{}"/>').format(kind, dots))
    parts.append(Markup('<path class="level" d="{}"/>').format(_levels(place, found)))
    title = f"{series.title} [{series.unit}] of {series.robot} over {counted(count, 'log')}"
    return Markup('<svg viewBox="0 0 {:.0f} {:.0f}" role="img" aria-label="{}">{}</svg>').format(
        place.width, place.height, title, Markup("").join(parts)
    )


def _axis(place: _Place) -> Markup:
    """A low and a high value at the left; below, the times of the first and last log and their number."""
    (low, high), rows, end = place.range, place.series.rows, place.width - place.right
    step, below = 0.15 * (high - low), place.height - 4
    values = [(number(v, 3), place.left - 6, float(place.y(v)) + 4, "end") for v in (low + step, high - step)]
    first, last = (when(rows[0]) or "first log")[:10], (when(rows[-1]) or "last")[:10]
    middle = (counted(len(rows), "log"), 0.5 * (place.left + end), below, "middle")
    texts = [*values, (first, place.left, below, "start"), middle, (last, end, below, "end")]
    line = Markup('<path class="axis" d="M{0} {1}V{2}H{3}"/>').format(
        place.left, place.top, place.height - place.bottom + 4, end
    )
    return line + Markup("").join(
        Markup('<text x="{}" y="{:.0f}" text-anchor="{}">{}</text>').format(x, y, side, text)
        for text, x, y, side in texts
    )


def _levels(place: _Place, found: Sequence[Departure]) -> str:
    """A line at the mean of each stretch between departures."""
    series, x = place.series, place.x
    count = len(series.value)
    edges = sorted({0, count, *(d.first for d in found), *(d.last + 1 for d in found)})
    half, out = 0.5 * (place.width - place.left - place.right) / count, []
    for begin, end in pairwise(edges):
        mean = np.average(series.value[begin:end], weights=series.std[begin:end] ** -2)
        out.append(f"M{x[begin] - half:.1f} {float(place.y(mean)):.1f}H{x[end - 1] + half:.1f}")
    return "".join(out)


def _point(series: FleetSeries, k: int, css: str, x: float, y: float) -> Markup:
    row = series.rows[k]
    name = str(row["log"]).rpartition("/")[2]
    said = f"{when(row)} {name}: {with_std(series.value[k], series.std[k])} {series.unit}, {row['trust']}".strip()
    point = Markup('<circle class="{}" cx="{:.1f}" cy="{:.1f}" r="3"><title>{}</title></circle>')
    return point.format(css, x, y, said)


@dataclass(frozen=True)
class FleetPanel:
    """A figure with its title, and whether it contains departures."""

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
    robots, drawn = by_robot(table.rows), _drawn(fleet, found)
    return render(
        "fleet.html.j2",
        title=f"Fleet of {counted(len(robots), 'robot')}, {counted(len(table.rows), 'log')}",
        level="warning" if found or failed else "note",
        headline=_headline(found, fleet, len(failed), len(table.rows)),
        word="to be looked at" if found or failed else "good",
        why=f"{looks_at(fleet):,} looks; that they report anything of a fleet in which nothing happens has a "
        f"probability of at most {number(100.0 * chance, 1)} %",
        next=_advice(found, failed),
        robots=robots_table(table),
        found=found_table(found) if found else None,
        panels=[_panels(name, rows, fleet, drawn) for name, rows in robots.items()],
        logs=_logs_table(table),
        errors=Counter(str(row["error"]).removeprefix(f"{row['log']}: ") for row in failed).most_common(),
    )


def _headline(found: Sequence[Departure], fleet: Sequence[FleetSeries], failed: int, logs: int) -> str:
    if not fleet:
        return "No log gave a figure"
    if not found and failed:
        return f"{failed} of {counted(logs, 'log')} failed; in the others nothing stands out"
    if not found:
        return "Nothing stands out"
    first = found[0]
    others = len({d.series.robot for d in found}) - 1
    verb = "stands" if others == 1 else "stand"
    more = f", and {counted(others, 'more robot')} {verb} out" if others else ""
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
    outs = {series: [d for d in found if d.series is series] for series in fleet}
    panels: dict[FleetSeries, FleetPanel] = {}
    spent = 0
    for series in sorted(fleet, key=lambda series: (not outs[series], series.joint is not None)):
        svg = figure(series, outs[series], series.joint is None)
        spent += len(svg)
        if spent > SHOWN.figures:
            break
        panels[series] = FleetPanel(f"{series.title} [{series.unit}]", svg, bool(outs[series]))
    return panels


def _panels(
    name: str, rows: Sequence[LogRow], fleet: Sequence[FleetSeries], drawn: Mapping[FleetSeries, FleetPanel]
) -> RobotPanels:
    own = [series for series in fleet if series.robot == name]
    verdicts = Counter(row["trust"] or "failed" for row in rows)
    about = ", ".join(f"{verdicts[word]} {word}" for word in ("good", "doubtful", "bad", "failed") if verdicts[word])
    missing = sum(series not in drawn for series in own)
    left = f"; {missing} of its figures left out, in which nothing stands out" if missing else ""
    trunk, joints = (
        tuple(drawn[s] for s in own if s in drawn and (s.joint is None) is of_trunk) for of_trunk in (True, False)
    )
    return RobotPanels(name, f"{counted(len(rows), 'log')}: {about}{left}", trunk, joints)


def _logs_table(table: FleetTable) -> TableData:
    """All logs, the failed ones first; columns without values are omitted."""
    shown = [name for name in TRUNK if any(row[name] is not None for row in table.rows)]
    titles = [f"{TRUNK[name][0]} [{TRUNK[name][1]}]" for name in shown]
    dated = any(map(when, table.rows))
    head = ("log", "robot", *(["begins"] if dated else []), "lasts [s]", "trust", *titles, "changes", "misfit")
    rows = [_log_row(row, shown, dated) for row in sorted(table.rows, key=lambda row: row["status"] != "failed")]
    return TableData.of("All logs", head, rows, sides="ll" + "l" * dated + "rl" + "r" * (len(shown) + 2))


def _log_row(row: LogRow, shown: Sequence[str], dated: bool) -> Row:
    verdict = row["trust"] if row["status"] == "ok" else "failed"
    return (
        str(row["log"]).rpartition("/")[2],
        row["robot"] or "unknown",
        *([when(row)] if dated else []),
        "" if row["begin"] is None else number(row["end"] - row["begin"], 4),
        Cell(verdict, good={"good": None, "doubtful": False}.get(verdict, False)),
        *(_trunk_value(row, name) for name in shown),
        "" if row["changes"] is None else str(row["changes"]),
        "" if row["misfit"] is None else number(row["misfit"], 2),
    )


def _trunk_value(row: LogRow, name: str) -> str:
    """A value of the trunk with its error bar, in the unit shown; empty if it is missing."""
    factor, value, std = TRUNK[name][2], row[name], row[f"{name}_std"]
    return "" if value is None else with_std(factor * value, factor * (nan if std is None else std))
