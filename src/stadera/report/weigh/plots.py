"""Figures of a weighing: where the load is; payload, mass and centre of mass over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stadera.report.figures import Axis, Figure, Guide, Panel, Series, band, line, stacked
from stadera.report.weigh.place import place_figure
from stadera.types import Array
from stadera.weigh.result import Weighing

if TYPE_CHECKING:
    from stadera.lab.truth import Truth


def figures(result: Weighing, truth: Truth | None = None) -> dict[str, Figure]:
    """All figures by name, the most informative first."""
    found = {
        "payload": payload_figure(result, truth),
        "mass": mass_figure(result, truth),
        "balance": place_figure(result, truth),
        "convergence": com_figure(result, truth),
    }
    return {name: figure for name, figure in found.items() if figure is not None and not figure.is_empty}


def payload_figure(result: Weighing, truth: Truth | None = None) -> Figure | None:
    """The payload's mass since the tare with two standard deviations; None if it was not tracked."""
    if (found := result.timeline.payload) is None:
        return None
    true = None if truth is None else [m.payload_mass or 0.0 for m in truth.moments]
    panel = _panel(result, "payload [kg]", "payload since the tare", found[:, 0], found[:, 1], truth, true)
    return Figure("Payload over time", ((panel,),), "As known at that time.", 300.0)


def mass_figure(result: Weighing, truth: Truth | None = None) -> Figure:
    """Mass of the trunk over time with two standard deviations, the changes, and the truth."""
    line_, true = result.timeline, None if truth is None else [m.mass for m in truth.moments]
    panel = _panel(result, "trunk's mass [kg]", "trunk with all on it", line_.mass, line_.mass_std, truth, true)
    return Figure("Mass over time", ((panel,),), "As known at that time.", 300.0)


def com_figure(result: Weighing, truth: Truth | None = None) -> Figure | None:
    """Centre of mass over time as estimated then, with two standard deviations, and the truth; None if not observed."""
    com, std, panels = result.timeline.com, result.timeline.com_std, []
    for k in range(3):
        if np.isfinite(com[:, k]).any():
            true = None if truth is None else [m.com[k] for m in truth.moments]
            panels.append(_panel(result, f"com {'xyz'[k]} [m]", "found", com[:, k], std[:, k], truth, true))
    note = "As known at that time; a gap where it was not."
    return stacked("Centre of mass over time", panels, note) if panels else None


def _panel(
    result: Weighing, quantity: str, name: str, values: Array, std: Array, truth: Truth | None, true: list[float] | None
) -> Panel:
    """A quantity (k,) over the timeline with two standard deviations, and its true values at the truth's moments."""
    time = result.timeline.time
    marks = [band(time, values, std), line(time, values, name, width=1.8)]
    if truth is not None and true is not None:
        times = np.array([*(m.time for m in truth.moments), result.end])
        marks.append(Series(times, np.array([*true, true[-1]]), "truth", "green", 1.5, dashed=True, stairs="hold"))
    return Panel(_time(result), Axis(quantity, limits=room(values, std)), tuple(marks), _guides(result))


def room(values: Array, std: Array) -> tuple[float, float] | None:
    """Range of a plot over time that shows all values (k,) and the last error bar [the same unit]. Wider bars
    before it, of the first rows after a change, are cut off.
    """
    known = np.isfinite(values) & np.isfinite(std)
    if not known.any():
        return None
    low, high = float(values[known].min()), float(values[known].max())
    room = max(3.0 * float(std[known][-1]), 0.15 * (high - low)) or 1.0
    return low - room, high + room


def _time(result: Weighing) -> Axis:
    return Axis("time [s]", limits=(result.begin, result.end))


def _guides(result: Weighing) -> tuple[Guide, ...]:
    refused = (Guide(r.begin, r.end, colour="amber", name="not used") for r in result.refusals)
    return (*refused, *(Guide(change.time, name="change of the load") for change in result.changes))
