"""Table, curves and page of several methods on several logs."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from stadera.report.figures import Axis, Figure, Panel, Series
from stadera.report.numbers import with_std
from stadera.report.page import render
from stadera.report.table import Cell, TableData
from stadera.report.weigh.tables import place
from stadera.weigh.compare import Compared, Comparison

_HEAD = ("method", "trunk [kg]", "com x [m]", "com y [m]", "com z [m]", "payload [kg]", "trust")
_COLOURS = ("blue", "orange", "green", "purple", "steel", "ink")


def comparison_table(result: Comparison) -> TableData:
    """One row for each method, under the name of each log."""
    rows: dict[str, list[tuple[str | Cell, ...]]] = defaultdict(list)
    for each in result.entries:
        rows[each.log].append(_row(each))
    note = "± one standard deviation; bars of different methods contain different errors."
    return TableData.of(f"Weighings of {result.robot.name}", _HEAD, rows, note, "lrrrrrl")


def reasons(result: Comparison) -> tuple[str, ...]:
    """Why methods refused logs, or are not sure of them, one sentence each."""
    found = []
    for each in result.entries:
        said = (each.refusal,) if each.weighing is None else each.weighing.trust.reasons[:1]
        found += [f"{each.label} on {each.log}: {reason}" for reason in said]
    return tuple(found)


def comparison_figures(result: Comparison) -> dict[str, Figure]:
    """The trunk's mass over time by method, a figure for each log, by its name."""
    by_log: dict[str, list[Compared]] = defaultdict(list)
    for each in result.entries:
        if each.weighing is not None:
            by_log[each.log].append(each)
    return {log: _curves(log, entries) for log, entries in by_log.items()}


def comparison_html(result: Comparison) -> str:
    """The complete, self-contained page."""
    weighed = sum(each.weighing is not None for each in result.entries)
    return render(
        "compare.html.j2",
        title=f"Comparison: {result.robot.name}",
        headline=f"{weighed} of {len(result.entries)} weighings of {result.robot.name} gave a result",
        level="good" if weighed == len(result.entries) else "warning",
        table=comparison_table(result),
        notes=reasons(result),
        plots=list(comparison_figures(result).values()),
    )


def _row(each: Compared) -> tuple[str | Cell, ...]:
    found = each.weighing
    if found is None:
        return each.label, *[""] * 5, Cell("refused", good=False)
    payload = "" if found.payload is None else with_std(found.payload.mass, found.payload.mass_std)
    mass = with_std(found.mass, found.mass_std)
    return each.label, mass, *place(found.com, found.com_std), payload, found.trust.verdict


def _curves(log: str, entries: list[Compared]) -> Figure:
    marks = []
    for k, each in enumerate(entries):
        assert each.weighing is not None
        line, first = each.weighing.timeline, each.weighing.begin
        colour = _COLOURS[k % len(_COLOURS)]
        marks.append(Series(line.time - first, np.asarray(line.mass), each.label, colour, 1.6))
    panel = Panel(Axis("time [s]"), Axis("trunk's mass [kg]"), tuple(marks))
    return Figure(f"Mass over time: {log}", ((panel,),), "With all that is on it, as known at that time.", 300.0)
