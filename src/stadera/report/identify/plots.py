"""Plots of an identification, as plotly figures: torques, errors, their spread, and their RMSE a joint."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stadera.identify.result import LegIdentification, TorqueTrace
from stadera.report.identify.quantities import MODEL_NAMES
from stadera.report.plots import COLOURS, faint, short, styled, thinned
from stadera.types import Array

_SHADE = "rgba(11,107,203,0.06)"
_ROW_PX, _AROUND_PX = 190, 110


def torque_figure(leg: LegIdentification) -> go.Figure:
    """Measured torque of each joint over time, and what each model predicts."""
    traces = plotted_traces(leg.traces)
    figure = _joint_rows(leg, "torque [N·m]")
    for k in range(3):
        for model in ("prior", "prior_friction"):
            _add_line(figure, traces, k, model, [t.predicted.get(model) for t in traces], width=1.2)
        _add_line(figure, traces, k, "measured", [t.measured for t in traces], width=2.2)
        _add_line(figure, traces, k, "identified", [t.predicted.get("identified") for t in traces], width=1.4)
    return _over_time(figure, traces)


def error_figure(leg: LegIdentification) -> go.Figure:
    """Measured minus predicted torque of each joint over time."""
    traces = plotted_traces(leg.traces)
    figure = _joint_rows(leg, "error [N·m]")
    for k in range(3):
        for model in ("prior", "prior_friction", "identified"):
            errors = [t.measured - t.predicted[model] if model in t.predicted else None for t in traces]
            hidden = model == "prior" and any("prior_friction" in t.predicted for t in traces)
            _add_line(figure, traces, k, model, errors, width=1.3, hidden=hidden)
    return _over_time(figure, traces)


def spread_figure(leg: LegIdentification, part: str) -> go.Figure:
    """Histogram of the errors, joint by joint."""
    figure = make_subplots(rows=3, cols=1, subplot_titles=leg.leg.joints, vertical_spacing=0.13)
    for model, errors in _errors(leg, part).items():
        for k in range(3):
            figure.add_scatter(
                **_histogram(errors[:, k], _edges(leg, part)[k]),
                line={"shape": "hvh", "color": COLOURS[model], "width": 1.6},
                fill="tozeroy",
                fillcolor=faint(COLOURS[model]),
                name=MODEL_NAMES[model],
                legendgroup=model,
                showlegend=k == 0,
                row=k + 1,
                col=1,
            )
    figure.update_yaxes(title_text="samples [%]")
    figure.update_xaxes(title_text="error, measured − predicted [N·m]", row=3, col=1)
    return styled(figure, _AROUND_PX + 3 * 150)


def _errors(leg: LegIdentification, part: str) -> dict[str, Array]:
    """By model, measured minus predicted torque of a part, (samples, joints)."""
    chosen = [trace for trace in leg.traces if trace.part == part]
    return {
        model: np.concatenate([t.measured - t.predicted[model] for t in chosen if model in t.predicted])
        for model in ("prior_friction", "identified")
        if any(model in t.predicted for t in chosen)
    }


def _edges(leg: LegIdentification, part: str) -> list[Array]:
    """The histogram's bins, by joint: to the largest 99.5 % quantile of the models."""
    largest = [np.quantile(np.abs(errors), 0.995, axis=0) for errors in _errors(leg, part).values()]
    return [np.linspace(-(edge or 1.0), edge or 1.0, 61) for edge in np.max(largest, axis=0).tolist()]


def _histogram(values: Array, edges: Array) -> dict[str, Array]:
    share = 100.0 * np.histogram(values, edges)[0] / len(values)
    return {"x": short(0.5 * (edges[1:] + edges[:-1])), "y": short(share)}


def rmse_figure(legs: Sequence[LegIdentification], part: str) -> go.Figure:
    """RMSE of each joint under each model, as bars."""
    figure = go.Figure()
    joints = [joint for leg in legs for joint in leg.leg.joints]
    for model in ("identified", "prior_friction", "prior"):
        errors = {j: e for leg in legs for j, e in leg.rmse.get(part, {}).get(model, {}).items()}
        if errors:
            figure.add_bar(
                y=joints,
                x=[errors.get(joint) for joint in joints],
                orientation="h",
                name=MODEL_NAMES[model],
                marker={"color": COLOURS[model], "line": {"width": 0}},
            )
    figure.update_layout(barmode="group", bargap=0.3, bargroupgap=0.05)
    figure.update_yaxes(autorange="reversed", automargin=True)
    figure.update_xaxes(title_text=f"torque RMSE on {part} [N·m]", rangemode="tozero")
    return styled(figure, _AROUND_PX + 36 * len(joints))


def plotted_traces(traces: Sequence[TorqueTrace]) -> list[TorqueTrace]:
    """The traces that share one time axis: all, or the validation alone where their times overlap."""
    filled = sorted((t for t in traces if len(t.time)), key=lambda t: float(t.time[0]))
    overlap = any(a.time[-1] >= b.time[0] for a, b in pairwise(filled))
    if overlap and any(t.part == "validation" for t in filled):
        return [t for t in filled if t.part == "validation"]
    return filled


def _joint_rows(leg: LegIdentification, quantity: str) -> go.Figure:
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, subplot_titles=leg.leg.joints, vertical_spacing=0.07)
    figure.update_yaxes(title_text=quantity)
    return figure


def _add_line(
    figure: go.Figure,
    traces: Sequence[TorqueTrace],
    joint: int,
    name: str,
    values: Sequence[Array | None],
    *,
    width: float,
    hidden: bool = False,
) -> None:
    drawn = [thinned(t.time, v[:, joint]) for t, v in zip(traces, values, strict=True) if v is not None]
    if not drawn:
        return
    figure.add_scatter(
        x=short(np.concatenate([x for x, _ in drawn])),
        y=short(np.concatenate([y for _, y in drawn])),
        mode="lines",
        line={"color": COLOURS[name], "width": width},
        name=MODEL_NAMES.get(name, name),
        legendgroup=name,
        showlegend=joint == 0,
        visible="legendonly" if hidden else True,
        hovertemplate="%{y:.3g} N·m<extra>" + MODEL_NAMES.get(name, name) + "</extra>",
        row=joint + 1,
        col=1,
    )


def _over_time(figure: go.Figure, traces: Sequence[TorqueTrace]) -> go.Figure:
    for trace in traces:
        if trace.part == "validation" and len(traces) > 1:
            figure.add_vrect(
                x0=float(trace.time[0]), x1=float(trace.time[-1]), fillcolor=_SHADE, line_width=0, layer="below"
            )
    figure.update_xaxes(title_text="time [s]", row=3, col=1)
    figure.update_layout(hovermode="x unified")
    return styled(figure, _AROUND_PX + 3 * _ROW_PX)
