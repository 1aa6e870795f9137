"""Figures of experiments, from plain values to plotly."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stadera.lab.experiments.result import FigureData, Line, Panel
from stadera.report.plots import COLOURS, short, styled, thinned

_AROUND_PX, _PANEL_PX, _ALONE_PX, _LABELS_PX = 110, 175, 320, 110
_WIDTHS = {"measured": 2.4, "identified": 1.4}


def panels_figure(data: FigureData) -> go.Figure:
    """Panels one below the other, one legend for all."""
    count = len(data.panels)
    figure = make_subplots(
        rows=count,
        cols=1,
        subplot_titles=[panel.title for panel in data.panels],
        vertical_spacing=0.3 / (count + 1),
    )
    named: set[str] = set()
    for k, panel in enumerate(data.panels, start=1):
        for line in panel.lines:
            _add(figure, line, k, first=line.role not in named)
            named.add(line.role)
        _axes(figure, panel, k, last=k == count)
    labels = _LABELS_PX if any(panel.labels for panel in data.panels) else 0
    return styled(figure, _AROUND_PX + labels + (_ALONE_PX if count == 1 else count * _PANEL_PX))


def _add(figure: go.Figure, line: Line, row: int, first: bool) -> None:
    x, y = thinned(line.x, line.y) if line.kind == "line" else (line.x, line.y)
    colour = COLOURS[line.role]
    bars = {} if line.std is None else {"error_y": {"type": "data", "array": short(line.std), "color": colour}}
    figure.add_scatter(
        x=short(x),
        y=short(y),
        mode="lines" if line.kind == "line" else "markers",
        line={"color": colour, "width": _WIDTHS.get(line.role, 1.2)},
        marker={"color": colour, "size": 9},
        name=line.name,
        legendgroup=line.role,
        showlegend=first,
        row=row,
        col=1,
        **bars,
    )


def _axes(figure: go.Figure, panel: Panel, row: int, last: bool) -> None:
    scale = "log" if panel.log_y else "linear"
    figure.update_yaxes(title_text=panel.y_title, type=scale, row=row, col=1)
    if panel.labels:
        figure.update_xaxes(
            tickvals=np.arange(len(panel.labels)), ticktext=list(panel.labels), tickangle=-35, row=row, col=1
        )
    if last:
        figure.update_xaxes(title_text=panel.x_title, row=row, col=1)
