"""Weighing without stopping: robots crawl, trot and sway, loads come on on the way, all methods on the same runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from stadera.experiments.grid import Outcome, run_grid
from stadera.experiments.motion import Gait
from stadera.experiments.result import (
    Cell,
    Experiment,
    ExperimentResult,
    Progress,
    Record,
    ReproduceSettings,
    TableData,
)
from stadera.experiments.walking_runs import PLACES, WALKING, WalkingCase, weigh_in_motion

NAME = "walking"

ROBOTS = ("hyq", "go2", "anymal_c", "b1")
GAITS: tuple[Gait, ...] = ("crawl", "trot", "shake")
SHARES = (0.05, 0.10, 0.25)
SEEDS = 5
OTHERS: tuple[str, ...] = ("contact", "rls", "kalman")

_WALKS = ("crawl", "trot")
_HARSHER = 3.0  # how much more `harsh` may cost than `standard`
_HEAVY = 0.10  # share from which a payload's place is judged
_NAMES = {
    WALKING: "walking",
    "contact": "(c) contact forces",
    "rls": "recursive least squares",
    "kalman": "Kalman filter, m and m c",
}
_LEAD = (
    "Robots crawl, trot, or stand and sway, under their own controllers, in MuJoCo at 1 kHz. Without a stop a load "
    "comes onto their backs, 5 to 25 % of their mass, at one of five places; nobody says when but for the tare, which "
    "is the last instant before. Every method gets the same measurements. The controllers walk by the walking "
    "estimator's estimate as soon as it can be trusted."
)
_NOTES = (
    "A method without a figure gave no estimate: (c) asks for a robot that stands still.",
    "Payload and shift are differences to the tare, 1 s after the load. Heights are the loaded trunk's, after 3 s.",
    "The normalised error squared (NEES) is of the loaded trunk's mass and centre of mass, absolute, so with the "
    "constant errors of the sensors in it; divided by how many of the four were observed. It is about 1 where error "
    "bars are right.",
)


@dataclass(frozen=True)
class Quantity:
    """A figure of the study.

    Attributes:
        title, unit: as printed.
        of: from a method's figures and the run to the size of the error, None where there is none.
        median, high: bounds of median and 95th percentile under `standard`; None for none.
        least_share: of the load, for it to count.
    """

    title: str
    unit: str
    of: Callable[[Mapping[str, Any], Mapping[str, Any]], float | None]
    median: float | None = None
    high: float | None = None
    least_share: float = 0.0


def _scaled(key: str, scale: float) -> Callable[[Mapping[str, Any], Mapping[str, Any]], float | None]:
    def of(figures: Mapping[str, Any], run: Mapping[str, Any]) -> float | None:
        value = figures.get(key)
        return None if value is None else scale * abs(value)

    return of


def _mass(figures: Mapping[str, Any], run: Mapping[str, Any]) -> float | None:
    value = figures.get("soon.payload_mass")
    return None if value is None else 100.0 * abs(value) / float(run["robot_mass"])


QUANTITIES = (
    Quantity("payload mass", "% of the robot's", _mass, 0.2, 0.6),
    Quantity("shift of the trunk's CoM, x-y", "mm", _scaled("soon.shift_xy", 1e3), 1.5, 4.0),
    Quantity("payload's CoM, x-y", "mm", _scaled("soon.payload_xy", 1e3), 5.0, None, _HEAVY),
    Quantity("trunk's CoM, z, after 3 s", "mm", _scaled("late.com_z", 1e3), None, 10.0),
)


def cases(settings: ReproduceSettings) -> list[WalkingCase]:
    """The grid; a small corner of it for a first look."""
    if settings.quick:
        return [
            WalkingCase(robot, "trot", 0.10, "left hind", "standard", settings.seed, OTHERS) for robot in ROBOTS[:2]
        ]
    return [
        WalkingCase(robot, gait, share, place, errors, settings.seed + k, OTHERS)
        for k in range(settings.seeds or SEEDS)
        for errors in ("standard", "harsh")
        for robot in ROBOTS
        for gait in GAITS
        for share in SHARES
        for place in PLACES
    ]


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """The whole grid, over the processor's cores; runs kept in `settings.keep` are not done again."""
    grid = cases(settings)
    runs = run_grid(NAME, weigh_in_motion, grid, progress, settings.keep)
    return summary(grid, runs)


def summary(grid: Sequence[WalkingCase], runs: Sequence[Outcome]) -> ExperimentResult:
    """What any part of the grid shows."""
    pairs = list(zip(grid, runs, strict=True))
    groups: dict[tuple[str, str], _Pairs] = {
        (errors, gait): chosen
        for errors in ("standard", "harsh")
        for gait in GAITS
        if (chosen := [(c, r) for c, r in pairs if (c.errors, c.gait) == (errors, gait)])
    }
    records = [record for (errors, gait), chosen in groups.items() for record in _records(errors, gait, chosen)]
    return ExperimentResult(
        name=NAME,
        title="Weighing without stopping",
        lead=_LEAD,
        records=tuple(records),
        tables=(_table(groups), _by_robot(pairs), _behaviour(groups)),
        notes=_NOTES,
        facts={
            "Runs": f"{len(pairs)}",
            "Robots": ", ".join(dict.fromkeys(c.robot for c, _ in pairs)),
            "Plant": "MuJoCo, 1 kHz, controllers in the loop",
        },
    )


_Pairs = Sequence[tuple[WalkingCase, Outcome]]


def _values(quantity: Quantity, pairs: _Pairs, method: str) -> list[float]:
    """Sizes of the errors over the runs that have one and did not fall before."""
    found = []
    for case, outcome in pairs:
        figures = outcome["methods"].get(method, {})
        if case.share >= quantity.least_share and (value := quantity.of(figures, outcome)) is not None:
            found.append(float(value))
    return found


def _records(errors: str, gait: str, pairs: _Pairs) -> Iterator[Record]:
    wider = 1.0 if errors == "standard" else _HARSHER
    case: dict[str, str | float] = {"errors": errors, "gait": gait, "method": WALKING}
    judged = gait in _WALKS
    for q in QUANTITIES:
        values = _values(q, pairs, WALKING)
        if not values:
            continue
        median, high = (b * wider if b is not None and judged else None for b in (q.median, q.high))
        yield Record(NAME, case, f"{q.title}, median", q.unit, float(np.median(values)), bound=median)
        yield Record(NAME, case, f"{q.title}, 95th percentile", q.unit, float(np.percentile(values, 95)), bound=high)
        for other in OTHERS:
            theirs = _values(q, pairs, other)
            if theirs:
                beside = {**case, "method": other}
                yield Record(NAME, beside, f"{q.title}, median", q.unit, float(np.median(theirs)))
                yield Record(NAME, beside, f"{q.title}, 95th percentile", q.unit, float(np.percentile(theirs, 95)))
    yield from _calibration(case, errors, pairs)
    yield from _noticing(case, pairs)


def _calibration(case: Mapping[str, str | float], errors: str, pairs: _Pairs) -> Iterator[Record]:
    figures = [r["methods"][WALKING] for _, r in pairs if r["methods"][WALKING].get("loaded.nees") is not None]
    if not figures:
        return
    count = sum(f["loaded.observed"] for f in figures)
    nees = sum(f["loaded.nees"] for f in figures) / count
    low, high = chi2.ppf([0.025, 0.975], count) / count
    bounds = (float(low), float(high)) if errors == "standard" else (None, None)
    yield Record(NAME, case, "NEES / n, not more than chance makes it", "1", nees, bound=bounds[1])
    yield Record(NAME, case, "NEES / n, not less", "1", nees, bound=bounds[0], bound_is="at least")


def _noticing(case: Mapping[str, str | float], pairs: _Pairs) -> Iterator[Record]:
    stood = [(c, r) for c, r in pairs if r["fell"] is None]
    yield Record(NAME, case, "falls", "1", float(len(pairs) - len(stood)))
    noticed = [r["noticed"] for _, r in stood if r["noticed"] is not None]
    if stood:
        yield Record(NAME, case, "loads not noticed", "1", float(len(stood) - len(noticed)), bound=0.0)
    if noticed:
        yield Record(NAME, case, "load noticed after, longest", "s", float(max(noticed)), bound=0.2)
    yield Record(NAME, case, "false alarms", "1", float(sum(r["false_alarms"] for _, r in pairs)), bound=0.0)
    share = float(np.median([r["share_of_time"] for _, r in pairs]))
    yield Record(NAME, case, "estimator's time in the robot's, median", "1", share)


def _pair_cell(values: Sequence[float], median: float | None = None, high: float | None = None) -> Cell:
    if not values:
        return Cell("–")
    middle, most = float(np.median(values)), float(np.percentile(values, 95))
    kept = [v <= b for v, b in ((middle, median), (most, high)) if b is not None]
    return Cell(f"{middle:.2f}; {most:.2f}", strong=bool(kept), good=all(kept) if kept else None)


def _head(first: str) -> tuple[str, ...]:
    return (first, *(f"{q.title} [{q.unit}]" for q in QUANTITIES))


def _table(groups: Mapping[tuple[str, str], _Pairs]) -> TableData:
    rows = []
    for (errors, gait), pairs in groups.items():
        wider = 1.0 if errors == "standard" else _HARSHER
        lines = []
        for method in (WALKING, *OTHERS):
            own = method == WALKING and gait in _WALKS
            cells = (
                _pair_cell(
                    _values(q, pairs, method),
                    None if q.median is None or not own else q.median * wider,
                    None if q.high is None or not own else q.high * wider,
                )
                for q in QUANTITIES
            )
            lines.append((Cell(_NAMES.get(method, method)), *cells))
        rows.append((f"{gait}, {errors}", tuple(lines)))
    note = "Median; 95th percentile. Coloured where something was promised."
    return TableData("Errors of every method", _head("method"), tuple(rows), note)


def _by_robot(pairs: _Pairs) -> TableData:
    rows = []
    for errors in dict.fromkeys(c.errors for c, _ in pairs):
        lines = []
        for robot in dict.fromkeys(c.robot for c, _ in pairs):
            chosen = [(c, r) for c, r in pairs if (c.errors, c.robot) == (errors, robot)]
            lines.append((Cell(robot), *(_pair_cell(_values(q, chosen, WALKING)) for q in QUANTITIES)))
        rows.append((errors, tuple(lines)))
    return TableData("The walking estimator, by robot", _head("robot"), tuple(rows), "Median; 95th percentile.")


def _behaviour(groups: Mapping[tuple[str, str], _Pairs]) -> TableData:
    head = ("", "runs", "falls", "not noticed", "noticed after [s], longest", "false alarms", "NEES / n")
    rows = []
    for (errors, gait), pairs in groups.items():
        by = {
            record.metric: record.value for record in _records(errors, gait, pairs) if record.case["method"] == WALKING
        }
        texts = (
            f"{len(pairs)}",
            f"{by['falls']:.0f}",
            f"{by.get('loads not noticed', 0):.0f}",
            f"{by['load noticed after, longest']:.2f}" if "load noticed after, longest" in by else "–",
            f"{by['false alarms']:.0f}",
            f"{by['NEES / n, not less']:.2f}" if "NEES / n, not less" in by else "–",
        )
        rows.append((Cell(f"{gait}, {errors}"), *map(Cell, texts)))
    return TableData("Noticing, walking on, and error bars", head, (("", tuple(rows)),))


EXPERIMENT = Experiment(NAME, "Weighing without stopping, all methods on the same runs", run, study=True, seeded=True)
