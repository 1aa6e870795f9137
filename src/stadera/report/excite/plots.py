"""Plots of an excitation, as plotly figures: its expected information, and the motion itself."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stadera.excite.result import Excitation
from stadera.report.plots import COLOURS, short, styled

SHOWN = 30.0  # s of the motion in the plot
_BLUE, _STEEL, _RED = COLOURS["identified"], COLOURS["prior"], COLOURS["limit"]
_RATE = 100.0  # Hz in the plot
_LONGEST = 60  # characters of a combination's name next to a plot


def std_figure(result: Excitation) -> go.Figure:
    """Standard deviation of each identifiable combination as a share of the prior's: the motion's and the draws'."""
    names = [_cut(str(combination)) for combination in result.combinations]
    figure = go.Figure()
    if result.draws:
        spread = 100.0 * np.array([draw.std for draw in result.draws])
        median = np.median(spread, axis=0)
        reach = {"array": spread.max(axis=0) - median, "arrayminus": median - spread.min(axis=0), "thickness": 1.5}
        figure.add_scatter(
            x=median,
            y=names,
            error_x={"type": "data", "symmetric": False, "width": 4, "color": _STEEL, **reach},
            mode="markers",
            marker={"color": _STEEL, "size": 9, "symbol": "diamond"},
            name=f"random draws, median and range of {len(result.draws)}",
            hovertemplate="%{x:.3g} %<extra>random</extra>",
        )
    figure.add_scatter(
        x=100.0 * result.chosen.std,
        y=names,
        mode="markers",
        marker={"color": _BLUE, "size": 10},
        name="optimised" if result.draws else "random draw",
        hovertemplate="%{x:.3g} %<extra>this motion</extra>",
    )
    figure.update_xaxes(type="log", title_text="standard deviation, share of the prior's [%]", dtick=1)
    figure.update_yaxes(autorange="reversed", automargin=True, tickfont_size=11)
    figure.add_vline(x=100.0, line={"color": _RED, "dash": "dot", "width": 1})
    return styled(figure, 120 + 24 * len(names))


def motion_figure(result: Excitation) -> go.Figure:
    """Position, velocity and predicted torque of the three joints over the first half minute, with their bounds."""
    bounds = result.experiment.bounds
    sampled = result.chosen.motion.sample(_RATE)
    until = sampled.time <= SHOWN
    torque = bounds.torque(sampled.motion)
    rows = (
        ("position [rad]", sampled.position, bounds.lower, bounds.upper),
        ("velocity [rad/s]", sampled.velocity, -bounds.velocity, bounds.velocity),
        ("torque [N·m]", torque, -bounds.effort, bounds.effort),
    )
    figure = make_subplots(rows=3, cols=3, shared_xaxes=True, column_titles=list(bounds.joints), vertical_spacing=0.06)
    for r, (label, values, low, high) in enumerate(rows, start=1):
        for k in range(3):
            figure.add_scatter(
                x=short(sampled.time[until]),
                y=short(values[until, k]),
                mode="lines",
                line={"color": _BLUE, "width": 1.3},
                showlegend=False,
                hovertemplate=f"%{{y:.3g}} {label.split('[')[1][:-1]}<extra></extra>",
                row=r,
                col=k + 1,
            )
            for bound in (low[k], high[k]):
                if np.isfinite(bound) and (r == 1 or abs(bound) < 3.0 * np.abs(values[:, k]).max()):
                    figure.add_hline(y=bound, line={"color": _RED, "dash": "dot", "width": 1}, row=r, col=k + 1)
        figure.update_yaxes(title_text=label, row=r, col=1)
    figure.update_xaxes(title_text="time [s]", row=3)
    return styled(figure, 620)


def _cut(name: str) -> str:
    return name if len(name) <= _LONGEST else name[: _LONGEST - 1] + "…"
