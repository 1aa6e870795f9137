"""Maps the values of an axis to pixels, and chooses its ticks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np

from stadera.report.figures.model import Axis, Bars, Panel
from stadera.report.numbers import number
from stadera.types import Array

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_ROOM = 0.05  # of the span, around the data


@dataclass(frozen=True)
class Scale:
    """Maps a range of values to a length."""

    low: float  # of the values; positive where `log`
    high: float  # likewise
    length: float  # [px]
    log: bool = False  # whether the scale is logarithmic
    flipped: bool = False  # whether values increase against the pixels, as for y

    def __call__(self, values: Array | float) -> Array:
        """Pixels from the beginning of the scale, NaN for NaN."""
        ends = np.array([self.low, self.high])
        values = np.asarray(values, dtype=float)
        if self.log:
            ends, values = np.log10(ends), np.log10(np.where(values > 0.0, values, np.nan))
        share = (values - ends[0]) / (ends[1] - ends[0])
        return np.asarray(self.length * (1.0 - share if self.flipped else share))

    def ticks(self, apart: float) -> tuple[list[float], list[str]]:
        """Round values at least `apart` px from each other, and their labels."""
        if self.log:
            return _decades(self.low, self.high, max(self.length / apart, 1.0))
        rough = (self.high - self.low) / max(self.length / apart, 1.0)
        power = 10.0 ** floor(log10(rough))
        step = power * next(s for s in _STEPS if s * power >= 0.999 * rough)
        first = ceil(self.low / step - 1e-9)
        values = [k * step for k in range(first, floor(self.high / step + 1e-9) + 1)]
        decimals = max(0, -floor(log10(step) + 1e-9) + (1 if round(step / power, 1) == 2.5 else 0))
        return values, [_text(value, decimals) for value in values]


def _decades(low: float, high: float, most: float) -> tuple[list[float], list[str]]:
    powers = range(floor(log10(low)), ceil(log10(high)) + 1)
    factors = (1, 2, 5) if 3 * len(powers) <= most else (1,)
    every = max(1, ceil(len(powers) / most))
    values = [f * 10.0**p for p in powers[::every] for f in factors]
    values = [value for value in values if low <= value * (1 + 1e-9) and value <= high * (1 + 1e-9)]
    return values, [number(value, 1, "") if value < 1.0 else f"{value:g}" for value in values]


def _text(value: float, decimals: int) -> str:
    if decimals > 4 or abs(value) >= 1e5:
        return number(value, 3)
    return f"{value:.{decimals}f}".replace("-", "−").replace("−0", "−0") if abs(value) > 1e-12 else "0"


def scale_of(axis: Axis, panel: Panel, of: str, length: float) -> Scale:
    """The scale that shows all data of a panel along one axis ("x" or "y")."""
    flipped = of == "y" and not axis.labels
    if axis.labels:
        return Scale(-0.5, len(axis.labels) - 0.5, length, flipped=flipped)
    if axis.limits is not None:
        return Scale(*axis.limits, length, axis.log, flipped)
    low, high = _extent(panel, of, axis.log)
    if axis.log:
        return Scale(low / 1.3, high * 1.3, length, True, flipped)
    if axis.zero:
        low, high = min(low, 0.0), max(high, 0.0)
    room = _room(low, high, _ROOM if of == "y" else 0.0)
    return Scale(low if axis.zero and low == 0.0 else low - room, high + room, length, flipped=flipped)


def _room(low: float, high: float, share: float) -> float:
    """Space around the data: a share of their extent, or a range around a single value."""
    return share * (high - low) if high > low else 0.5 * abs(high) or 0.5


def _extent(panel: Panel, of: str, log: bool) -> tuple[float, float]:
    found = [np.ravel(values) for values in _values(panel, of)]
    values = np.concatenate(found) if found else np.zeros(0)
    values = values[np.isfinite(values) & ((values > 0.0) | (not log))]
    return (float(values.min()), float(values.max())) if len(values) else (0.1, 1.0)


def _values(panel: Panel, of: str) -> Iterator[Array]:
    for mark in panel.marks:
        if isinstance(mark, Bars):
            yield np.asarray(mark.values, dtype=float) if of == "x" else np.zeros(0)
            continue
        if mark.hidden:
            continue
        yield mark.path()[0 if of == "x" else 1]
        if mark.fill == "zero" and of == "y":
            yield np.zeros(1)
        spread = mark.x_range if of == "x" else mark.y_range
        yield from spread or ()
