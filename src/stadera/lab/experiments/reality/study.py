"""Study of robots with `real` errors, weighed with their model file only, by every method on the same logs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from stadera.lab.experiments.grid import Outcome, grouped, run_grid
from stadera.lab.experiments.paper import Paper, ReproduceSettings
from stadera.lab.experiments.reality.runs import FIGURES, HOW, LEGS, OURS, RealityCase, weigh_real
from stadera.lab.experiments.result import ExperimentResult, Record, spread
from stadera.report.table import Row, TableData
from stadera.types import Progress

PAPER = Paper.of("reality")

ROBOTS = ("hyq", "go2", "anymal_b", "anymal_c", "b1", "a1")
SCENARIOS = ("trot", "crawl", "shake", "stand")
SHARES = (0.10, 0.05, 0.25, 0.0, 0.15)
"""Shares of the load in the robot's mass, one for each draw."""
SETS = ("real-unit-gain", "real")
METHODS = {
    OURS: "stadera",
    LEGS: "stadera, legs identified",
    "ls": "plain least squares",
    "rls": "recursive least squares",
    "kalman": "Kalman filter, m and m c",
}

_UNIT, _YARDSTICK = SETS[0], "ls"
_OWN = (OURS, LEGS)
_PROMISED = {OURS: 1.0, LEGS: 0.5}
"""Factors on the bounds: identified legs halve them."""
_MOVING = ("trot", "crawl", "shake")
_TITLES = {_UNIT: "mean torque gain one", "real": "mean torque gain drawn"}


_Pairs = Sequence[tuple[RealityCase, Outcome]]


@dataclass(frozen=True)
class ErrorSize:
    """A quantity of the study: the size of an error."""

    title: str
    unit: str
    names: tuple[str, ...]  # of `FIGURES`; for several, the length of the vector
    relative: bool = False  # in percent of the robot's mass; else in mm
    # median, high: bounds of median and 95th percentile for robots in motion, their mean gain one; None for none
    median: float | None = None
    high: float | None = None
    least_share: float = 0.0  # least load as a share of the robot's mass

    def values(self, pairs: _Pairs, method: str) -> list[float]:
        """Sizes of a method's errors over the runs in which every component was estimated."""
        found = []
        for case, outcome in pairs:
            figures = outcome["methods"].get(method, {})
            parts = [figures[name][0] for name in self.names if name in figures]
            if len(parts) == len(self.names) and case.share >= self.least_share:
                scale = 100.0 / float(outcome["robot_mass"]) if self.relative else 1e3
                found.append(scale * float(np.linalg.norm(parts)))
        return found

    def bounds(self, errors: str, scenario: str, method: str) -> tuple[float | None, float | None]:
        """Bounds of median and 95th percentile for the library's own estimator, where there are any."""
        share = _PROMISED.get(method) if errors == _UNIT and scenario in _MOVING else None
        median, high = (None if share is None or bound is None else share * bound for bound in (self.median, self.high))
        return median, high


ERROR_SIZES = (
    ErrorSize("payload mass", "%", ("payload mass",), True, 0.2, 0.8),
    ErrorSize("payload x-y", "mm", ("payload x", "payload y"), False, 8.0, None, HOW.heavy),
    ErrorSize("trunk mass", "%", ("trunk mass",), True, 1.0, 3.0),
    ErrorSize("trunk CoM x-y", "mm", ("trunk com x", "trunk com y"), False, 4.0, None),
    ErrorSize("trunk CoM z", "mm", ("trunk com z",), False, 15.0, None),
)


def cases(settings: ReproduceSettings) -> list[RealityCase]:
    """The grid, one load for each draw; a small part of it in quick mode."""
    if settings.quick:
        few = (("hyq", "trot", _UNIT), ("go2", "trot", _UNIT), ("go2", "stand", _UNIT), ("hyq", "trot", SETS[1]))
        return [RealityCase(robot, scenario, 0.10, errors, settings.seed) for robot, scenario, errors in few]
    return [
        RealityCase(robot, scenario, SHARES[k % len(SHARES)], errors, settings.seed + k)
        for errors in SETS
        for k in range(settings.seeds or len(SHARES))
        for robot in ROBOTS
        for scenario in SCENARIOS
    ]


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """Runs the whole grid on all cores; logs and results stored in `settings.keep` are reused."""
    grid = cases(settings)
    logs = None if settings.keep is None else settings.keep.absolute() / f"{PAPER.name}-logs"
    return summary(
        grid, run_grid(PAPER.name, partial(weigh_real, logs=logs), grid, progress, settings.keep, settings.pool)
    )


def summary(grid: Sequence[RealityCase], runs: Sequence[Outcome]) -> ExperimentResult:
    """Summarises any part of the grid."""
    pairs = list(zip(grid, runs, strict=True))
    sets = grouped(pairs, lambda case: case.errors)
    accuracy = (
        record
        for errors, chosen in sets.items()
        for scenario, own in grouped(chosen, lambda case: case.scenario).items()
        for record in _accuracy(errors, scenario, own)
    )
    bars = (record for errors, chosen in sets.items() for method in _OWN for record in _bars(errors, chosen, method))
    tables = (_table(errors, chosen) for errors, chosen in sets.items())
    return PAPER.result(
        (*accuracy, *bars),
        (*tables, _by_robot(sets), _bars_table(sets), _behaviour(sets)),
        facts={"Runs": f"{len(pairs)}", "Robots": ", ".join(dict.fromkeys(c.robot for c in grid))},
    )


# -- accuracy -----------------------------------------------------------------------------------------------------
def _accuracy(errors: str, scenario: str, pairs: _Pairs) -> Iterator[Record]:
    case: dict[str, str | float] = {"errors": errors, "scenario": scenario}
    for quantity in ERROR_SIZES:
        medians: dict[str, float] = {}
        for method in METHODS:
            values = quantity.values(pairs, method)
            if values:
                bounds = quantity.bounds(errors, scenario, method)
                own = {**case, "method": method}
                medians[method], high = float(np.median(values)), float(np.percentile(values, 95))
                yield PAPER.record(own, f"{quantity.title}, median", quantity.unit, medians[method], bound=bounds[0])
                yield PAPER.record(own, f"{quantity.title}, 95th percentile", quantity.unit, high, bound=bounds[1])
        for method in _OWN:
            if method in medians and medians.get(_YARDSTICK):
                ratio, own = medians[method] / medians[_YARDSTICK], {**case, "method": method}
                yield PAPER.record(own, f"{quantity.title}, median over plain least squares'", "1", ratio, bound=1.0)


def _table(errors: str, pairs: _Pairs) -> TableData:
    def row(scenario: str, chosen: _Pairs, method: str) -> Row:
        cells = (spread(q.values(chosen, method), q.bounds(errors, scenario, method)) for q in ERROR_SIZES)
        return (METHODS[method], *cells)

    body = {
        scenario: [row(scenario, chosen, method) for method in METHODS]
        for scenario, chosen in grouped(pairs, lambda case: case.scenario).items()
    }
    return TableData.of(f"Errors, {_TITLES[errors]}", _head("method"), body, "Median; 95th percentile.")


def _by_robot(sets: Mapping[str, _Pairs]) -> TableData:
    body: dict[str, list[Row]] = {}
    for errors, pairs in sets.items():
        moving = [(c, r) for c, r in pairs if c.scenario in _MOVING]
        for robot, own in grouped(moving, lambda case: case.robot).items():
            body.setdefault(_TITLES[errors], []).append((robot, *(spread(q.values(own, OURS)) for q in ERROR_SIZES)))
    return TableData.of("Errors in motion, by robot", _head("robot"), body, "Median; 95th percentile.")


def _head(first: str) -> tuple[str, ...]:
    return (first, *(f"{q.title} [{q.unit}]" for q in ERROR_SIZES))


# -- error bars and behaviour -------------------------------------------------------------------------------------
def _coverage(pairs: _Pairs, name: str, method: str) -> tuple[float, int, int] | None:
    """Coverage of a quantity's error bars: the share of errors within 2 σ, the number beyond 4 σ with a good verdict
    (or none), and the total number. None if the quantity was never estimated.
    """
    sigmas, good = [], []
    for _, outcome in pairs:
        figures = outcome["methods"].get(method, {})
        verdict = figures.get("verdict_before" if name.startswith("trunk") else "verdict")
        if name in figures and verdict != "bad":
            error, std = figures[name]
            sigmas.append(abs(error) / std)
            good.append(verdict in ("good", None))
    if not sigmas:
        return None
    size = np.array(sigmas)
    return float((size <= 2.0).mean()), int(((size > 4.0) & np.array(good)).sum()), len(size)


def _bars(errors: str, pairs: _Pairs, method: str) -> Iterator[Record]:
    if not any(method in outcome["methods"] for _, outcome in pairs):
        return
    case: dict[str, str | float] = {"errors": errors, "method": method}

    def least(metric: str, value: float, bound: float) -> Record:
        return Record(PAPER.name, case, metric, "1", value, None, bound, "at least")

    for name in FIGURES:
        coverage = _coverage(pairs, name, method)
        if coverage is not None:
            within, beyond, _ = coverage
            yield least(f"{name}, within 2 σ", within, 0.90)
            yield PAPER.record(case, f"{name}, beyond 4 σ with verdict good", "1", float(beyond), bound=0.0)
    verdicts, noticed = _verdicts(pairs, method), _noticed(pairs, method)
    if verdicts:
        yield least("verdict good", verdicts.count("good") / len(verdicts), 0.8)
    if noticed:
        yield least(f"load noticed within {HOW.soon} s", float(np.mean(noticed)), 0.95)
    yield PAPER.record(case, "false changes in 10 minutes", "1", _false_rate(pairs, method), bound=1.0)


def _verdicts(pairs: _Pairs, method: str) -> list[str]:
    found = (r["methods"].get(method, {}).get("verdict") for _, r in pairs)
    return [verdict for verdict in found if verdict is not None]


def _noticed(pairs: _Pairs, method: str) -> list[bool]:
    """For each load that should be detected, whether it was detected soon."""
    stood = [r["methods"][method]["noticed"] for c, r in pairs if method in r["methods"] and c.share >= HOW.noticeable]
    return [late is not None and late <= HOW.soon for late in stood]


def _false_rate(pairs: _Pairs, method: str) -> float:
    """Number of false changes in ten minutes."""
    counts = [r["methods"][method]["false_changes"] for _, r in pairs if method in r["methods"]]
    return 600.0 * sum(counts) / (HOW.duration * len(counts)) if counts else 0.0


def _bars_table(sets: Mapping[str, _Pairs]) -> TableData:
    body: dict[str, list[Row]] = {}
    for errors, pairs in sets.items():
        for name, method in product(FIGURES, _OWN):
            coverage = _coverage(pairs, name, method)
            if coverage is not None:
                within, beyond, count = coverage
                row = (f"{name}, {METHODS[method]}", f"{100.0 * within:.0f} %", f"{beyond}", f"{count}")
                body.setdefault(_TITLES[errors], []).append(row)
    return TableData.of("Error bars", ("value", "within 2 σ", "beyond 4 σ, verdict good", "of"), body)


def _behaviour(sets: Mapping[str, _Pairs]) -> TableData:
    head = ("", "runs", "falls", "good / doubtful / bad", f"noticed within {HOW.soon} s", "false in 10 min", "time")
    body: dict[str, list[Row]] = {}
    for errors, pairs in sets.items():
        for scenario, own in grouped(pairs, lambda case: case.scenario).items():
            verdicts, noticed = _verdicts(own, OURS), _noticed(own, OURS)
            spent = [r["methods"][OURS]["share_of_time"] for _, r in own if OURS in r["methods"]]
            row = (
                scenario,
                f"{len(own)}",
                f"{sum(r['fell'] is not None for _, r in own)}",
                " / ".join(f"{verdicts.count(v)}" for v in ("good", "doubtful", "bad")) if verdicts else "–",
                f"{100.0 * np.mean(noticed):.0f} %" if noticed else "–",
                f"{_false_rate(own, OURS):.1f}",
                f"{100.0 * np.median(spent):.0f} %" if spent else "–",
            )
            body.setdefault(_TITLES[errors], []).append(row)
    note = "Time: of the processor, in the robot's."
    return TableData.of("Verdicts, changes of the load, cost", head, body, note)
