"""Small SVG figures of a robot's quantity over its logs, with bars of two standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from markupsafe import Markup, escape

from stadera.fleet.departures import Departure
from stadera.fleet.series import FleetSeries, when
from stadera.report.numbers import number, with_std
from stadera.report.shown import SHOWN
from stadera.types import Array

_WIDTH, _HEIGHT = 380, 150  # of the drawing, in its own units
_LEFT, _RIGHT, _TOP, _BOTTOM = 58, 8, 8, 20


def figure(series: FleetSeries, found: Sequence[Departure], named: bool = True) -> Markup:
    """Values over the logs in order, with bars of two standard deviations, levels, and departures in another colour.

    Args:
        found: departures in this series.
        named: whether each point has a tooltip with its log.
    """
    count = len(series.value)
    low, high = _range(series)
    x = _LEFT + (np.arange(count) + 0.5) * (_WIDTH - _LEFT - _RIGHT) / count
    y, bar = (
        _height(series.value, low, high),
        _height(np.stack([series.value - 2 * series.std, series.value + 2 * series.std]), low, high),
    )
    out = np.zeros(count, dtype=bool)
    for departure in found:
        out[departure.first : departure.last + 1] = departure.kind != "since"
    doubtful = np.array([row["trust"] == "doubtful" for row in series.rows])
    parts = [
        _axis(series, low, high),
        Markup('<path class="bar" d="{}"/>').format(_bars(x, bar)),
    ]
    if named and count <= SHOWN.named:
        parts += [_point(series, k, x[k], y[k], out[k], doubtful[k]) for k in range(count)]
    else:
        for css, chosen in (("pt", ~out & ~doubtful), ("pt weak", ~out & doubtful), ("pt out", out)):
            parts.append(Markup('<path class="{} many" d="{}"/>').format(css, _dots(x[chosen], y[chosen])))
    parts.append(Markup('<path class="level" d="{}"/>').format(_levels(series, found, x, low, high)))
    title = f"{series.title} [{series.unit}] of {series.robot} over {count} logs"
    return Markup('<svg viewBox="0 0 {} {}" role="img" aria-label="{}">{}</svg>').format(
        _WIDTH, _HEIGHT, title, Markup("").join(parts)
    )


def _range(series: FleetSeries) -> tuple[float, float]:
    """Range of all values with their bars, truncated if some bars are far longer than the rest."""
    usual = 3.0 * float(np.median(series.std))
    reach = np.minimum(2.0 * series.std, usual)
    low, high = float((series.value - reach).min()), float((series.value + reach).max())
    return low, high if high > low else low + 1.0


def _height(value: Array | np.float64, low: float, high: float) -> Array:
    inside = _HEIGHT - _TOP - _BOTTOM
    return np.clip(_TOP + inside * (high - value) / (high - low), 0.0, _HEIGHT - _BOTTOM + 4.0)


def _axis(series: FleetSeries, low: float, high: float) -> Markup:
    """Least and largest value at the left, first and last time below."""
    step = 0.15 * (high - low)
    texts = [
        (f"{number(v, 3)}", _LEFT - 6, float(_height(np.array(v), low, high)) + 4, "end")
        for v in (low + step, high - step)
    ]
    first, last = when(series.rows[0]) or "first log", when(series.rows[-1]) or "last"
    texts += [(first[:10], _LEFT, _HEIGHT - 4, "start"), (last[:10], _WIDTH - _RIGHT, _HEIGHT - 4, "end")]
    lines = Markup('<path class="axis" d="M{0} {1}V{2}H{3}"/>').format(
        _LEFT, _TOP, _HEIGHT - _BOTTOM + 4, _WIDTH - _RIGHT
    )
    return lines + Markup("").join(
        Markup('<text x="{}" y="{:.0f}" text-anchor="{}">{}</text>').format(x, y, side, text)
        for text, x, y, side in texts
    )


def _bars(x: Array, bar: Array) -> str:
    return "".join(f"M{a:.1f} {b:.1f}V{c:.1f}" for a, b, c in zip(x, bar[0], bar[1], strict=True))


def _dots(x: Array, y: Array) -> str:
    return "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x, y, strict=True))


def _levels(series: FleetSeries, found: Sequence[Departure], x: Array, low: float, high: float) -> str:
    """A line at the mean of each stretch between departures."""
    count = len(series.value)
    edges = sorted({0, count, *(d.first for d in found), *(d.last + 1 for d in found)})
    half, out = 0.5 * (_WIDTH - _LEFT - _RIGHT) / count, []
    for begin, end in pairwise(edges):
        mean = np.average(series.value[begin:end], weights=series.std[begin:end] ** -2)
        out.append(f"M{x[begin] - half:.1f} {float(_height(mean, low, high)):.1f}H{x[end - 1] + half:.1f}")
    return "".join(out)


def _point(series: FleetSeries, k: int, x: float, y: float, out: bool, doubtful: bool) -> Markup:
    row = series.rows[k]
    name = str(row["log"]).rpartition("/")[2]
    said = f"{when(row)} {name}: {with_std(series.value[k], series.std[k])} {series.unit}, {row['trust']}".strip()
    css = "pt out" if out else "pt weak" if doubtful else "pt"
    return Markup('<circle class="{}" cx="{:.1f}" cy="{:.1f}" r="3"><title>{}</title></circle>').format(
        css, x, y, escape(said)
    )
