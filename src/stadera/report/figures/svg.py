"""Draws figures as inline SVG: without scripts, scalable, and dark on dark pages."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape

import numpy as np
from markupsafe import Markup

from stadera.report.figures.model import Bars, Figure, Guide, Marker, Panel, Series
from stadera.report.figures.scale import Scale, scale_of
from stadera.types import Array

WIDE, NARROW = 1120.0, 340.0
"""Widths for which figures are laid out [px]: that of a page, and of a phone."""

_CHAR = 6.6  # px, of a character of a tick's label
_TOP, _TITLE, _BOTTOM, _X_TITLE, _BETWEEN, _RIGHT = 8.0, 22.0, 22.0, 20.0, 14.0, 12.0  # px around a panel's axes
_CATEGORY = 34.0  # px for a category whose name is above it
_TICK_X, _TICK_Y = 80.0, 34.0  # px, least distance between ticks
_SHAPES: dict[Marker, str] = {
    "diamond": "M0-{r}L{r} 0L0 {r}L-{r} 0Z",
    "plus": "M-{r} 0H{r}M0-{r}V{r}",
    "cross": "M-{r}-{r}L{r} {r}M-{r} {r}L{r}-{r}",
}


def svg(figure: Figure, width: float = WIDE) -> Markup:
    """A figure as an SVG element that scales with its container, without legend; narrow [px]: in one column."""
    rows = figure.rows if width > 2 * NARROW else tuple((panel,) for panel in figure.panels)
    drawn, top = [], 0.0
    for row in rows:
        shares = sum(panel.share for panel in row)
        left, bottom = 0.0, top
        for panel in row:
            place = _Place(panel, width * panel.share / shares, figure.row_height, _label_width(row, rows, width))
            drawn.append(f'<g transform="translate({left:.1f} {top:.1f})">{"".join(place.parts())}</g>')
            left, bottom = left + place.width, max(bottom, top + place.height)
        top = bottom
    text = escape(figure.title, quote=True)
    return Markup(f'<svg viewBox="0 0 {width:.0f} {top:.0f}" role="img" aria-label="{text}">{"".join(drawn)}</svg>')


def _label_width(row: Sequence[Panel], rows: Sequence[Sequence[Panel]], width: float) -> float:
    """Space to the left of the axes, for all rows of a panel [px]; 0 if category names are above their bars."""
    panels = [p for r in rows for p in r] if len(row) == 1 else row
    texts = [text for panel in panels for text in panel.y.labels]
    if not texts:
        return 58.0
    needed = _CHAR * max(map(len, texts)) + 12.0
    return needed if needed < 0.45 * width else 0.0


@dataclass(frozen=True)
class _Place:
    """One panel, drawn within `width` px, with `left` px for the tick labels."""

    panel: Panel
    width: float
    row_height: float
    left: float

    @property
    def above(self) -> bool:
        """True if category names are above their bars, for lack of space."""
        return not self.left

    @property
    def inner(self) -> tuple[float, float]:
        """Size of the area inside the axes [px]."""
        wide = self.width - max(self.left, 8.0) - _RIGHT
        if self.panel.equal:
            x, y = (scale_of(axis, self.panel, name, 1.0) for axis, name in ((self.panel.x, "x"), (self.panel.y, "y")))
            return wide, min(wide * (y.high - y.low) / (x.high - x.low), 1.25 * wide)
        if self.panel.y.labels:
            return wide, (_CATEGORY if self.above else 26.0) * len(self.panel.y.labels)
        return wide, self.row_height - _TOP - _BOTTOM - _BETWEEN

    @property
    def height(self) -> float:
        """Height of the whole panel [px]."""
        around = _TOP + _BOTTOM + _BETWEEN + (_TITLE if self.panel.title else 0.0)
        return self.inner[1] + around + (_X_TITLE if self.panel.x.title else 0.0)

    def parts(self) -> Iterator[str]:
        """Yields SVG elements, relative to the panel's corner."""
        panel, (wide, high) = self.panel, self.inner
        x, y = scale_of(panel.x, panel, "x", wide), scale_of(panel.y, panel, "y", high)
        if panel.equal:
            x, y = _equal(x, y)
        left, top = max(self.left, 8.0), _TOP + (_TITLE if panel.title else 0.0)
        if panel.title:
            yield f'<text x="{left:.1f}" y="{_TOP + 10:.1f}" class="t">{escape(panel.title)}</text>'
        yield f'<g transform="translate({left:.1f} {top:.1f})">'
        yield from self._grid(x, y)
        yield f'<svg width="{wide:.1f}" height="{high:.1f}">'
        for guide in panel.guides:
            yield _guide(guide, x, y)
        for mark, offset, thick in _arranged(panel.marks):
            yield from _bars(mark, x, y, offset, thick) if isinstance(mark, Bars) else _series(mark, x, y)
        yield "</svg>"
        for mark in panel.marks:
            if isinstance(mark, Series) and mark.labels:
                yield from _labels(mark, x, y)
        yield "</g>"

    def _grid(self, x: Scale, y: Scale) -> Iterator[str]:
        panel, (wide, high) = self.panel, self.inner
        lines = yield from self._ticks_of_x(x)
        lines += yield from (self._names_of_y(y) if panel.y.labels else self._ticks_of_y(y))
        yield f'<path class="g" d="{lines}M0 0V{high:.1f}H{wide:.1f}"/>'
        if panel.x.title:
            yield f'<text x="{wide / 2:.1f}" y="{high + 34:.1f}" class="x">{escape(panel.x.title)}</text>'
        if panel.y.title:
            place = f'transform="translate({9 - max(self.left, 8.0):.1f} {high / 2:.1f}) rotate(-90)"'
            yield f'<text {place} class="x">{escape(panel.y.title)}</text>'

    def _ticks_of_x(self, x: Scale) -> Generator[str, None, str]:
        """Yields the labels below the panel; returns the path of the grid lines."""
        labels, (wide, high) = self.panel.x.labels, self.inner
        if labels:
            values, texts = [float(k) for k in range(len(labels))], list(labels)
        else:
            values, texts = x.ticks(_TICK_X if wide > NARROW else 60.0)
        at = x(np.array(values))
        turned = labels and _CHAR * max(map(len, texts)) > wide / len(texts)
        for v, text in zip(at, texts, strict=True):
            turn = f' transform="rotate(-30 {v:.1f} {high + 16:.1f})" text-anchor="end"' if turned else ""
            yield f'<text x="{v:.1f}" y="{high + 16:.1f}" class="x"{turn}>{escape(text)}</text>'
        return "".join(f"M{v:.1f} 0V{high:.1f}" for v in at)

    def _names_of_y(self, y: Scale) -> Generator[str, None, str]:
        """Yields the rows' names, left of the panel or above each row if it is narrow, without grid lines."""
        for k, name in enumerate(self.panel.y.labels):
            v, room = float(y(float(k))), int(self.inner[0] / _CHAR) if self.above else len(name)
            text = name if len(name) <= room else f"{name[: room - 1]}…"
            place = f'x="0" y="{v - 8:.1f}" class="a"' if self.above else f'x="-8" y="{v + 4:.1f}" class="y"'
            yield f"<text {place}>{escape(text)}</text>"
        return ""

    def _ticks_of_y(self, y: Scale) -> Generator[str, None, str]:
        values, texts = y.ticks(_TICK_Y)
        at = y(np.array(values))
        for v, text in zip(at, texts, strict=True):
            yield f'<text x="-6" y="{v + 4:.1f}" class="y">{text}</text>'
        return "".join(f"M0 {v:.1f}H{self.inner[0]:.1f}" for v in at)


def _equal(x: Scale, y: Scale) -> tuple[Scale, Scale]:
    """The scales with the same number of pixels per unit; the smaller one is widened around its middle."""
    unit = min(x.length / (x.high - x.low), y.length / (y.high - y.low))
    made = []
    for scale in (x, y):
        half, middle = 0.5 * scale.length / unit, 0.5 * (scale.low + scale.high)
        made.append(replace(scale, low=middle - half, high=middle + half))
    return made[0], made[1]


def _arranged(marks: Sequence[Series | Bars]) -> Iterator[tuple[Series | Bars, float, float]]:
    """Yields marks, with position and thickness of adjacent bars in shares of a category."""
    bars = [mark for mark in marks if isinstance(mark, Bars)]
    thick = 0.75 / max(len(bars), 1)
    for mark in marks:
        k = next((k for k, bar in enumerate(bars) if bar is mark), 0)
        yield mark, thick * (k - 0.5 * len(bars)), thick


def _bars(bars: Bars, x: Scale, y: Scale, offset: float, thick: float) -> Iterator[str]:
    zero, length = float(x(0.0)), abs(float(y(1.0) - y(0.0)))
    for k, value in enumerate(np.asarray(bars.values, dtype=float)):
        if np.isfinite(value):
            top, wide = float(y(float(k))) + offset * length, float(x(value)) - zero
            shape = f'x="{zero:.1f}" y="{top:.1f}" width="{wide:.1f}" height="{0.92 * thick * length:.1f}"'
            text = f"<title>{escape(bars.name)}: {value:.3g}</title>"
            yield f'<rect {shape} style="fill:var(--{bars.colour})">{text}</rect>'


def _guide(guide: Guide, x: Scale, y: Scale) -> str:
    scale = x if guide.of == "x" else y
    begin = float(scale(guide.begin))
    if guide.end is None:
        way = f"M{begin:.1f} 0V{y.length:.1f}" if guide.of == "x" else f"M0 {begin:.1f}H{x.length:.1f}"
        return f'<path class="guide" d="{way}" style="stroke:var(--{guide.colour})"/>'
    low, high = sorted((begin, float(scale(guide.end))))
    sides = (low, 0.0, high - low, y.length) if guide.of == "x" else (0.0, low, x.length, high - low)
    left, top, wide, tall = (f"{v:.1f}" for v in sides)
    shape = f'x="{left}" y="{top}" width="{wide}" height="{tall}"'
    return f'<rect class="shade" {shape} style="fill:var(--{guide.colour})"/>'


def _series(series: Series, x: Scale, y: Scale) -> Iterator[str]:
    if series.hidden:
        return
    px, py = (scale(values) for scale, values in zip((x, y), series.path(), strict=True))
    colour = f"var(--{series.colour})"
    if series.fill == "zero":
        base = float(np.clip(y(y.low if y.log else 0.0), 0.0, y.length))
        area = _way(np.concatenate([px[:1], px, px[-1:]]), np.concatenate([[base], py, [base]]))
        yield f'<path class="area" d="{area}" style="fill:{colour}"/>'
    elif series.fill:
        yield f'<path class="area" d="{_way(px, py)}" style="fill:{colour}"/>'
    if series.width:
        dash = ";stroke-dasharray:6 4" if series.dashed else ""
        yield f'<path class="c" d="{_way(px, py)}" style="stroke:{colour};stroke-width:{series.width:g}{dash}"/>'
    yield from _error_bars(series, x, y, colour)
    if series.marker:
        yield from _markers(series, x(series.x), y(series.y), colour)


def _error_bars(series: Series, x: Scale, y: Scale, colour: str) -> Iterator[str]:
    way = ""
    if series.x_range is not None:
        low, high, at = x(series.x_range[0]), x(series.x_range[1]), y(series.y)
        way += "".join(f"M{a:.1f} {v:.1f}H{b:.1f}" for a, b, v in zip(low, high, at, strict=True))
    if series.y_range is not None:
        low, high, at = y(series.y_range[0]), y(series.y_range[1]), x(series.x)
        way += "".join(f"M{v:.1f} {a:.1f}V{b:.1f}" for a, b, v in zip(low, high, at, strict=True))
    if way:
        yield f'<path class="c" d="{way}" style="stroke:{colour};stroke-width:1.4"/>'


def _markers(series: Series, px: Array, py: Array, colour: str) -> Iterator[str]:
    sizes = np.broadcast_to(np.asarray(series.size, dtype=float), px.shape)
    for a, b, size in zip(px, py, sizes, strict=True):
        if not (np.isfinite(a) and np.isfinite(b)):
            continue
        if series.marker in ("dot", "ring"):
            ink = f"fill:{colour};fill-opacity:.8" if series.marker == "dot" else f"fill:none;stroke:{colour}"
            yield f'<circle cx="{a:.1f}" cy="{b:.1f}" r="{0.5 * size:.1f}" style="{ink};stroke-width:2"/>'
        else:
            way = _SHAPES[series.marker].format(r=f"{0.6 * size:.1f}")
            ink = f"fill:none;stroke:{colour};stroke-width:2"
            yield f'<path d="{way}" transform="translate({a:.1f} {b:.1f})" style="{ink}"/>'


def _labels(series: Series, x: Scale, y: Scale) -> Iterator[str]:
    """Yields texts at points, above those in the upper half, below the others."""
    sizes = np.broadcast_to(np.asarray(series.size, dtype=float), np.shape(series.x))
    for a, b, size, text in zip(x(series.x), y(series.y), sizes, series.labels, strict=True):
        down = 0.5 * size + 13.0 if b > 0.5 * y.length else -0.5 * size - 5.0
        yield f'<text x="{a:.1f}" y="{b + down:.1f}" class="x">{escape(text)}</text>'


def _way(px: Array, py: Array) -> str:
    """A path through the points, interrupted at missing ones."""
    parts, pen = [], "M"
    for a, b in zip(px.tolist(), py.tolist(), strict=True):
        if a == a and b == b:
            parts.append(f"{pen}{a:.1f} {b:.1f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(parts)
