"""Plots of a weighing, as plotly figures: the balance from above, mass, centre of mass and forces over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stadera.report.plots import COLOURS, add_band, short, styled
from stadera.types import Array
from stadera.weigh.result import Balance, Weighing

if TYPE_CHECKING:
    from stadera.weigh.truth import Truth

_BLUE, _ORANGE, _INK = COLOURS["identified"], COLOURS["prior_friction"], COLOURS["measured"]
_STEEL, _GREEN = COLOURS["prior"], COLOURS["truth"]
_BAND = "rgba(11,107,203,0.18)"
_LEGS = (_BLUE, _ORANGE, _GREEN, "#8a4fbf")
_AROUND = (0, 1, 3, 2)  # LF, RF, RH, LH: the feet in a row around the robot
_GAP = 0.35  # s between blocks, from which a line breaks
_MARGIN = 0.005  # m, around what is enlarged
_LARGEST = 46  # px, the marker of the most loaded foot


def balance_figure(result: Weighing, balance: Balance, truth: Truth | None = None) -> go.Figure:
    """Support polygon from above: feet with their forces, centre of pressure, centres of mass found and true.

    The right half enlarges the middle.
    """
    stance, centres = _stance(result, balance), _centres(result, balance, truth)
    figure = make_subplots(
        rows=1, cols=2, column_widths=[0.62, 0.38], horizontal_spacing=0.1, subplot_titles=("", "enlarged")
    )
    for trace in (*stance.data, *centres.data):
        figure.add_trace(trace, row=1, col=1)
    for trace in centres.data:
        figure.add_trace(trace, row=1, col=2)
        figure.data[-1].showlegend = False
    places = np.concatenate([np.column_stack([t.x, t.y]) for t in centres.data]).astype(float)
    middle, half = 0.5 * (places.max(axis=0) + places.min(axis=0)), 0.6 * np.ptp(places, axis=0).max() + _MARGIN
    figure.update_xaxes(title_text="forward [m]")
    figure.update_yaxes(title_text="left [m]")
    figure.update_yaxes(scaleanchor="x", scaleratio=1, row=1, col=1)
    figure.update_yaxes(scaleanchor="x2", scaleratio=1, range=[middle[1] - half, middle[1] + half], row=1, col=2)
    figure.update_xaxes(range=[middle[0] - half, middle[0] + half], row=1, col=2)
    figure = styled(figure, 560)
    figure.update_layout(margin_t=92)
    return figure


def _stance(result: Weighing, balance: Balance) -> go.Figure:
    """Feet, their forces and the polygon between them."""
    figure = go.Figure()
    feet = balance.level(balance.feet)
    standing = [k for k in _AROUND if balance.stance[k]]
    outline = feet[[*standing, standing[0]]]
    figure.add_scatter(
        x=outline[:, 0],
        y=outline[:, 1],
        mode="lines",
        fill="toself",
        fillcolor="rgba(154,164,178,0.15)",
        line={"color": _STEEL, "width": 1.5},
        name="support polygon",
        hoverinfo="skip",
    )
    names = [leg.name for leg in result.robot.legs]
    share = np.maximum(balance.force / balance.force.max(), 0.0)
    figure.add_scatter(
        x=feet[standing, 0],
        y=feet[standing, 1],
        mode="markers+text",
        marker={"size": _LARGEST * np.sqrt(share[standing]), "color": _STEEL, "opacity": 0.75},
        text=[f"{names[k]} {balance.force[k]:.0f} N" for k in standing],
        textposition=["top center" if feet[k, 1] > 0 else "bottom center" for k in standing],
        cliponaxis=False,
        name="foot, area by vertical force",
        hovertemplate="%{text}<br>x %{x:.3f} m, y %{y:.3f} m<extra></extra>",
    )
    return figure


def _centres(result: Weighing, balance: Balance, truth: Truth | None) -> go.Figure:
    """Centres of pressure and of mass."""
    figure = go.Figure()
    if np.isfinite(result.com[:2]).all():
        _add_uncertainty(figure, result, balance)
    _add_point(figure, balance.robot_com, "whole robot's centre of mass, found", "cross-thin", _ORANGE)
    _add_point(figure, balance.pressure, "centre of pressure", "circle-open", _INK)
    if truth is not None:
        last = truth.at(result.end)
        _add_point(figure, balance.level(np.array(last.com)), "trunk's centre of mass, truth", "x-thin", _GREEN)
    return figure


def mass_figure(result: Weighing, truth: Truth | None = None) -> go.Figure:
    """Mass over time with two standard deviations, the changes, and the truth."""
    figure, line = go.Figure(), result.timeline
    breaks = _breaks(line.time)
    _add_band(figure, line.time, line.mass, line.mass_std, breaks, "trunk with all on it", None)
    for change in result.changes:
        figure.add_vline(x=change.time, line={"color": _ORANGE, "dash": "dot", "width": 1.5})
    if truth is not None:
        times = [*(m.time for m in truth.moments), result.end]
        masses = [m.mass for m in truth.moments]
        figure.add_scatter(
            x=times,
            y=[*masses, masses[-1]],
            mode="lines",
            line={"color": _GREEN, "width": 1.5, "shape": "hv", "dash": "dash"},
            name="truth",
        )
    _shade_refused(figure, result)
    figure.update_xaxes(title_text="time [s]", range=[result.begin, result.end])
    figure.update_yaxes(title_text="trunk's mass [kg]")
    return styled(figure, 340)


def com_figure(result: Weighing, truth: Truth | None = None) -> go.Figure:
    """Centre of mass over time as known then, with two standard deviations, and the truth."""
    line = result.timeline
    seen = [k for k in range(3) if np.isfinite(line.com[:, k]).any()]
    figure = make_subplots(rows=max(len(seen), 1), cols=1, shared_xaxes=True, vertical_spacing=0.06)
    breaks = _breaks(line.time)
    for row, k in enumerate(seen, start=1):
        _add_band(figure, line.time, line.com[:, k], line.com_std[:, k], breaks, "found", row)
        if truth is not None:
            values = [m.com[k] for m in truth.moments]
            figure.add_scatter(
                x=[*(m.time for m in truth.moments), result.end],
                y=[*values, values[-1]],
                mode="lines",
                line={"color": _GREEN, "width": 1.5, "shape": "hv", "dash": "dash"},
                name="truth",
                legendgroup="truth",
                showlegend=row == 1,
                row=row,
                col=1,
            )
        figure.update_yaxes(title_text=f"com {'xyz'[k]} [m]", row=row, col=1)
    figure.update_xaxes(range=[result.begin, result.end])
    figure.update_xaxes(title_text="time [s]", row=max(len(seen), 1), col=1)
    return styled(figure, 130 + 190 * max(len(seen), 1))


def force_figure(result: Weighing, load: Array) -> go.Figure:
    """Vertical force (entries, 4) [N] of each foot over time, from joint torques."""
    figure, line = go.Figure(), result.timeline
    breaks = _breaks(line.time)
    for k, leg in enumerate(result.robot.legs):
        figure.add_scatter(
            x=short(_broken(line.time, breaks)),
            y=short(_broken(load[:, k], breaks)),
            mode="lines",
            line={"color": _LEGS[k], "width": 1.6},
            name=leg.name,
            hovertemplate="%{y:.1f} N<extra>" + leg.name + "</extra>",
        )
    figure.update_xaxes(title_text="time [s]", range=[result.begin, result.end])
    figure.update_yaxes(title_text="vertical force [N]", rangemode="tozero")
    _shade_refused(figure, result)
    figure.update_layout(hovermode="x unified")
    return styled(figure, 340)


def _add_point(figure: go.Figure, at: Array, name: str, symbol: str, colour: str) -> None:
    if np.isfinite(at).all():
        figure.add_scatter(
            x=[float(at[0])],
            y=[float(at[1])],
            mode="markers",
            marker={"symbol": symbol, "size": 12, "color": colour, "line": {"width": 2.2, "color": colour}},
            name=name,
            hovertemplate="x %{x:.4f} m, y %{y:.4f} m<extra>" + name + "</extra>",
        )


def _add_uncertainty(figure: go.Figure, result: Weighing, balance: Balance) -> None:
    """The trunk's centre of mass with the ellipse of two standard deviations."""
    at = balance.level(np.nan_to_num(result.com))
    turn = balance.to_level[:2]
    covariance = turn @ np.nan_to_num(result.trunk.covariance[1:, 1:]) @ turn.T
    sizes, axes = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    edge = at[:, None] + axes @ (2.0 * np.sqrt(np.maximum(sizes, 0.0))[:, None] * circle)
    figure.add_scatter(
        x=edge[0],
        y=edge[1],
        mode="lines",
        fill="toself",
        fillcolor=_BAND,
        line={"color": _BLUE, "width": 1},
        name="two standard deviations",
        hoverinfo="skip",
    )
    _add_point(figure, at, "trunk's centre of mass, found", "diamond-open", _BLUE)


def _add_band(
    figure: go.Figure, time: Array, value: Array, std: Array, breaks: list[int], name: str, row: int | None
) -> None:
    place = {} if row is None else {"row": row, "col": 1}
    first = row in (None, 1)
    x, y, s = (_broken(v, breaks) for v in (time, value, std))
    add_band(figure, x, y, s, fillcolor=_BAND, name="two standard deviations", showlegend=first, **place)
    figure.add_scatter(
        x=short(x),
        y=short(y),
        mode="lines+markers",
        marker={"size": 4},
        line={"color": _BLUE, "width": 1.8},
        name=name,
        legendgroup="value",
        showlegend=first,
        hovertemplate="%{y:.4g}<extra></extra>",
        **place,
    )


def _shade_refused(figure: go.Figure, result: Weighing) -> None:
    for refusal in result.refusals:
        figure.add_vrect(
            x0=refusal.begin, x1=refusal.end, fillcolor="rgba(211,154,0,0.12)", line_width=0, layer="below"
        )


def _breaks(time: Array) -> list[int]:
    return [int(k) + 1 for k in np.flatnonzero(np.diff(time) > _GAP)]


def _broken(values: Array, breaks: list[int]) -> Array:
    return np.insert(values, breaks, np.nan)
