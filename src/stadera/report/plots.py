"""What plots have in common: colours, the look, thinning and bands."""

from __future__ import annotations

from typing import Any

import numpy as np
import plotly.graph_objects as go

from stadera.types import Array

COLOURS: dict[str, str] = {
    "measured": "#20262e",
    "identified": "#0b6bcb",
    "prior_friction": "#d9822b",
    "prior": "#9aa4b2",
    "truth": "#1a7f43",
    "limit": "#b3261e",
}
_INK, _GRID = "#3a434f", "#e6e9ee"
_MOST_SAMPLES = 1000  # of one trace in a plot: about one a pixel
_GAP = 4.0  # a step of more than this many usual ones is drawn as a break


def styled(figure: go.Figure, height: int) -> go.Figure:
    """The figure with the look that all plots of a page share."""
    axis: dict[str, Any] = {"gridcolor": _GRID, "zerolinecolor": "#cbd2db", "linecolor": "#cbd2db", "title_standoff": 6}
    figure.update_xaxes(**axis)
    figure.update_yaxes(**axis)
    figure.update_layout(
        height=height,
        margin={"l": 60, "r": 16, "t": 56, "b": 48},
        font={"family": "system-ui, 'Segoe UI', Helvetica, Arial, sans-serif", "size": 12, "color": _INK},
        paper_bgcolor="#ffffff",
        plot_bgcolor="#ffffff",
        legend={"orientation": "h", "x": 0, "xanchor": "left", "y": 1, "yref": "container", "yanchor": "top"},
        template="none",
    )
    figure.update_annotations(font_size=12.5, font_color=_INK)
    return figure


def thinned(time: Array, values: Array) -> tuple[Array, Array]:
    """At most _MOST_SAMPLES of them, with a NaN, which draws as a break, where time jumps."""
    every = max(1, -(-len(time) // _MOST_SAMPLES))
    time, values = time[::every], values[::every]
    steps = np.diff(time)
    jumps = np.flatnonzero(steps > _GAP * np.median(steps)) + 1 if len(steps) else np.array([], dtype=int)
    end = len(time)
    return np.insert(time, [*jumps, end], time[[*(jumps - 1), end - 1]]), np.insert(values, [*jumps, end], np.nan)


def short(values: Array) -> Array:
    """In single precision: a plot needs no more, and the page is half as large."""
    return values.astype(np.float32)  # type: ignore[return-value]


def outlines(x: Array, high: Array, low: Array) -> tuple[Array, Array]:
    """Outlines of a band over x (k,), one for each stretch in which it is known, NaN between them."""
    known = np.isfinite(high) & np.isfinite(low)
    starts = np.flatnonzero(known & ~np.concatenate([[False], known[:-1]]))
    stops = np.flatnonzero(known & ~np.concatenate([known[1:], [False]])) + 1
    gap = np.array([np.nan])
    xs: list[Array] = []
    ys: list[Array] = []
    for a, b in zip(starts, stops, strict=True):
        xs += [x[a:b], x[a:b][::-1], gap]
        ys += [high[a:b], low[a:b][::-1], gap]
    return (np.concatenate(xs), np.concatenate(ys)) if xs else (np.zeros(0), np.zeros(0))


def add_band(figure: go.Figure, x: Array, value: Array, std: Array, **look: Any) -> None:
    """A band of two standard deviations around a value over x (k,), interrupted where either is not known."""
    edge_x, edge_y = outlines(x, value + 2.0 * std, value - 2.0 * std)
    figure.add_scatter(
        x=short(edge_x),
        y=short(edge_y),
        mode="lines",
        line={"width": 0},
        fill="toself",
        legendgroup="band",
        hoverinfo="skip",
        **look,
    )


def faint(colour: str) -> str:
    """The colour as a tint for areas."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.12)"
