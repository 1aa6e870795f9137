"""The page that a report is: one file with its style, its script library and its figures, nothing loaded."""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from stadera.report.markup import Html, element, text

if TYPE_CHECKING:
    import plotly.graph_objects as go

_CONFIG = {"displayModeBar": False, "responsive": True}

_DRAW = """
for (const place of document.querySelectorAll(".plot")) {
  const figure = JSON.parse(place.querySelector("script").textContent);
  Plotly.newPlot(place, figure.data, figure.layout, CONFIG);
}
const fit = (width) => {
  for (const place of document.querySelectorAll(".plot"))
    Plotly.relayout(place, width ? {width: width, autosize: false} : {width: null, autosize: true});
};
addEventListener("beforeprint", () => fit(680));
addEventListener("afterprint", () => fit(null));
"""


def figure_html(figure: go.Figure, label: str) -> Html:
    """A place in the page where a figure is drawn."""
    height = int(figure.layout.height or 400)
    data = figure.to_json().replace("</", "<\\/")
    script = element("script", Html(data), type="application/json")
    return element("div", script, css="plot", style=f"min-height:{height}px", role="img", **{"aria-label": label})


def page_html(title: str, *sections: str) -> str:
    """The whole page. Loads nothing from anywhere."""
    import plotly.offline

    head = (
        '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">',
        element("title", text(title)),
        element("style", Html(_style())),
    )
    scripts = (
        element("script", Html(plotly.offline.get_plotlyjs())),
        element("script", Html(_DRAW.replace("CONFIG", json.dumps(_CONFIG)))),
    )
    body = element("body", element("main", *sections), *scripts)
    return f'<!DOCTYPE html>\n<html lang="en"><head>{"".join(head)}</head>{body}</html>\n'


@cache
def _style() -> str:
    return (resources.files("stadera.report") / "report.css").read_text(encoding="utf-8")
