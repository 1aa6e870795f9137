"""Detects departures in a fleet: stretches of a robot's logs whose level differs from the rest by more than chance.

A quantity v_i of a robot with standard deviation s_i, i = 1 ... n in time, has one level if the robot does not change.
A replaced battery gives a stretch up to the end, a lidar carried for a day a stretch in between, a faulty log a stretch
of one. Every stretch of successive logs is compared with the others (circular binary segmentation, Olshen et al. 2004),

    z = (mean inside - mean outside) / √(1/W_in + 1/W_out),      weights 1/s²,  W their sums

The most significant one is tested, and the stretches on both sides are searched in turn. Two test statistics are used,
since an error bar includes errors common to all logs of a robot (3 % of all torques, say), which cancel between them:

    bars      z / max(1, κ), normal: the bars as stated, or wider if the logs scatter more
    scatter   z / κ, Student's t with 0.45 (n - 1) degrees of freedom: the logs' own scatter

κ² is the trimmed mean of (v_i+1 - v_i)² / (s_i² + s_i+1²), without the largest tenth and at least two of them, so that
departures do not mask themselves; it is scaled to 1 for normal errors of the stated size. It needs six logs or more;
with fewer only the bars are used. 0.45 (n - 1) is slightly below its effective degrees of freedom under normal errors,
from simulation. Each statistic of each stretch of each series is one look. A third of `chance` is assigned to stretches
that last to the end, a third to single logs and a third to all others, which are many: p is multiplied by three times
the number of looks of its kind in the fleet (weighted Bonferroni). So the probability of any report from an unchanged
fleet is at most `chance`, and much less if the bars hold, because stretches overlap.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import ceil
from typing import Any, ClassVar, Literal

import numpy as np
from scipy.special import chdtr, chdtri, ndtr, stdtr

from stadera.constants import EPOCH
from stadera.fleet.table import FleetTable
from stadera.types import Array

LogRow = Mapping[str, Any]

TRUNK: Mapping[str, tuple[str, str, float]] = {
    "trunk_mass": ("trunk mass", "kg", 1.0),
    "com_x": ("centre of mass x", "mm", 1e3),
    "com_y": ("centre of mass y", "mm", 1e3),
    "com_z": ("centre of mass z", "mm", 1e3),
    "payload_mass": ("payload", "kg", 1.0),
}
"""By column: title, displayed unit, and factor from the column's unit to it."""
JOINT: Mapping[str, tuple[str, str, float]] = {
    "armature": ("rotor inertia", "kg·m²", 1.0),
    "viscous": ("viscous friction", "N·m·s/rad", 1.0),
    "coulomb": ("Coulomb friction", "N·m", 1.0),
    "offset": ("torque offset", "N·m", 1.0),
}


@dataclass(frozen=True, eq=False)
class FleetSeries:
    """One quantity of one robot over its logs, in order of time: values and standard deviations (logs,), in `unit`; the
    joint, None for the trunk's quantities, with which the title of its parameter begins; the rows of the table, and
    which of the robot's logs they are, counted from 1.
    """

    robot: str
    title: str
    unit: str
    joint: str | None
    value: Array
    std: Array
    rows: tuple[LogRow, ...]
    numbers: Array


def by_robot(rows: Sequence[LogRow]) -> dict[str, list[LogRow]]:
    """Rows by robot, robots by name, each robot's in order of time; rows of an unknown robot under "unknown"."""
    robots: dict[str, list[LogRow]] = {}
    for row in sorted(rows, key=lambda row: str(row["robot"] or "unknown")):
        robots.setdefault(row["robot"] or "unknown", []).append(row)
    return {name: _in_time(own) for name, own in robots.items()}


def when(row: LogRow) -> str:
    """Time of a log if it is stamped with the time of day; else empty."""
    begin = row["begin"]
    if begin is None or begin < EPOCH:
        return ""
    return datetime.fromtimestamp(begin, UTC).strftime("%Y-%m-%d %H:%M")


def series_of(table: FleetTable) -> Iterator[FleetSeries]:
    """Yields every quantity observed in at least one log: the trunk's, then the joints', robot by robot.

    Logs whose result cannot be trusted are excluded.
    """
    joints: dict[tuple[str, str, str], dict[str, LogRow]] = {}
    for entry in table.joints:
        key = (entry["robot"] or "unknown", entry["joint"], entry["parameter"])
        joints.setdefault(key, {})[entry["log"]] = entry
    for robot, rows in by_robot(table.rows).items():
        for column, (title, unit, factor) in TRUNK.items():
            pairs = [(k, row, row[column], row[f"{column}_std"]) for k, row in enumerate(rows, 1)]
            yield from _series(robot, title, unit, None, factor, pairs)
        for (owner, joint, parameter), entries in joints.items():
            if owner == robot and parameter in JOINT:
                title, unit, factor = JOINT[parameter]
                found = [(k, row, entries[row["log"]]) for k, row in enumerate(rows, 1) if row["log"] in entries]
                pairs = [(k, row, entry["value"], entry["std"]) for k, row, entry in found]
                yield from _series(robot, f"{joint} {title}", unit, joint, factor, pairs)


def _series(
    robot: str, title: str, unit: str, joint: str | None, factor: float, pairs: Sequence[tuple[int, LogRow, Any, Any]]
) -> Iterator[FleetSeries]:
    """Yields a series of the observed values; nothing if there are none."""
    good = (p for p in pairs if p[1]["trust"] != "bad" and p[2] is not None and p[3])
    seen = [(k, row, factor * value, factor * std) for k, row, value, std in good]
    if seen:
        numbers, rows, value, std = zip(*seen, strict=True)
        yield FleetSeries(robot, title, unit, joint, np.array(value), np.array(std), rows, np.array(numbers))


def _in_time(rows: Sequence[LogRow]) -> list[LogRow]:
    """Sorts by stamps if all count from 1970; otherwise keeps the order, since times that start at zero do not define
    one.
    """
    stamps = [row["begin"] for row in rows if row["begin"] is not None]
    if not stamps or min(stamps) < EPOCH:
        return list(rows)
    last = max(stamps)
    return sorted(rows, key=lambda row: last if row["begin"] is None else row["begin"])


_STATISTICS = ("bars", "scatter")

Kind = Literal["since", "once", "while"]
"""Kind of a stretch: to the end; one log; several logs."""


@dataclass(frozen=True, eq=False)
class Departure:
    """A stretch of logs, the first to the last of a series, that departs from the others."""

    USUAL: ClassVar = 0.01  # probability of any report from an unchanged fleet

    series: FleetSeries
    first: int
    last: int
    change: float  # of the level relative to the other logs of the searched stretch [unit of the series]
    std: float  # of the change, from the logs' scatter or the bars, depending on the statistic used [same]
    bars: float  # change divided by its standard deviation according to the stated bars alone [1]
    chance: float  # probability of a departure of this size anywhere in an unchanged fleet

    @property
    def kind(self) -> Kind:
        """Kind of the stretch: lasting to the end, a single log, or several."""
        if self.last == len(self.series.value) - 1:
            return "since"
        return "once" if self.first == self.last else "while"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
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


def departures(fleet: Sequence[FleetSeries], chance: float = Departure.USUAL) -> list[Departure]:
    """Detects departures in all series, the most significant first; `chance` is the probability of any report from an
    unchanged fleet.
    """
    counts = [_stretches(len(series.value)) for series in fleet]
    looks: dict[Kind, int] = {kind: sum(count[kind] for count in counts) for kind in _stretches(0)}
    found = (departure for series in fleet for departure in _searched(series, looks, chance))
    return sorted(found, key=lambda departure: departure.chance)


def looks_at(fleet: Sequence[FleetSeries]) -> int:
    """Number of comparisons in total, with both statistics."""
    return len(_STATISTICS) * sum(map(sum, (_stretches(len(series.value)).values() for series in fleet)))


def scatter(series: FleetSeries, fewest: int = 6, trimmed: float = 0.1, least: float = 1e-3) -> float:
    """κ: scatter of the logs in units of their bars [1], at least `least`, since logs that agree better are copies; NaN
    for fewer logs than `fewest`. The share `trimmed` of the differences of successive logs is left out.
    """
    value, std = series.value, series.std
    if len(value) < fewest:
        return np.nan
    squares = np.sort(np.diff(value) ** 2 / (std[1:] ** 2 + std[:-1] ** 2))
    kept = len(squares) - max(2, ceil(trimmed * len(squares)))
    share = kept / len(squares)
    usual = chdtr(3, chdtri(1, 1.0 - share)) / share  # mean of the smallest such share of squared normal numbers
    return max(float(np.sqrt(squares[:kept].mean() / usual)), least)


def _stretches(count: int) -> dict[Kind, int]:
    """Number of stretches by kind. One from the beginning is complementary to one to the end, so it is not counted."""
    tails, single = max(count - 1, 0), max(count - 2, 0)
    return {"since": tails, "once": single, "while": count * (count - 1) // 2 - tails - single}


def _searched(
    series: FleetSeries, looks: Mapping[Kind, int], chance: float, worth: float = 0.45
) -> Iterator[Departure]:
    """`worth`: degrees of freedom of κ² for each difference, from simulation of normal errors [1]."""
    kappa, freedom = scatter(series), worth * (len(series.value) - 1)
    wide = float(np.fmax(1.0, kappa))
    waiting = [(0, len(series.value))]
    while waiting:
        begin, end = waiting.pop()
        surest: tuple[float, Departure] | None = None
        for kind, (first, stop, change, std) in _largest(series.value[begin:end], series.std[begin:end]).items():
            z = abs(change) / std
            by_bars, by_scatter = 2.0 * ndtr(-z / wide), 2.0 * stdtr(freedom, -z / kappa)
            p = len(looks) * len(_STATISTICS) * looks[kind] * float(np.fmin(by_bars, by_scatter))
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
