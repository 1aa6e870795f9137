"""Figures by Matplotlib, for papers: white, in the width of a page's text, as PDF, PNG or SVG."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stadera.errors import MissingExtraError, StaderaError
from stadera.report.figures.model import Bars, Figure, Guide, Panel, Series
from stadera.report.look import light
from stadera.report.table import Cell, TableData

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawn

SUFFIXES = (".pdf", ".png", ".svg")
_WIDTH = 7.1  # in, of two columns of an IEEE paper
_PX = 0.0088  # in a pixel of a page: the page's proportions in that width
_DPI = 300
_MARKERS = {"dot": "o", "ring": "o", "diamond": "D", "plus": "+", "cross": "x"}
_FONT = {"font.size": 8.0, "axes.titlesize": 8.0, "legend.fontsize": 7.5, "svg.fonttype": "none", "pdf.fonttype": 42}
_TINTS = {"observable": "green-tint", "partial": "gray-tint", "unobservable": "red-tint"}


def check_figure(path: str | Path) -> None:
    """Whether a figure can be written there, before the work.

    Raises:
        StaderaError: another suffix than .pdf, .png, .svg. MissingExtraError: Matplotlib is not installed.
    """
    if Path(path).suffix.lower() not in SUFFIXES:
        raise StaderaError(f"{path}: a figure is written as one of {', '.join(SUFFIXES)}")
    _matplotlib()


def save(drawn: Drawn, path: str | Path) -> None:
    """Writes a figure, in the format of the path's suffix. Errors as `check_figure`."""
    check_figure(path)
    with _matplotlib().rc_context(_FONT):
        drawn.savefig(path, dpi=_DPI)


def draw(shown: Figure | TableData) -> Drawn:
    """A Matplotlib figure, to be saved or changed further; tables are drawn with the colours of observability.

    Raises:
        MissingExtraError: Matplotlib is not installed.
    """
    with _matplotlib().rc_context(_FONT):
        return _table(shown) if isinstance(shown, TableData) else _figure(shown)


def _matplotlib() -> Any:
    try:
        import matplotlib
        import matplotlib.figure
    except ImportError:
        raise MissingExtraError("matplotlib", "figures", "a figure for a paper") from None
    return matplotlib


def _figure(figure: Figure) -> Drawn:
    columns = max(map(len, figure.rows))
    tall = _PX * sum(_tall(figure, row) for row in figure.rows) + 0.35
    drawn: Drawn = _matplotlib().figure.Figure(figsize=(_WIDTH, tall), layout="constrained")
    shares = [panel.share for panel in max(figure.rows, key=len)]
    axes = drawn.subplots(
        len(figure.rows), columns, squeeze=False, sharex="col" if figure.shared else False, width_ratios=shares
    )
    for row, places in zip(figure.rows, axes, strict=True):
        for panel, place in zip(row, places, strict=False):
            _panel(place, panel)
        for place in places[len(row) :]:
            place.set_axis_off()
    handles: dict[str, Any] = {}
    for place in drawn.axes:
        for handle, name in zip(*place.get_legend_handles_labels(), strict=True):
            handles.setdefault(name, handle)
    if handles:
        drawn.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=4, frameon=False)
    return drawn


def _tall(figure: Figure, row: tuple[Panel, ...]) -> float:
    """Height of a row in a page's pixels."""
    if labels := max(len(panel.y.labels) for panel in row):
        return 60.0 + 22.0 * labels
    return 380.0 if any(panel.equal for panel in row) else 0.8 * figure.row_height


def _panel(place: Axes, panel: Panel) -> None:
    for guide in panel.guides:
        _guide(place, guide)
    bars = [mark for mark in panel.marks if isinstance(mark, Bars)]
    for k, bar in enumerate(bars):
        thick = 0.75 / len(bars)
        at = np.arange(len(bar.values)) + thick * (k + 0.5 - 0.5 * len(bars))
        place.barh(at, bar.values, 0.92 * thick, color=light(bar.colour), label=bar.name)
    for mark in panel.marks:
        if isinstance(mark, Series) and not mark.hidden:
            _series(place, mark)
    _axes(place, panel)


def _axes(place: Axes, panel: Panel) -> None:
    place.set(xlabel=panel.x.title, ylabel=panel.y.title)
    place.set_title(panel.title, loc="left")
    for axis, side, scale in ((panel.x, "x", place.set_xscale), (panel.y, "y", place.set_yscale)):
        if axis.log:
            scale("log")
        if axis.limits is not None:
            (place.set_xlim if side == "x" else place.set_ylim)(*axis.limits)
        if axis.zero:
            place.set_xlim(left=0.0) if side == "x" else place.set_ylim(bottom=0.0)
    if panel.x.labels:
        place.set_xticks(range(len(panel.x.labels)), panel.x.labels, rotation=30, ha="right")
    if panel.y.labels:
        place.set_yticks(range(len(panel.y.labels)), panel.y.labels)
        place.set_ylim(len(panel.y.labels) - 0.5, -0.5)
    if panel.equal:
        place.set_aspect("equal", adjustable="datalim")
    place.grid(color=light("line"), linewidth=0.5)
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
            place.fill(*part[~np.isnan(part[:, 0])].T, color=colour, alpha=0.2, lw=0.0, label=name)
            name = None
    elif series.fill:
        place.fill_between(x, y, color=colour, alpha=0.15, lw=0.0)
    if series.width:
        label = None if series.fill == "self" else name
        place.plot(x, y, color=colour, lw=0.62 * series.width, ls="--" if series.dashed else "-", label=label)
        name = None
    errors: dict[str, Any] = {
        f"{side}err": np.abs(np.array(ends) - np.asarray(at))
        for side, ends, at in (("x", series.x_range, series.x), ("y", series.y_range, series.y))
        if ends is not None
    }
    if errors:
        place.errorbar(series.x, series.y, **errors, fmt="none", ecolor=colour, elinewidth=0.9)
    if series.marker:
        face = "none" if series.marker in ("ring", "diamond") else colour
        area = (0.55 * np.asarray(series.size)) ** 2
        looks = {"facecolors": face, "edgecolors": colour} if series.marker not in ("plus", "cross") else {"c": colour}
        place.scatter(series.x, series.y, s=area, marker=_MARKERS[series.marker], linewidths=1.1, label=name, **looks)  # type: ignore[arg-type]
    for a, b, text in zip(series.x, series.y, series.labels or (), strict=False):
        place.annotate(text, (a, b), (0, 9), textcoords="offset points", ha="center", fontsize=7)


# -- tables ---------------------------------------------------------------------------------------------------------
def _table(table: TableData) -> Drawn:
    rows = [row for _, group in table.groups for row in group]
    drawn: Drawn = _matplotlib().figure.Figure(figsize=(_WIDTH, 0.19 * (len(rows) + 3)), layout="constrained")
    place = drawn.add_subplot()
    place.set_axis_off()
    texts = [[_text(cell) for cell in row] for row in rows]
    colours = [[_tint(cell) for cell in row] for row in rows]
    made = place.table(texts, colours, colLabels=table.head, cellLoc="left", loc="center", edges="horizontal")
    made.auto_set_font_size(False)
    made.set_fontsize(7.5)
    made.auto_set_column_width(list(range(len(table.head))))
    for (row, _), cell in made.get_celld().items():
        cell.set_edgecolor(light("steel" if row == 0 else "line"))
        cell.set_facecolor(colours[row - 1][_] if row else light("paper"))
        cell.visible_edges = "BT" if row == 0 else "B"
    place.set_title(table.title, loc="left")
    return drawn


def _text(cell: Cell) -> str:
    symbol = f"{cell.mark.symbol} " if cell.mark else ""
    return f"{symbol}{cell.text}{f'  {cell.note}' if cell.note else ''}"


def _tint(cell: Cell) -> str:
    return light(_TINTS[cell.mark.word] if cell.mark else "paper")
