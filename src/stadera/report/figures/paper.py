"""Draws figures with Matplotlib for papers: white, in the width of a page's text, as PDF, PNG or SVG."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stadera.errors import StaderaError, UnknownNameError, of_extra
from stadera.files import AnyPath
from stadera.report.figures.model import Bars, Figure, Guide, Panel, Series
from stadera.report.look import light
from stadera.report.table import TableData

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawn

SUFFIXES = (".pdf", ".png", ".svg")
_MARKERS = {"dot": "o", "ring": "o", "diamond": "D", "plus": "+", "cross": "x"}
_FONT = {"font.size": 8.0, "axes.titlesize": 8.0, "legend.fontsize": 7.5, "svg.fonttype": "none", "pdf.fonttype": 42}
_SIZES = {"width": 7.1, "px": 0.0088, "dpi": 300.0}
"""In inches, two columns of an IEEE paper and a pixel of a page, whose proportions are kept; and dots per inch."""
_TINTS = {"observable": "green-tint", "partial": "gray-tint", "unobservable": "red-tint"}


def check_figure(path: AnyPath) -> None:
    """Checks before the computation that a figure can be written: StaderaError for a suffix, MissingExtraError."""
    if Path(path).suffix.lower() not in SUFFIXES:
        raise StaderaError(f"{path}: a figure is written as one of {', '.join(SUFFIXES)}")
    _matplotlib()


def save(drawn: Drawn, path: AnyPath) -> None:
    """Writes a figure, in the format of the path's suffix. Errors as `check_figure`."""
    check_figure(path)
    with _matplotlib().rc_context(_FONT):
        drawn.savefig(path, dpi=_SIZES["dpi"])


def drawn(figures: Mapping[str, Figure | TableData], name: str | None = None) -> Drawn:
    """The figure with that name, None for the first; StaderaError if there is none. Needs Matplotlib."""
    if not figures:
        raise StaderaError("this result has no figures")
    chosen = next(iter(figures)) if name is None else name
    if chosen not in figures:
        raise UnknownNameError("figure", chosen, tuple(figures))
    return draw(figures[chosen])


def draw(shown: Figure | TableData) -> Drawn:
    """Draws a Matplotlib figure; tables are drawn with the colours of observability. MissingExtraError without it."""
    with _matplotlib().rc_context(_FONT):
        return _table(shown) if isinstance(shown, TableData) else _figure(shown)


def _matplotlib() -> Any:
    with of_extra("matplotlib", "figures", "a figure for a paper"):
        import matplotlib
        import matplotlib.figure
    return matplotlib


def _figure(figure: Figure) -> Drawn:
    columns = max(map(len, figure.rows))
    tall = _SIZES["px"] * sum(_tall(figure, row) for row in figure.rows) + 0.35
    drawn: Drawn = _matplotlib().figure.Figure(figsize=(_SIZES["width"], tall), layout="constrained")
    axes = drawn.subplots(len(figure.rows), columns, squeeze=False, sharex="col" if figure.shared else False)
    for row, places in zip(figure.rows, axes, strict=True):
        for panel, place in zip(row, places, strict=False):
            _panel(place, panel)
        for place in places[len(row) :]:
            place.set_axis_off()
    handles: dict[str, Any] = {}  # of one legend above all panels, with each name once
    for place in drawn.axes:
        for handle, name in zip(*place.get_legend_handles_labels(), strict=True):
            handles.setdefault(name, handle)
    if handles:
        drawn.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=4, frameon=False)
    return drawn


def _tall(figure: Figure, row: tuple[Panel, ...]) -> float:
    """Height of a row in pixels of a page."""
    if labels := max(len(panel.y.labels) for panel in row):
        return 60.0 + 22.0 * labels
    return 380.0 if any(panel.equal for panel in row) else 0.8 * figure.row_height


def _panel(place: Axes, panel: Panel) -> None:
    for guide in panel.guides:
        _guide(place, guide)
    bars = [mark for mark in panel.marks if isinstance(mark, Bars)]
    thick = 0.75 / max(len(bars), 1)
    for k, bar in enumerate(bars):
        at = np.arange(len(bar.values)) + thick * (k + 0.5 - 0.5 * len(bars))
        place.barh(at, bar.values, 0.92 * thick, color=light(bar.colour), label=bar.name)
    for mark in panel.marks:
        if isinstance(mark, Series) and not mark.hidden:
            _series(place, mark)
    _axes(place, panel)


def _axes(place: Axes, panel: Panel) -> None:
    place.set(xlabel=panel.x.title, ylabel=panel.y.title)
    place.set_title(panel.title, loc="left")
    from matplotlib.ticker import MultipleLocator

    for axis, ticked, set_scale, set_limits in (
        (panel.x, place.xaxis, place.set_xscale, place.set_xlim),
        (panel.y, place.yaxis, place.set_yscale, place.set_ylim),
    ):
        if axis.log:
            set_scale("log")
        if axis.limits is not None:
            set_limits(*axis.limits)
        if axis.step is not None:
            ticked.set_major_locator(MultipleLocator(axis.step))
        if axis.zero:
            set_limits(0.0, None)
    if panel.x.labels:
        place.set_xticks(range(len(panel.x.labels)), panel.x.labels, rotation=30, ha="right")
    if panel.y.labels:
        place.set_yticks(range(len(panel.y.labels)), panel.y.names(60))
        place.set_ylim(len(panel.y.labels) - 0.5, -0.5)
    if panel.equal:
        place.set_aspect("equal", adjustable="box")
    place.grid(color=light("line"), linewidth=0.5, axis="x" if panel.y.labels else "both")
    place.set_axisbelow(True)
    place.spines[["top", "right"]].set_visible(False)


def _guide(place: Axes, guide: Guide) -> None:
    colour, upright = light(guide.colour), guide.of == "x"
    name = guide.name or None
    if guide.end is None:
        (place.axvline if upright else place.axhline)(guide.begin, color=colour, lw=0.9, ls=":", label=name)
    else:
        span = place.axvspan if upright else place.axhspan
        span(guide.begin, guide.end, color=colour, alpha=0.12, lw=0.0, label=name)


def _series(place: Axes, series: Series) -> None:
    colour, name = light(series.colour), series.name or None
    x, y = series.path()
    if series.fill == "self":
        for part in np.split(np.column_stack([x, y]), np.flatnonzero(np.isnan(x))):
            place.fill(*part[~np.isnan(part[:, 0])].T, color=colour, alpha=series.dense, lw=0.0, label=name)
            name = None
    elif series.fill:
        place.fill_between(x, y, color=colour, alpha=series.dense, lw=0.0)
    if series.width:
        label = None if series.fill == "self" else name
        place.plot(x, y, color=colour, lw=0.62 * series.width, ls="--" if series.dashed else "-", label=label)
        name = None
    ends = {"xerr": (series.x_range, series.x), "yerr": (series.y_range, series.y)}
    errors: dict[str, Any] = {
        side: np.abs(np.array(span) - at) for side, (span, at) in ends.items() if span is not None
    }
    if errors:
        place.errorbar(series.x, series.y, **errors, fmt="none", ecolor=colour, elinewidth=0.9)
    size = 0.5 * np.broadcast_to(series.size, np.shape(series.x))  # pt
    if series.marker:
        face = "none" if series.marker in ("ring", "diamond") else colour
        look: dict[str, Any] = {"marker": _MARKERS[series.marker], "linewidths": 1.1}
        look |= {"color": colour} if series.marker in ("plus", "cross") else {"facecolors": face, "edgecolors": colour}
        place.scatter(series.x, series.y, s=size**2, zorder=3, **look)
        place.scatter([], [], s=3.5**2, label=name, **look)  # the legend's, of a usual size
    for k, text in enumerate(series.labels):  # outside of its marker, as seen from the middle of all
        up = series.y[k] > np.mean(series.y)
        at: dict[str, Any] = {"ha": "center", "va": "bottom" if up else "top", "fontsize": 7}
        offset = (0.0, (0.5 * size[k] + 2.0) * (1.0 if up else -1.0))
        place.annotate(text, (series.x[k], series.y[k]), offset, textcoords="offset points", **at)


def _table(table: TableData) -> Drawn:
    """A table with the colours of observability, in the largest font in which its longest texts fit."""
    cells = [row for _, rows in table.groups for row in rows]
    texts = [[f"{cell.marked}  {cell.note}".strip() for cell in row] for row in cells]
    tints = [[light(_TINTS[cell.mark.word] if cell.mark else "paper") for cell in row] for row in cells]
    wide = np.array([max(map(len, column)) + 3 for column in zip(table.head, *texts, strict=True)])
    size = min(8.0, 72.0 * _SIZES["width"] / wide.sum() / 0.56)
    lines = len(cells) + 1
    tall = 1.75 * size / 72.0 * (lines + 1.5)
    drawn: Drawn = _matplotlib().figure.Figure(figsize=(_SIZES["width"], tall), layout="constrained")
    place = drawn.add_subplot()
    place.set_axis_off()
    place.set_title(table.title, loc="left")
    look: dict[str, Any] = {"colWidths": wide / wide.sum(), "cellLoc": "left", "colLoc": "left", "bbox": (0, 0, 1, 1)}
    grid = place.table(texts, tints, colLabels=table.head, **look)
    grid.auto_set_font_size(False)
    grid.set_fontsize(size)
    for (row, _), cell in grid.get_celld().items():
        cell.set(linewidth=0.0)
        cell.PAD = 0.02  # of the column's width
        cell.set_text_props(weight="normal" if row else "bold")
    place.set(xlim=(0.0, 1.0), ylim=(0.0, lines))
    place.axhline(lines - 1.0, color=light("ink"), lw=0.8, zorder=3)
    return drawn
