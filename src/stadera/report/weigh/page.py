"""Pages of a weighing, and of several methods on several logs: answer and trust, next steps, evidence, and method."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import degrees
from typing import TYPE_CHECKING

import numpy as np

from stadera.report.figures import Axis, Figure, Panel, Series, band, line, stacked
from stadera.report.numbers import counted, listed, number, with_std
from stadera.report.page import render
from stadera.report.table import SHOWN, Cell, Row, TableData
from stadera.report.trust import LEVELS, fit_figure
from stadera.report.weigh import plots, tables
from stadera.report.weigh.plots import room
from stadera.report.weigh.tables import place
from stadera.trunk.registry import method_of
from stadera.types import Array
from stadera.weigh.compare import Comparison, MethodResult
from stadera.weigh.result import Weighing

if TYPE_CHECKING:
    from stadera.lab.truth import Truth


def next_steps(result: Weighing) -> Iterator[str]:
    """Yields next steps for this result, the most urgent first: sentences, with commands between backquotes."""
    command = f"stadera weigh LOG --robot {result.robot.name}"
    first = next((change.time for change in result.changes), np.nan)
    tare = f"{result.begin + 0.5:.1f}:{first - 0.2:.1f}" if first - result.begin > 1.0 else "T0:T1"
    if not result.is_trusted:
        yield "Do not use these figures: the model does not explain the log, and the likeliest cause is named above."
        yield (
            f"Check the log with `stadera inspect LOG --robot {result.robot.name}`: reversed torques, swapped joints, "
            "another IMU frame. Then weigh it again."
        )
        return
    yield from map(tables.step_text, result.next)
    if result.trust.verdict == "doubtful":
        yield (
            "Use the error bars as they are, for they are widened to the fit. Friction and rotor inertia from "
            "`stadera identify` make them narrower: `--legs legs.json`."
        )
    if result.payload is None:
        yield (
            f"For the payload alone, give a time or a log without it: `{command} --tare {tare}`. Errors that both have "
            "in common cancel."
        )
    if (hidden := _hidden(result)) is not None:
        yield hidden
    if not result.determined()["trunk" if result.payload is None else "payload"]:
        return
    if result.payload is None or not result.payload.at:
        yield f"Write it into the model file: `{command} --export weighed.urdf`."
    else:
        link = result.payload.at
        yield f"Add it to link {link} of the controller's model; programs read it from `{command} --json F.json`."


def _hidden(result: Weighing) -> str | None:
    """How to observe the height of the centre of mass; None if it is known."""
    std = result.com_std if result.payload is None else result.payload.com_std
    if not np.isnan(std[2]):
        return None
    if result.torque_lag is None:
        return "A level robot at rest does not show how high a centre of mass is: hold a second pose, pitched by 10°."
    return "The height of the centre of mass was not observed: let the trunk pitch and roll, on the spot will do."


_VERTICAL = {"imu": "by the IMU", "forces": "by the direction of the feet's forces, for the log has no IMU"}


def weighing_html(result: Weighing, truth: Truth | None = None) -> str:
    """The complete, self-contained page."""
    in_motion, drawn = result.torque_lag is not None, plots.figures(result, truth)
    return render(
        "weigh.html.j2",
        title=f"Weighing{' in motion' if in_motion else ''}: {result.robot.name}",
        level=LEVELS[result.trust.verdict],
        headline=f"{tables.headline(result)}.",
        word=f"Trust: {result.trust.verdict}",
        why=tables.may_be_used(result),
        summary={"Where": tables.where(result), "How sure": tables.how_sure(result)},
        robot=drawn.pop("balance", None),
        first=replace(drawn.pop(next(iter(drawn))), width=560.0),
        next=tuple(next_steps(result)),
        bodies=tables.bodies_table(result, truth),
        inertia=tables.inertia_table(result),
        missing=tables.inertia_missing(result),
        plots=list(drawn.values()),
        lists=list(_lists(result)),
        facts=_facts(result),
        notes=result.notes,
    )


def _lists(result: Weighing) -> Iterator[tuple[object, int]]:
    if result.changes:
        yield tables.changes_table(result, SHOWN.rows), len(result.changes) - SHOWN.rows
    if (drives := tables.drives_table(result)) is not None:
        yield drives, 0
    if result.refusals:
        yield tables.refusals_table(result, SHOWN.rows), len(result.refusals) - SHOWN.rows


def _facts(result: Weighing) -> dict[str, str]:
    facts = {
        "Robot": f"{result.robot.name}, {number(result.robot.mass)} kg by its model",
        "Log": result.source,
        "Time": f"{result.begin:.2f} to {result.end:.2f} s, {result.refused:.1f} s of it not used",
        "As known at": f"{result.time:.2f} s",
        "Method": f"{result.method}: {method_of(result.method).summary}",
        "State": result.status,
        "Misfit": fit_figure(result.trust),
    }
    facts |= tables.processing(result)
    if (vertical := result.vertical) is not None:
        facts["Vertical"] = f"{_VERTICAL[vertical.source]}, ±{degrees(vertical.tilt_std):.2g}°"
    return facts


_COMPARED = ("method", "trunk [kg]", "com x [m]", "com y [m]", "com z [m]", "payload [kg]", "trust")
_COLOURS = ("blue", "orange", "green", "purple", "steel", "ink")

Weighed = tuple[MethodResult, Weighing]
"""An entry that has a result, and that result."""


def comparison_table(result: Comparison) -> TableData:
    """One row for each method, under the name of each log."""
    rows: dict[str, list[Row]] = defaultdict(list)
    for each in result.entries:
        rows[each.log].append(_row(each))
    note = "± one standard deviation; bars of different methods contain different errors."
    return TableData.of(f"Weighings of {result.robot.name}", _COMPARED, rows, note, "lrrrrrl")


def reasons(result: Comparison) -> tuple[str, ...]:
    """Why methods refused logs, or are not sure of them, one sentence each."""
    found = []
    for each in result.entries:
        said = (each.refusal,) if each.weighing is None else each.weighing.trust.reasons[:1]
        found += [f"{each.label} on {each.log}: {reason}" for reason in said]
    return tuple(found)


def comparison_figures(result: Comparison) -> dict[str, Figure]:
    """All results side by side, "estimates"; then mass and payload over time by each method, a figure for each log, by
    its name.
    """
    by_log: dict[str, list[Weighed]] = defaultdict(list)
    for each in _weighed(result):
        by_log[each[0].log].append(each)
    curves = {log: _curves(log, entries) for log, entries in by_log.items()}
    return {"estimates": _estimates(result)} | curves if curves else {}


def comparison_html(result: Comparison) -> str:
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
        table=comparison_table(result),
        notes=reasons(result),
        plots=list(comparison_figures(result).values()),
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
    """How far the results are apart on one log; of several logs, how many there are."""
    weighed, logs = list(_weighed(result)), {each.log for each in result.entries}
    what = f"{len(weighed)} of {counted(len(result.entries), 'weighing')} of {result.robot.name} gave a result"
    if len(logs) > 1 or not weighed:
        return f"{what}."
    name, mass = _quantity(weighed)
    if len(weighed) == 1:
        return f"{name.capitalize()} {with_std(*mass[0].tolist())} kg by {weighed[0][0].label}; {what}."
    low, high = (number(float(end), 3) for end in (mass[:, 0].min(), mass[:, 0].max()))
    methods = listed([each.label for each, _ in weighed])
    between = f"{low} kg" if low == high else f"between {low} and {high} kg"
    return f"{name.capitalize()} {between} by {methods}."


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
