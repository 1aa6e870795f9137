"""What stands out in a fleet: stretches of a robot's logs whose level differs from the rest by more than chance.

A robot's quantity v_i with standard deviation s_i, i = 1 ... n in time, has one level if nothing happens to the robot.
A battery changed is a stretch up to the end, a lidar on for a day a stretch in between, a faulty log a stretch of one.
Every stretch of successive logs is compared with the others (circular binary segmentation, Olshen et al. 2004),

    z = (mean inside - mean outside) / √(1/W_in + 1/W_out),      weights 1/s²,  W their sums

the surest is tested, and the stretches that it leaves are searched in turn. Two yardsticks are tried, for a bar
holds what all logs of a robot have in common (3 % of all torques, say), which cancels between them:

    bars      z / max(1, κ), normal: the bars as stated, or wider if the logs scatter more
    scatter   z / κ, Student's t with 0.45 (n - 1) degrees of freedom: the logs' own scatter

κ² is the trimmed mean of (v_i+1 - v_i)² / (s_i² + s_i+1²), the largest tenth and at least two left out, so that what
stands out does not hide itself; scaled to be 1 of normal errors that are as large as their bars. It is made of six logs
or more; of fewer the bars alone count. 0.45 (n - 1) is a little less than what it is worth under normal errors, by
simulation. Each yardstick is a look at each stretch of each series. A third of `chance` goes to stretches that last to
the end, a third to single logs and a third to all others, which are many: p is multiplied by three times the looks of
its kind in the fleet (weighted Bonferroni). So the probability that anything at all is reported of a fleet in which
nothing happened is at most `chance`; a fraction of that where the bars hold, for stretches overlap.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any, Literal

import numpy as np
from scipy.stats import chi2, norm, t

from stadera.fleet.series import FleetSeries
from stadera.types import Array

_FEWEST = 6  # logs that have a scatter
_LEFT_OUT = 0.1  # of the differences of successive logs
_WORTH = 0.45  # degrees of freedom of κ² for each of them
_LEAST_SCATTER = 1e-3  # of the bars; logs that agree better are copies
_YARDSTICKS = 2

Kind = Literal["since", "once", "while"]
"""Of a stretch: to the end; one log; several logs."""


@dataclass(frozen=True, eq=False)
class Departure:
    """A stretch of logs that stands out.

    Attributes:
        series: in which.
        first, last: indices of its logs.
        change: of the level, against the other logs of the stretch that was searched [unit of the series].
        std: of the change, by the logs' scatter or the bars, whichever was the yardstick [same].
        bars: change over what the stated bars alone would allow [1].
        chance: probability, in the whole fleet, of something as large where nothing happened.
    """

    series: FleetSeries
    first: int
    last: int
    change: float
    std: float
    bars: float
    chance: float

    @property
    def kind(self) -> Kind:
        """Whether it lasts to the end, is of one log in between, or of several."""
        if self.last == len(self.series.value) - 1:
            return "since"
        return "once" if self.first == self.last else "while"

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        rows, series = self.series.rows, self.series
        return {
            "robot": series.robot,
            "quantity": series.title,
            "unit": series.unit,
            "kind": self.kind,
            "first_log": rows[self.first]["log"],
            "last_log": rows[self.last]["log"],
            "change": self.change,
            "std": self.std,
            "bars": self.bars,
            "chance": self.chance,
        }


def departures(fleet: Sequence[FleetSeries], chance: float = 0.01) -> list[Departure]:
    """What stands out, the surest first.

    Args:
        fleet: every series that is looked at.
        chance: that anything is reported where nothing happened.
    """
    counts = [_stretches(len(series.value)) for series in fleet]
    looks: dict[Kind, int] = {kind: sum(count[kind] for count in counts) for kind in _stretches(0)}
    found = (departure for series in fleet for departure in _searched(series, looks, chance))
    return sorted(found, key=lambda departure: departure.chance)


def looks_at(fleet: Sequence[FleetSeries]) -> int:
    """How many stretches are compared in all, by both yardsticks."""
    return _YARDSTICKS * sum(map(sum, (_stretches(len(series.value)).values() for series in fleet)))


def scatter(series: FleetSeries) -> float:
    """κ: how much the logs scatter, in units of their bars; NaN of too few logs."""
    value, std = series.value, series.std
    if len(value) < _FEWEST:
        return np.nan
    squares = np.sort(np.diff(value) ** 2 / (std[1:] ** 2 + std[:-1] ** 2))
    kept = len(squares) - max(2, ceil(_LEFT_OUT * len(squares)))
    share = kept / len(squares)
    usual = chi2.cdf(chi2.ppf(share, 1), 3) / share  # mean of the smallest such share of squared normal numbers
    return max(float(np.sqrt(squares[:kept].mean() / usual)), _LEAST_SCATTER)


def _stretches(count: int) -> dict[Kind, int]:
    """How many there are in so many logs, by kind. One from the beginning is the same as the rest, which is counted."""
    tails, single = max(count - 1, 0), max(count - 2, 0)
    return {"since": tails, "once": single, "while": count * (count - 1) // 2 - tails - single}


def _searched(series: FleetSeries, looks: Mapping[Kind, int], chance: float) -> Iterator[Departure]:
    kappa, freedom = scatter(series), _WORTH * (len(series.value) - 1)
    wide = float(np.fmax(1.0, kappa))
    waiting = [(0, len(series.value))]
    while waiting:
        begin, end = waiting.pop()
        surest: tuple[float, Departure] | None = None
        for kind, (first, stop, change, std) in _largest(series.value[begin:end], series.std[begin:end]).items():
            z = abs(change) / std
            by_bars, by_scatter = 2.0 * norm.sf(z / wide), 2.0 * t.sf(z / kappa, freedom)
            p = len(looks) * _YARDSTICKS * looks[kind] * float(np.fmin(by_bars, by_scatter))
            yardstick = kappa if by_scatter < by_bars else wide
            if p < (chance if surest is None else surest[0]):
                surest = p, Departure(series, begin + first, begin + stop - 1, change, yardstick * std, z, p)
        if surest is not None:
            found = surest[1]
            yield found
            waiting += [(begin, found.first), (found.first, found.last + 1), (found.last + 1, end)]


def _largest(value: Array, std: Array) -> dict[Kind, tuple[int, int, float, float]]:
    """The stretch of each kind with the largest z: [first, stop), its change, and the change's std by the bars."""
    weight, count = 1.0 / std**2, len(value)
    W, V = (
        np.concatenate([[0.0], np.cumsum(x)]) for x in (weight, weight * (value - value.mean() if count else value))
    )
    best: dict[Kind, tuple[float, tuple[int, int, float, float]]] = {}
    for first in range(1, count):
        inside, moment = W[first + 1 :] - W[first], V[first + 1 :] - V[first]
        outside = W[-1] - inside
        change, spread = moment / inside - (V[-1] - moment) / outside, np.sqrt(1.0 / inside + 1.0 / outside)
        z, last = np.abs(change) / spread, count - 1 - first
        places: dict[Kind, slice] = {
            "since": slice(last, None),
            "once": slice(0, min(1, last)),
            "while": slice(1, last),
        }
        for kind, place in places.items():
            if len(z[place]):
                k = int(np.argmax(z[place])) + (place.start or 0)
                if kind not in best or z[k] > best[kind][0]:
                    best[kind] = float(z[k]), (first, first + 1 + k, float(change[k]), float(spread[k]))
    return {kind: found for kind, (_, found) in best.items()}
