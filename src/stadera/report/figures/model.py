"""Figures as plain values: panels of curves, bars and guides, independent of the library that draws them.

Colours are names of `stadera.report.look.COLOURS`, so that pages can be dark and papers white.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stadera.errors import StaderaError
from stadera.report.look import COLOURS
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class Series:
    """A curve, markers, or an area. StaderaError for x and y of different length, or an unknown colour."""

    x: Array  # (k,); NaN breaks a line
    y: Array  # (k,)
    name: str = ""  # in the legend; empty for none. Series of the same name share one entry and are toggled together.
    colour: str = "blue"  # of `COLOURS`
    width: float = 1.6  # of the line [px]; 0 for none
    dashed: bool = False  # whether the line is dashed
    # "hold" if y is constant until the next x, "bins" for bins around x; "" for straight lines
    stairs: Literal["", "hold", "bins"] = ""
    fill: Literal["", "self", "zero"] = ""  # "self" fills the outline, "zero" the area down to the axis
    dense: float = 0.18  # opacity of the area [1]
    marker: Literal["", "dot", "ring", "diamond", "plus", "cross"] = ""  # of the points
    size: float | Array = 7.0  # one size [px], or one for each point
    labels: tuple[str, ...] = ()  # a text at each point; empty for none
    hover: tuple[str, ...] = ()  # on pages, a text for the pointer at each point; empty for its value
    links: tuple[str, ...] = ()  # on pages, what a click on each point opens, empty for nothing
    x_range: tuple[Array, Array] | None = None  # ((k,), (k,)), lower and upper end of error bars
    y_range: tuple[Array, Array] | None = None  # likewise
    hidden: bool = False  # True to draw it only on request

    def __post_init__(self) -> None:
        if np.shape(self.x) != np.shape(self.y):
            raise StaderaError(f"curve {self.name!r}: x of shape {np.shape(self.x)}, y of {np.shape(self.y)}")
        _check_colour(self.colour)

    def path(self) -> tuple[Array, Array]:
        """The points of the line, stairs expanded, (n,) each."""
        x, y = np.asarray(self.x, dtype=float), np.asarray(self.y, dtype=float)
        if self.stairs == "bins" and len(x) > 1:
            middle = 0.5 * (x[1:] + x[:-1])
            edges = np.concatenate([[x[0] - (middle[0] - x[0])], middle, [x[-1] + (x[-1] - middle[-1])]])
            x, y = np.repeat(edges, 2)[1:-1], np.repeat(y, 2)
        elif self.stairs == "hold":
            x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
        return x, y


@dataclass(frozen=True, eq=False)
class Bars:
    """Horizontal bars, one for each category of the y axis (k,), NaN for none; several are drawn next to each other."""

    values: Array
    name: str
    colour: str = "blue"

    def __post_init__(self) -> None:
        _check_colour(self.colour)


@dataclass(frozen=True)
class Guide:
    """A line across the panel at `begin`, or with `end` a shaded range."""

    begin: float  # on the axis
    end: float | None = None  # None for a line
    of: Literal["x", "y"] = "x"  # the axis to which they refer
    colour: str = "orange"  # of `COLOURS`
    name: str = ""  # in the legend; empty for none

    def __post_init__(self) -> None:
        _check_colour(self.colour)


@dataclass(frozen=True)
class Axis:
    """One axis of a panel."""

    title: str = ""  # with its unit in square brackets
    log: bool = False  # whether the axis is logarithmic
    labels: tuple[str, ...] = ()  # categories at 0, 1, 2, ...; empty for a quantity
    limits: tuple[float, float] | None = None  # range shown; None for the range of the data
    zero: bool = False  # whether the range includes zero
    step: float | None = None  # between ticks; None for what suits the range

    def names(self, letters: int) -> list[str]:
        """The categories in at most so many letters."""
        return [text if len(text) <= letters else f"{text[: letters - 1]}…" for text in self.labels]


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes."""

    x: Axis
    y: Axis  # points downwards if it has categories
    marks: tuple[Series | Bars, ...]  # from the back to the front
    guides: tuple[Guide, ...] = ()  # behind the marks
    title: str = ""  # above it
    equal: bool = False  # whether x and y have the same scale


@dataclass(frozen=True, eq=False)
class Figure:
    """Panels in rows."""

    title: str  # above it, and its label for screen readers
    rows: tuple[tuple[Panel, ...], ...]  # panels next to each other, row by row
    note: str = ""  # how to read it
    row_height: float = 260.0  # of a panel [px]
    # whether all panels of a column share one x axis, with its title below the last
    shared: bool = field(default=False, kw_only=True)
    width: float = field(default=1120.0, kw_only=True)  # on a desk's page [px]

    @property
    def panels(self) -> tuple[Panel, ...]:
        """All panels, row by row."""
        return tuple(panel for row in self.rows for panel in row)

    @property
    def is_empty(self) -> bool:
        """True if there is nothing to draw."""
        return not any(panel.marks for panel in self.panels)

    @property
    def entries(self) -> dict[str, Series | Bars | Guide]:
        """Entries of the legend: the first mark with each name."""
        named: dict[str, Series | Bars | Guide] = {}
        for panel in self.panels:
            for mark in (*panel.marks, *panel.guides):
                if mark.name:
                    named.setdefault(mark.name, mark)
        return named


def stacked(title: str, panels: Sequence[Panel], note: str = "", height: float = 190.0) -> Figure:
    """Stacks panels over one x axis, whose title is below the last."""
    last = len(panels) - 1
    rows = tuple(
        (panel if k == last else replace(panel, x=replace(panel.x, title="")),) for k, panel in enumerate(panels)
    )
    return Figure(title, rows, note, height, shared=True)


def line(x: Array, y: Array, name: str, colour: str = "blue", **look: object) -> Series:
    """A curve, thinned to a plot's resolution, with a break where x jumps."""
    every = _every(len(x))
    x, y = (np.asarray(values, dtype=float)[every] for values in (x, y))
    jumps = _jumps(x)
    broken = np.insert(x, jumps, x[jumps - 1]), np.insert(y, jumps, np.nan)
    return Series(*broken, name, colour, **look)  # type: ignore[arg-type]


def band(x: Array, value: Array, std: Array, colour: str = "blue", name: str = "± 2 standard deviations") -> Series:
    """A band of two standard deviations around a value over x (k,), interrupted where either is NaN."""
    every = _every(len(x))
    x, value, std = (np.asarray(values, dtype=float)[every] for values in (x, value, std))
    return Series(*_outlines(x, value + 2.0 * std, value - 2.0 * std), name, colour, width=0.0, fill="self")


def _every(count: int, most: int = 1000) -> slice:
    """Thins `count` samples to at most `most`, about one for each pixel."""
    return slice(None, None, max(1, -(-count // most)))


def _jumps(x: Array, gap: float = 2.5) -> NDArray[np.intp]:
    """Indices where x continues after a gap, a step larger than `gap` usual ones."""
    steps = np.diff(x)
    usual = float(np.median(steps)) if len(steps) else 0.0
    return np.flatnonzero(steps > gap * usual) + 1 if usual > 0.0 else np.zeros(0, dtype=np.intp)


def _outlines(x: Array, high: Array, low: Array) -> tuple[Array, Array]:
    """Outlines of a band over x (k,), one for each stretch of known values without a jump of x, NaN in between."""
    known, jumps = np.isfinite(high) & np.isfinite(low), np.zeros(len(x) + 1, dtype=bool)
    jumps[_jumps(x)] = True
    starts = np.flatnonzero(known & (~np.concatenate([[False], known[:-1]]) | jumps[:-1]))
    stops = np.flatnonzero(known & (~np.concatenate([known[1:], [False]]) | jumps[1:])) + 1
    xs: list[Array] = []
    ys: list[Array] = []
    for a, b in zip(starts, stops, strict=True):
        xs += [x[a:b], x[a:b][::-1], np.array([np.nan])]
        ys += [high[a:b], low[a:b][::-1], np.array([np.nan])]
    return (np.concatenate(xs), np.concatenate(ys)) if xs else (np.zeros(0), np.zeros(0))


def _check_colour(name: str) -> None:
    if name not in COLOURS:
        raise StaderaError(f"no colour {name!r}; colours: {', '.join(COLOURS)}")
