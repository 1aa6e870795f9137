"""Converts figures to Plotly's JSON for interactive plots on a page, which contains Plotly itself.

Colours stay names, `var(--blue)`: `plots.js` inserts the page's own, light or dark. Curves over the same x share it.
"""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
from markupsafe import Markup

from stadera.errors import StaderaError
from stadera.report.figures.model import Bars, Figure, Guide, Panel, Series
from stadera.types import Array

_SHAPE = {"": "linear", "hold": "hv", "bins": "hvh"}
_TOP, _BOTTOM, _BETWEEN, _LEGEND = 26.0, 44.0, 34.0, 34.0  # px around panels
_TINT, _SHADE = "2e", "1f"  # opacity, two hexadecimal digits after a colour


def height(figure: Figure) -> int:
    """Height of the drawn figure [px]."""
    return round(_LEGEND + _BOTTOM + len(figure.rows) * (figure.row_height - _BETWEEN) + _TOP)


def data(figure: Figure) -> Markup:
    """JSON that cannot terminate its script element. StaderaError for bars or adjacent panels, which are static."""
    shared: dict[str, int] = {}
    traces: list[dict[str, Any]] = []
    named: set[str] = set()
    for k, (panel, *more) in enumerate(figure.rows, start=1):
        if more or any(isinstance(mark, Bars) for mark in panel.marks):
            raise StaderaError(f"figure {figure.title!r}: only curves in panels below each other can be zoomed")
        for mark in panel.marks:
            assert isinstance(mark, Series)
            traces.append(_trace(mark, k, mark.name not in named, shared, panel))
            named.add(mark.name)
    made = {"data": traces, "layout": _layout(figure), "shared": list(shared)}
    return Markup(json.dumps(made, separators=(",", ":"), allow_nan=False).replace("</", "<\\/"))


def _trace(series: Series, row: int, first: bool, shared: dict[str, int], panel: Panel) -> dict[str, Any]:
    colour, axis = f"var(--{series.colour})", "" if row == 1 else str(row)
    trace: dict[str, Any] = {
        "x": shared.setdefault(_packed(series.x), len(shared)),
        "y": {"dtype": "f4", "bdata": _packed(series.y)},
        "xaxis": f"x{axis}",
        "yaxis": f"y{axis}",
        "mode": "+".join(["lines"] * bool(series.width or series.fill) + ["markers"] * bool(series.marker)) or "none",
        "line": {"color": colour, "width": series.width, "shape": _SHAPE[series.stairs]},
        "name": series.name,
        "legendgroup": series.name,
        "showlegend": bool(first and series.name),
        "hovertemplate": f"%{{y:.4g}}{_unit(panel)}",
    }
    if series.dashed:
        trace["line"]["dash"] = "dash"
    if series.marker:
        trace["marker"] = {"color": colour, "size": float(np.max(series.size))}
    if series.fill:
        trace |= {"fill": "toself" if series.fill == "self" else "tozeroy", "fillcolor": f"{colour}{_TINT}"}
        trace |= {"hoverinfo": "skip", "hovertemplate": None} if series.fill == "self" else {}
    if series.hidden:
        trace["visible"] = "legendonly"
    return trace


def _packed(values: Array) -> str:
    """Values in single precision, base64: enough for a plot."""
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()


def _unit(panel: Panel) -> str:
    return f" {panel.y.title.split('[')[1].rstrip(']')}" if "[" in panel.y.title else ""


def _layout(figure: Figure) -> dict[str, Any]:
    tall = height(figure)
    room = tall - _LEGEND - _BOTTOM
    each = room / len(figure.rows)
    layout: dict[str, Any] = {
        "height": tall,
        "margin": {"l": 58, "r": 12, "t": _LEGEND, "b": _BOTTOM},
        "font": {"family": "system-ui, 'Segoe UI', Helvetica, Arial, sans-serif", "size": 12, "color": "var(--soft)"},
        "paper_bgcolor": "var(--paper)",
        "plot_bgcolor": "var(--paper)",
        "hovermode": "x unified",
        "hoverlabel": {"bgcolor": "var(--paper)", "bordercolor": "var(--line)", "font": {"color": "var(--ink)"}},
        "legend": {"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top"},
        "shapes": [],
        "annotations": [],
    }
    for k, panel in enumerate(figure.panels):
        name, top = "" if k == 0 else str(k + 1), 1.0 - k * each / room
        domain = [top - (each - (_BETWEEN if k < len(figure.rows) - 1 else 0.0)) / room, top - _TOP / room]
        layout[f"xaxis{name}"] = _axis(panel.x.title, panel.x.limits, panel.x.log) | {"anchor": f"y{name}"}
        layout[f"yaxis{name}"] = _axis(panel.y.title, panel.y.limits, panel.y.log) | {
            "domain": [max(domain[0], 0.0), domain[1]],
            "anchor": f"x{name}",
            "rangemode": "tozero" if panel.y.zero else "normal",
        }
        if k and figure.shared:
            layout[f"xaxis{name}"]["matches"] = "x"
        layout["shapes"] += [_shape(guide, name) for guide in panel.guides]
        if panel.title:
            layout["annotations"].append(_heading(panel.title, domain[1]))
    return layout


def _axis(title: str, limits: tuple[float, float] | None, log: bool) -> dict[str, Any]:
    lines = {"gridcolor": "var(--line)", "zerolinecolor": "var(--line)", "linecolor": "var(--steel)"}
    axis: dict[str, Any] = {"title": {"text": title, "standoff": 6}, "type": "log" if log else "linear", **lines}
    if limits is not None:
        axis["range"] = list(np.log10(limits)) if log else list(limits)
    return axis


def _shape(guide: Guide, name: str) -> dict[str, Any]:
    along, across = ("x", "y") if guide.of == "x" else ("y", "x")
    refs = {f"{along}ref": f"{along}{name}", f"{across}ref": f"{across}{name} domain"}
    ends = {f"{along}0": guide.begin, f"{along}1": guide.begin if guide.end is None else guide.end}
    ends |= {f"{across}0": 0, f"{across}1": 1}
    colour = f"var(--{guide.colour})"
    if guide.end is None:
        return {"type": "line", **refs, **ends, "line": {"color": colour, "dash": "dot", "width": 1.5}}
    return {"type": "rect", **refs, **ends, "fillcolor": f"{colour}{_SHADE}", "line": {"width": 0}, "layer": "below"}


def _heading(text: str, top: float) -> dict[str, Any]:
    place = {"xref": "paper", "yref": "paper", "x": 0, "y": top, "xanchor": "left", "yanchor": "bottom"}
    return {"text": text, "showarrow": False, "font": {"color": "var(--ink)", "size": 12.5}, **place}
