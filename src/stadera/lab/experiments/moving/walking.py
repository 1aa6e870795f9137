"""Study of weighing without stopping: robots crawl, trot and sway, loads are added, all methods use the same runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from stadera.lab.experiments.grid import Outcome, grouped, run_grid
from stadera.lab.experiments.moving.motion import Gait
from stadera.lab.experiments.moving.weighed import PLACES, WALKING, WalkingCase, weigh_in_motion
from stadera.lab.experiments.paper import Paper, ReproduceSettings
from stadera.lab.experiments.result import ExperimentResult, Record, spread
from stadera.report.table import Row, TableData
from stadera.types import Progress

PAPER = Paper.of("walking")

ROBOTS = ("hyq", "go2", "anymal_c", "b1")
GAITS: tuple[Gait, ...] = ("crawl", "trot", "shake")
ERRORS = ("standard", "harsh")
SHARES = (0.05, 0.10, 0.25)
SEEDS = 5
METHODS: Mapping[str, str] = {
    WALKING: "walking",
    "contact": "(c) contact forces",
    "rls": "recursive least squares",
    "kalman": "Kalman filter, m and m c",
}
OTHERS = tuple(name for name in METHODS if name != WALKING)

_BOUNDED = ("crawl", "trot")


@dataclass(frozen=True)
class Metric:
    """A quantity of the study."""

    title: str
    unit: str
    key: str  # of a method's values
    scale: float  # factor to the unit
    # median, high: bounds of median and 95th percentile under `standard`; None for none
    median: float | None = None
    high: float | None = None
    of_robot: bool = False  # whether it is divided by the robot's mass
    least_share: float = 0.0  # of the load, for it to count
    harsher: float = 3.0  # factor on the bounds under `harsh`

    def values(self, pairs: _Pairs, method: str) -> list[float]:
        """Sizes of a method's errors, over the runs that have one and did not fall before."""
        found = []
        for case, run in pairs:
            value = run["methods"].get(method, {}).get(self.key)
            if value is not None and case.share >= self.least_share:
                found.append(self.scale * abs(value) / (float(run["robot_mass"]) if self.of_robot else 1.0))
        return found

    def bounds(self, errors: str, gait: str) -> tuple[float | None, float | None]:
        """Of median and 95th percentile."""
        wider = 1.0 if errors == "standard" else self.harsher
        promised = (self.median, self.high) if gait in _BOUNDED else (None, None)
        median, high = (None if bound is None else bound * wider for bound in promised)
        return median, high


METRICS = (
    Metric("payload mass", "% of the robot's", "soon.payload_mass", 100.0, 0.2, 0.6, of_robot=True),
    Metric("shift of the trunk's CoM, x-y", "mm", "soon.shift_xy", 1e3, 1.5, 4.0),
    Metric("payload's CoM, x-y", "mm", "soon.payload_xy", 1e3, 5.0, None, least_share=0.10),
    Metric("trunk's CoM, z, after 3 s", "mm", "late.com_z", 1e3, None, 10.0),
)


def cases(settings: ReproduceSettings) -> list[WalkingCase]:
    """The grid; a small part of it in quick mode."""
    if settings.quick:
        return [
            WalkingCase(robot, "trot", 0.10, "left hind", "standard", settings.seed, OTHERS) for robot in ROBOTS[:2]
        ]
    return [
        WalkingCase(robot, gait, share, place, errors, settings.seed + k, OTHERS)
        for k in range(settings.seeds or SEEDS)
        for errors in ERRORS
        for robot in ROBOTS
        for gait in GAITS
        for share in SHARES
        for place in PLACES
    ]


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """Runs the whole grid on all cores; runs stored in `settings.keep` are not repeated."""
    grid = cases(settings)
    return summary(grid, run_grid(PAPER.name, weigh_in_motion, grid, progress, settings.keep, settings.pool))


_Pairs = Sequence[tuple[WalkingCase, Outcome]]


def summary(grid: Sequence[WalkingCase], runs: Sequence[Outcome]) -> ExperimentResult:
    """Summarises any part of the grid."""
    pairs = list(zip(grid, runs, strict=True))
    order: list[tuple[str, str]] = [(errors, gait) for errors in ERRORS for gait in GAITS]
    found = grouped(pairs, lambda case: (case.errors, str(case.gait)))
    groups = {key: found[key] for key in order if key in found}
    records = {key: list(_records(*key, chosen)) for key, chosen in groups.items()}
    return PAPER.result(
        (record for own in records.values() for record in own),
        (_table(groups), _by_robot(pairs), _behaviour(groups, records)),
        facts={
            "Runs": f"{len(pairs)}",
            "Robots": ", ".join(dict.fromkeys(c.robot for c in grid)),
            "Plant": "MuJoCo, 1 kHz, controllers in the loop",
        },
    )


def _records(errors: str, gait: str, pairs: _Pairs) -> Iterator[Record]:
    case: dict[str, str | float] = {"errors": errors, "gait": gait, "method": WALKING}
    for metric in METRICS:
        if not metric.values(pairs, WALKING):
            continue
        for method in METHODS:
            values = metric.values(pairs, method)
            if values:
                bounds = metric.bounds(errors, gait) if method == WALKING else (None, None)
                of = {**case, "method": method}
                median, high = float(np.median(values)), float(np.percentile(values, 95))
                yield PAPER.record(of, f"{metric.title}, median", metric.unit, median, bound=bounds[0])
                yield PAPER.record(of, f"{metric.title}, 95th percentile", metric.unit, high, bound=bounds[1])
    yield from _calibration(case, errors, pairs)
    yield from _noticing(case, pairs)


def _calibration(case: Mapping[str, str | float], errors: str, pairs: _Pairs) -> Iterator[Record]:
    figures = [r["methods"][WALKING] for _, r in pairs if r["methods"][WALKING].get("loaded.nees") is not None]
    if not figures:
        return
    count = sum(f["loaded.observed"] for f in figures)
    nees = sum(f["loaded.nees"] for f in figures) / count
    low, high = (float(limit) for limit in chi2.ppf([0.025, 0.975], count) / count)
    bounded = errors == "standard"
    yield PAPER.record(case, "NEES / n, not more than chance makes it", "1", nees, bound=high if bounded else None)
    yield Record(PAPER.name, case, "NEES / n, not less", "1", nees, None, low if bounded else None, "at least")


def _noticing(case: Mapping[str, str | float], pairs: _Pairs) -> Iterator[Record]:
    stood = [r for _, r in pairs if r["fell"] is None]
    yield PAPER.record(case, "falls", "1", float(len(pairs) - len(stood)))
    noticed = [r["noticed"] for r in stood if r["noticed"] is not None]
    if stood:
        yield PAPER.record(case, "loads not noticed", "1", float(len(stood) - len(noticed)), bound=0.0)
    if noticed:
        yield PAPER.record(case, "load noticed after, longest", "s", float(max(noticed)), bound=0.2)
    yield PAPER.record(case, "false alarms", "1", float(sum(r["false_alarms"] for _, r in pairs)), bound=0.0)
    share = float(np.median([r["share_of_time"] for _, r in pairs]))
    yield PAPER.record(case, "estimator's time in the robot's, median", "1", share)


def _head(first: str) -> tuple[str, ...]:
    return (first, *(f"{metric.title} [{metric.unit}]" for metric in METRICS))


def _table(groups: Mapping[tuple[str, str], _Pairs]) -> TableData:
    def row(errors: str, gait: str, pairs: _Pairs, method: str) -> Row:
        own = method == WALKING
        cells = (spread(m.values(pairs, method), m.bounds(errors, gait) if own else (None, None)) for m in METRICS)
        return (METHODS[method], *cells)

    body = {
        f"{gait}, {errors}": [row(errors, gait, pairs, method) for method in METHODS]
        for (errors, gait), pairs in groups.items()
    }
    note = "Median; 95th percentile. Coloured where something was promised."
    return TableData.of("Errors of every method", _head("method"), body, note)


def _by_robot(pairs: _Pairs) -> TableData:
    body: dict[str, list[Row]] = {}
    for errors, chosen in grouped(pairs, lambda case: case.errors).items():
        for robot, own in grouped(chosen, lambda case: case.robot).items():
            body.setdefault(errors, []).append((robot, *(spread(m.values(own, WALKING)) for m in METRICS)))
    return TableData.of("The walking estimator, by robot", _head("robot"), body, "Median; 95th percentile.")


def _behaviour(
    groups: Mapping[tuple[str, str], _Pairs], records: Mapping[tuple[str, str], Sequence[Record]]
) -> TableData:
    head = ("", "runs", "falls", "not noticed", "noticed after [s], longest", "false alarms", "NEES / n")
    rows = []
    for (errors, gait), pairs in groups.items():
        by: dict[str, Any] = {r.metric: r.value for r in records[errors, gait] if r.case["method"] == WALKING}
        soon, nees = by.get("load noticed after, longest"), by.get("NEES / n, not less")
        rows.append(
            (
                f"{gait}, {errors}",
                f"{len(pairs)}",
                f"{by['falls']:.0f}",
                f"{by.get('loads not noticed', 0):.0f}",
                "–" if soon is None else f"{soon:.2f}",
                f"{by['false alarms']:.0f}",
                "–" if nees is None else f"{nees:.2f}",
            )
        )
    return TableData.of("Noticing, walking on, and error bars", head, rows)
