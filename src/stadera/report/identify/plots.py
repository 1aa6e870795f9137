"""Figures of an identification: torques, errors, their spread, and their RMSE for each joint."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from stadera.identify.result import Identification, LegIdentification, TorqueTrace
from stadera.report.figures import Axis, Bars, Figure, Guide, Panel, Series, line, stacked
from stadera.report.identify.remarks import evaluated_part
from stadera.report.identify.tables import MODEL_NAMES, link_table
from stadera.report.look import ROLES
from stadera.report.table import TableData
from stadera.types import Array


def figures(result: Identification) -> dict[str, Figure | TableData]:
    """All figures by name, the most informative first; names of a leg's figures end in the leg's name."""
    part, found = evaluated_part(result), dict[str, Figure | TableData]()
    several = len(result.legs) > 1
    for leg in result.legs:
        end = f"-{leg.leg.name}" if several else ""
        found |= {f"torques{end}": torque_figure(leg), f"observability{end}": link_table(leg)}
        found |= {f"errors{end}": error_figure(leg), f"spread{end}": spread_figure(leg, part)}
    found["rmse"] = rmse_figure(result.legs, part)
    return {name: figure for name, figure in found.items() if isinstance(figure, TableData) or not figure.is_empty}


def torque_figure(leg: LegIdentification) -> Figure:
    """Measured torque of each joint over time, and each model's prediction."""
    traces, panels = plotted_traces(leg.traces), []
    for k, joint in enumerate(leg.leg.joints):
        marks = [_line(traces, model, [_column(t.predicted.get(model), k) for t in traces]) for model in _CAD]
        marks.append(_line(traces, "measured", [t.measured[:, k] for t in traces]))
        marks.append(_line(traces, "identified", [_column(t.predicted.get("identified"), k) for t in traces]))
        panels.append(_over_time(joint, "torque [N·m]", marks, traces))
    note = "Measured and predicted; validation is shaded. Drag to zoom, double-click to go back."
    return stacked(f"Torques of {leg.leg.name}", panels, note)


def error_figure(leg: LegIdentification) -> Figure:
    """Measured minus predicted torque of each joint over time."""
    traces, panels = plotted_traces(leg.traces), []
    for k, joint in enumerate(leg.leg.joints):
        marks = []
        for model in (*_CAD, "identified"):
            errors = [t.measured[:, k] - t.predicted[model][:, k] if model in t.predicted else None for t in traces]
            hidden = model == "prior" and any("prior_friction" in t.predicted for t in traces)
            marks.append(_line(traces, model, errors, hidden=hidden))
        panels.append(_over_time(joint, "error [N·m]", marks, traces))
    note = "Measured minus predicted. CAD alone is hidden: click it in the legend."
    return stacked(f"Torque errors of {leg.leg.name}", panels, note)


def spread_figure(leg: LegIdentification, part: str) -> Figure:
    """Histogram of the errors, joint by joint."""
    chosen = [trace for trace in leg.traces if trace.part == part]
    errors = {
        model: np.concatenate([t.measured - t.predicted[model] for t in chosen if model in t.predicted])
        for model in ("prior_friction", "identified")
        if any(model in t.predicted for t in chosen)
    }
    rows = []
    for k, joint in enumerate(leg.leg.joints):
        edge = max((float(np.quantile(np.abs(e[:, k]), 0.995)) for e in errors.values()), default=0.0) or 1.0
        marks = tuple(_histogram(values[:, k], edge, model) for model, values in errors.items())
        rows.append(Panel(Axis("error [N·m]"), Axis("samples [%]", zero=True), marks, title=joint))
    return Figure(f"Spread of the torque errors of {leg.leg.name}", (tuple(rows),), f"On {part}.", 240.0)


def _histogram(values: Array, edge: float, model: str) -> Series:
    edges = np.linspace(-edge, edge, 61)
    share = 100.0 * np.histogram(values, edges)[0] / len(values)
    middle = 0.5 * (edges[1:] + edges[:-1])
    return Series(middle, share, MODEL_NAMES[model], ROLES[model], 1.5, stairs="bins", fill="zero")


def rmse_figure(legs: Sequence[LegIdentification], part: str) -> Figure:
    """RMSE of each joint under each model, as bars."""
    joints, marks = tuple(joint for leg in legs for joint in leg.leg.joints), []
    for model in ("identified", "prior_friction", "prior"):
        errors = {j: e for leg in legs for j, e in leg.rmse.get(part, {}).get(model, {}).items()}
        if errors:
            values = np.array([errors.get(joint, np.nan) for joint in joints])
            marks.append(Bars(values, MODEL_NAMES[model], ROLES[model]))
    panel = Panel(Axis(f"torque RMSE on {part} [N·m]", zero=True), Axis(labels=joints), tuple(marks))
    return Figure("Torque RMSE of each joint under each model", ((panel,),))


def plotted_traces(traces: Sequence[TorqueTrace]) -> list[TorqueTrace]:
    """Traces that share one time axis: all, or only those of the validation if their times overlap."""
    filled = sorted((t for t in traces if len(t.time)), key=lambda t: float(t.time[0]))
    overlap = any(a.time[-1] >= b.time[0] for a, b in pairwise(filled))
    if overlap and any(t.part == "validation" for t in filled):
        return [t for t in filled if t.part == "validation"]
    return filled


_CAD = ("prior", "prior_friction")
_WIDTHS = {"measured": 2.2, "identified": 1.4}


def _column(values: Array | None, k: int) -> Array | None:
    return None if values is None else values[:, k]


def _line(traces: Sequence[TorqueTrace], role: str, values: Sequence[Array | None], hidden: bool = False) -> Series:
    known = [(t.time, v) for t, v in zip(traces, values, strict=True) if v is not None]
    time, torque = (np.concatenate([pair[k] for pair in known]) if known else np.zeros(0) for k in (0, 1))
    return line(time, torque, MODEL_NAMES.get(role, role), ROLES[role], width=_WIDTHS.get(role, 1.2), hidden=hidden)


def _over_time(joint: str, quantity: str, marks: list[Series], traces: Sequence[TorqueTrace]) -> Panel:
    shaded = [t for t in traces if t.part == "validation" and len(traces) > 1]
    guides = tuple(Guide(float(t.time[0]), float(t.time[-1]), colour="blue") for t in shaded)
    return Panel(Axis("time [s]"), Axis(quantity), tuple(m for m in marks if len(m.x)), guides, joint)
