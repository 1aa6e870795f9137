"""Draws figures on pages with Plotly, which a page contains: `plots.js` reads the JSON made here.

Colours stay names, `var(--blue)`: the script inserts the page's own, light or dark. Curves over the same x share it.
There are two layouts of the same traces, for a desk and for a phone, which has all panels in one column. What all
figures have in common (fonts, grid, legend) is in the script.
"""

import base64
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from html import escape
from typing import Any

import numpy as np
from markupsafe import Markup

from stadera.report.figures.model import Axis, Bars, Figure, Guide, Panel, Series
from stadera.types import Array

_SHAPE = {"": "linear", "hold": "hv", "bins": "hvh"}
_FILL = {"": None, "self": "toself", "zero": "tozeroy"}
_SYMBOLS = {
    "dot": "circle",
    "ring": "circle-open",
    "diamond": "diamond-open",
    "plus": "cross-thin-open",
    "cross": "x-thin-open",
}
_SHADE = "1f"  # opacity, two hexadecimal digits after a colour


@dataclass(frozen=True)
class Room:
    """Room for a figure on a page [px]."""

    width: float = 1120.0  # of the page's column
    columns: int | None = None  # panels next to each other, None for as the figure has them
    left: float = 58.0  # for the ticks of a quantity
    above: float = 26.0  # a panel, with its title
    below: float = 22.0  # a panel, for ticks
    title: float = 22.0  # below that, for the axis' title
    legend: float = 22.0  # one line of the legend
    entry: float = 190.0  # of the legend, wide
    category: float = 26.0  # high
    letters: int = 60  # of a category's name, at most

    def legend_height(self, figure: Figure) -> float:
        """Height of the legend, which breaks into lines."""
        return self.legend * -(-len(figure.entries) // max(int(self.width / self.entry), 1)) + 8.0

    def panel_height(self, panel: Panel, figure: Figure) -> float:
        """Height inside the axes; panels of equal scales are as high as their limits need."""
        if panel.y.labels:
            return self.category * len(panel.y.labels)
        if not panel.equal:
            return figure.row_height - self.above - self.below
        if panel.x.limits is None or panel.y.limits is None:
            return min(0.9 * self.width, 400.0)
        abreast = 1 if self.columns else max(map(len, figure.rows))
        width = self.width / abreast - self.left - 12.0
        return min(width * (panel.y.limits[1] - panel.y.limits[0]) / (panel.x.limits[1] - panel.x.limits[0]), 520.0)


DESK = Room()
PHONE = Room(width=340.0, columns=1, letters=16)


def height(figure: Figure, room: Room | None = None) -> int:
    """Height of the drawn figure [px], None for a desk."""
    room = room or replace(DESK, width=figure.width)
    return round(room.legend_height(figure) + _places(figure, room)[1])


def data(figure: Figure) -> Markup:
    """JSON that cannot terminate its script element."""
    shared: dict[str, int] = {}
    traces = [trace for k, panel in enumerate(figure.panels, start=1) for trace in _traces(panel, k, shared)]
    named: set[str] = set()
    for trace in traces:
        trace["showlegend"] = bool(trace["name"]) and trace["name"] not in named
        named.add(trace["name"])
    made = {"data": traces, "desk": _layout(figure, replace(DESK, width=figure.width)), "shared": list(shared)}
    if (phone := _layout(figure, PHONE)) != made["desk"]:
        made["phone"] = phone
    return Markup(json.dumps(made, separators=(",", ":"), ensure_ascii=False, allow_nan=False).replace("<", "\\u003c"))


# -- traces -----------------------------------------------------------------------------------------------------------
def _traces(panel: Panel, k: int, shared: dict[str, int]) -> Iterator[dict[str, Any]]:
    bars = [mark for mark in panel.marks if isinstance(mark, Bars)]
    thick = 0.75 / max(len(bars), 1)
    for mark in panel.marks:
        if isinstance(mark, Bars):
            offset = thick * ([bar is mark for bar in bars].index(True) - 0.5 * len(bars))
            trace = {
                "type": "bar",
                "orientation": "h",
                "x": _packed(mark.values),
                "y": list(range(len(mark.values))),
                "offset": offset,
                "width": 0.92 * thick,
                "marker": {"color": f"var(--{mark.colour})"},
                "hovertemplate": "%{x:.3g}",
            }
        else:
            trace = _curve(mark, panel, shared)
        place = {"xaxis": f"x{k}", "yaxis": f"y{k}", "name": mark.name, "legendgroup": mark.name}
        yield {key: value for key, value in (trace | place).items() if value is not None}


def _curve(series: Series, panel: Panel, shared: dict[str, int]) -> dict[str, Any]:
    colour = f"var(--{series.colour})"
    parts = {"lines": series.width or series.fill, "markers": series.marker, "text": series.labels}
    dash = {"dash": "dash"} if series.dashed else {}
    return {
        "x": shared.setdefault(_bytes(series.x), len(shared)),
        "y": _packed(series.y),
        "mode": "+".join(part for part, drawn in parts.items() if drawn) or "none",
        "line": {"color": colour, "width": series.width, "shape": _SHAPE[series.stairs]} | dash,
        "visible": "legendonly" if series.hidden else None,
        "marker": _marker(series, colour) if series.marker else None,
        "fill": _FILL[series.fill],
        "fillcolor": f"{colour}{round(255 * series.dense):02x}" if series.fill else None,
        "customdata": list(series.links) if any(series.links) else None,
        "error_x": _error_bars(series.x, series.x_range, colour),
        "error_y": _error_bars(series.y, series.y_range, colour),
        **_labels(series),
        **_hover(series, panel),
    }


def _marker(series: Series, colour: str) -> dict[str, Any]:
    size = _packed(series.size) if np.ndim(series.size) else series.size
    edge = {"color": colour, "width": 2 if series.marker != "dot" else 0}
    return {"color": colour, "size": size, "symbol": _SYMBOLS[series.marker], "line": edge}


def _labels(series: Series) -> dict[str, Any]:
    """Labels above high points and below low ones."""
    if not series.labels:
        return {}
    high = np.asarray(series.y) >= np.mean(series.y)
    return {"text": list(series.labels), "textposition": [f"{'top' if up else 'bottom'} center" for up in high]}


def _hover(series: Series, panel: Panel) -> dict[str, Any]:
    """What a point says: its own text, or its value on the axis that has no names. An area says nothing."""
    if series.fill == "self":
        return {"hoverinfo": "skip"}
    if series.hover:
        return {"hovertext": list(map(escape, series.hover)), "hovertemplate": "%{hovertext}<extra></extra>"}
    value, axis = ("%{x:.3g}", panel.x) if panel.y.labels else ("%{y:.4g}", panel.y)
    return {"hovertemplate": f"{value}{_unit(axis)}"}


def _error_bars(at: Array, ends: tuple[Array, Array] | None, colour: str) -> dict[str, Any] | None:
    if ends is None:
        return None
    less, more = np.asarray(at) - ends[0], ends[1] - np.asarray(at)
    look = {"color": colour, "thickness": 1.4, "width": 0, "array": _packed(more)}
    return look if np.allclose(less, more) else look | {"symmetric": False, "arrayminus": _packed(less)}


def _bytes(values: Array) -> str:
    """Values in single precision, base64: enough for a plot."""
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()


def _packed(values: Array | float) -> dict[str, str]:
    return {"dtype": "f4", "bdata": _bytes(np.asarray(values))}


def _unit(axis: Axis) -> str:
    return f" {axis.title.split('[')[1].rstrip(']')}" if "[" in axis.title else ""


# -- layout -----------------------------------------------------------------------------------------------------------
def _places(figure: Figure, room: Room) -> tuple[list[tuple[float, float, float, float]], float]:
    """Left, right (shares of the width), top and bottom [px] of each panel's axes; height of all below the legend."""
    rows = figure.rows if room.columns is None else tuple((panel,) for panel in figure.panels)
    places, top = [], 0.0
    for row in rows:
        top += room.above if any(panel.title for panel in row) else 8.0
        tall = max(room.panel_height(panel, figure) for panel in row)
        for k in range(len(row)):
            gap = 0.0 if k + 1 == len(row) else room.left / room.width
            places.append((k / len(row), (k + 1) / len(row) - gap, top, top + tall))
        top += tall + room.below + (room.title if any(panel.x.title for panel in row) else 0.0)
    return places, top


def _layout(figure: Figure, room: Room) -> dict[str, Any]:
    places, tall = _places(figure, room)
    over_time = not any(panel.equal or panel.y.labels or panel.x.labels for panel in figure.panels)
    layout: dict[str, Any] = {
        "height": height(figure, room),
        "margin": {"l": room.left, "r": 12.0, "t": room.legend_height(figure), "b": 0},
        "hovermode": "x unified" if over_time and figure.entries else "closest",
        "shapes": [],
        "annotations": [],
    }
    named: set[str] = set()
    for k, (panel, (left, right, top, bottom)) in enumerate(zip(figure.panels, places, strict=True), start=1):
        x, y = _axis(panel.x, room), _axis(panel.y, room)
        x |= {"domain": [left, right], "anchor": f"y{k}"}
        y |= {"domain": [1.0 - bottom / tall, 1.0 - top / tall], "anchor": f"x{k}"}
        if panel.equal:
            y |= {"scaleanchor": f"x{k}" if k > 1 else "x"}  # Plotly knows no "x1" here
        if k > 1 and figure.shared:
            x["matches"] = "x"
        layout |= {f"xaxis{k}": x, f"yaxis{k}": y}
        for guide in panel.guides:
            shown = {"name": guide.name, "showlegend": bool(guide.name) and guide.name not in named}
            layout["shapes"].append(_shape(guide, k) | shown)
            named.add(guide.name)
        if panel.title:
            place = {"x": left, "y": 1.0 - top / tall, "xref": "paper", "yref": "paper", "yanchor": "bottom"}
            look = {"showarrow": False, "xanchor": "left", "font": {"color": "var(--ink)", "size": 13}}
            layout["annotations"].append({"text": panel.title, **place, **look})
    return layout


def _axis(axis: Axis, room: Room) -> dict[str, Any]:
    made: dict[str, Any] = {
        "title": {"text": axis.title, "standoff": 6},
        "type": "log" if axis.log else "linear",
        "rangemode": "tozero" if axis.zero else "normal",
    }
    if axis.limits is not None:
        made["range"] = list(np.log10(axis.limits)) if axis.log else list(axis.limits)
    if axis.step is not None:
        made |= {"tick0": 0, "dtick": axis.step}
    if axis.labels:
        names = axis.names(room.letters)
        made |= {"tickvals": list(range(len(names))), "ticktext": names, "automargin": True, "zeroline": False}
        made["range"] = [len(names) - 0.5, -0.5]
    return made


def _shape(guide: Guide, k: int) -> dict[str, Any]:
    along, across = ("x", "y") if guide.of == "x" else ("y", "x")
    shape: dict[str, Any] = {f"{along}ref": f"{along}{k}", f"{across}ref": f"{across}{k} domain"}
    shape |= {f"{along}0": guide.begin, f"{along}1": guide.begin if guide.end is None else guide.end}
    shape |= {f"{across}0": 0, f"{across}1": 1, "legendgroup": guide.name}
    colour = f"var(--{guide.colour})"
    if guide.end is None:
        return shape | {"type": "line", "line": {"color": colour, "dash": "dot", "width": 1.5}}
    return shape | {"type": "rect", "fillcolor": f"{colour}{_SHADE}", "line": {"width": 0}, "layer": "below"}
