"""Page of several methods on several logs: what each says, and over time."""

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from stadera.report.figures import Axis, Figure, Panel, Series, band, line, stacked
from stadera.report.numbers import counted, listed, with_std
from stadera.report.page import render
from stadera.report.table import Cell, Row, TableData
from stadera.report.trust import LEVELS
from stadera.report.weigh.plots import room
from stadera.report.weigh.tables import place
from stadera.types import Array
from stadera.weigh.compare import Comparison, MethodResult
from stadera.weigh.result import Weighing

_COMPARED = ("method", "trunk [kg]", "com x [m]", "com y [m]", "com z [m]", "payload [kg]", "trust")
_COLOURS = ("blue", "orange", "green", "purple", "steel", "ink")

Weighed = tuple[MethodResult, Weighing]
"""An entry that has a result, and that result."""


def tables(result: Comparison) -> list[TableData]:
    """One row for each method, under the name of each log."""
    rows: dict[str, list[Row]] = defaultdict(list)
    for each in result.entries:
        rows[each.log].append(_row(each))
    note = "± one standard deviation; bars of different methods contain different errors."
    return [TableData.of(f"Weighings of {result.robot.name}", _COMPARED, rows, note, "lrrrrrl")]


def reasons(result: Comparison) -> tuple[str, ...]:
    """Why methods refused logs, or are not sure of them, and payloads that are on no trunk, one sentence each."""
    found = []
    for each in result.entries:
        said = (each.refusal,) if each.weighing is None else each.weighing.trust.reasons[:1]
        payload = None if each.weighing is None else each.weighing.payload
        if payload is not None and payload.at:
            said = (*said, f"the payload is at {payload.at}, no part of the trunk's values")
        found += [f"{each.label} on {each.log}: {reason}" for reason in said]
    return tuple(found)


def figures(result: Comparison) -> dict[str, Figure]:
    """All results side by side, "estimates"; then mass and payload over time by each method, a figure for each log, by
    its name.
    """
    by_log: dict[str, list[Weighed]] = defaultdict(list)
    for each in _weighed(result):
        by_log[each[0].log].append(each)
    curves = {log: _curves(log, entries) for log, entries in by_log.items()}
    return {"estimates": _estimates(result)} | curves if curves else {}


def html(result: Comparison) -> str:
    """The complete, self-contained page."""
    weighed, verdicts = list(_weighed(result)), ("bad", "doubtful", "good")
    worst = next((v for v in verdicts if any(found.trust.verdict == v for _, found in weighed)), "bad")
    refused = len(result.entries) - len(weighed)
    return render(
        "compare.html.j2",
        title=f"Comparison: {result.robot.name}",
        headline=_headline(result),
        level="warning" if refused and worst == "good" else LEVELS[worst],
        word=f"{refused} refused" if refused else f"Trust: {worst}{'' if worst == 'good' else ' by some'}",
        why="One standard deviation in the table, two in the figures.",
        table=tables(result)[0],
        notes=reasons(result),
        plots=list(figures(result).values()),
    )


def _weighed(result: Comparison) -> Iterator[Weighed]:
    yield from ((each, each.weighing) for each in result.entries if each.weighing is not None)


def _quantity(weighed: Sequence[Weighed]) -> tuple[str, Array]:
    """What is compared, the payload where all have one, else the trunk; its mass and standard deviation, (entries, 2)
    [kg].
    """
    payloads = [found.payload for _, found in weighed if found.payload is not None]
    if len(payloads) == len(weighed):
        return "payload", np.array([[payload.mass, payload.mass_std] for payload in payloads])
    return "trunk", np.array([[found.mass, found.mass_std] for _, found in weighed])


def _headline(result: Comparison) -> str:
    """What each method says of one log, with its bar; of several logs, how many results there are."""
    weighed, logs = list(_weighed(result)), {each.log for each in result.entries}
    what = f"{len(weighed)} of {counted(len(result.entries), 'weighing')} of {result.robot.name} gave a result"
    if len(logs) > 1 or not weighed:
        return f"{what}."
    name, mass = _quantity(weighed)
    said, unknown = list[str](), list[str]()
    for (each, found), value in zip(weighed, mass.tolist(), strict=True):
        if found.determined()[name]:
            said.append(f"{with_std(*value)} kg by {each.label}")
        else:
            unknown.append(each.label)
    said += [f"not determined by {listed(unknown)}"] if unknown else []
    return f"{name.capitalize()} {listed(said)}{f'; {what}' * (len(weighed) < len(result.entries))}."


def _row(each: MethodResult) -> Row:
    found = each.weighing
    if found is None:
        return each.label, *[""] * 5, Cell("refused", good=False)
    payload = "" if found.payload is None else with_std(found.payload.mass, found.payload.mass_std)
    mass = with_std(found.mass, found.mass_std)
    return each.label, mass, *place(found.com, found.com_std), payload, found.trust.verdict


def _estimates(result: Comparison) -> Figure:
    weighed = list(_weighed(result))
    name, values = _quantity(weighed)
    one = len({each.log for each, _ in weighed}) == 1
    labels = tuple(each.label if one else f"{each.label}, {each.log}" for each, _ in weighed)
    mass, std = values.T
    look = {"marker": "dot", "size": 9.0, "x_range": (mass - 2.0 * std, mass + 2.0 * std)}
    mark = Series(mass, np.arange(float(len(mass))), "", "blue", 0.0, **look)  # type: ignore[arg-type]
    panel = Panel(Axis(f"{name} [kg]"), Axis(labels=labels), (mark,))
    return Figure(f"{name.capitalize()} by each method", ((panel,),), "With two standard deviations.")


def _curves(log: str, entries: Sequence[Weighed]) -> Figure:
    mass = [(found.timeline.mass, found.timeline.mass_std) for _, found in entries]
    panels = [_panel("trunk's mass [kg]", entries, mass)]
    payloads = [(each, found) for each, found in entries if found.timeline.payload is not None]
    if payloads:
        added = [np.asarray(found.timeline.payload).T for _, found in payloads]
        panels.append(_panel("payload [kg]", payloads, [(value, std) for value, std in added], entries))
    return stacked(f"Over time: {log}", panels, "With two standard deviations, as known at that time.", 300.0)


def _panel(
    title: str, shown: Sequence[Weighed], values: Sequence[tuple[Array, Array]], entries: Sequence[Weighed] = ()
) -> Panel:
    """A curve with its band for each of `shown`, in the colours they have among all entries."""
    marks, spans = list[Series](), []
    for (each, found), (value, std) in zip(shown, values, strict=True):
        colour = _COLOURS[[other for other, _ in entries or shown].index(each) % len(_COLOURS)]
        time = found.timeline.time - found.begin
        marks += [line(time, value, each.label, colour, width=1.8), band(time, value, std, colour, each.label)]
        spans += [span] if (span := room(value, std)) else []
    limits = (min(low for low, _ in spans), max(high for _, high in spans)) if spans else None
    return Panel(Axis("time [s]"), Axis(title, limits=limits), tuple(marks))
