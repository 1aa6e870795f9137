"""Study of thousands of faulty logs: how many are weighed correctly, marked, refused, or silently wrong.

A log is simulated once for each robot, motion and seed, with `real` errors, and weighed through the public interface
with each fault. A signal fault is applied to the log's arrays; an external force acts in its own simulation.
`weigh` gets the model file, the log, and the time of the tare, which ends before the load, or the force, is applied.
"""

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from stadera.errors import StaderaError
from stadera.lab.control.com_plan import PlanError
from stadera.lab.control.reference import ControlError
from stadera.lab.experiments.fault_kinds import FORCES, SIGNAL_FAULTS
from stadera.lab.experiments.runner import (
    CaseValues,
    ExperimentResult,
    Outcome,
    Paper,
    Record,
    ReproduceSettings,
    grouped,
)
from stadera.lab.plant.plant import SimulationError
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate, stored
from stadera.lab.truth import Truth
from stadera.logs import Recording
from stadera.report.table import Cell, Row, TableData
from stadera.robot import load_robot
from stadera.robot.model import Robot
from stadera.weigh.result import Weighing
from stadera.weigh.weigh import weigh

PAPER = Paper.of("faults")

ROBOTS = ("hyq", "go2", "anymal_b", "anymal_c", "b1", "a1", "b1_z1", "g1", "talos")
SCENARIOS = ("trot", "crawl", "shake", "stand")
ON_TWO_FEET = {"g1": ("squat", "shake", "stand"), "talos": ("squat", "shake", "stand")}
"""Robots that have other motions than `SCENARIOS`, and these."""
CLEAN = "none"
"""The unmodified log."""


@dataclass(frozen=True)
class FaultSettings:
    """Settings of the study."""

    seeds: int = 8  # by default
    load: float = 0.10  # added in every other log, as a share of the robot's mass
    arms: float = 0.3  # amplitude with which joints outside the legs swing [rad]


HOW = FaultSettings()


@dataclass(frozen=True)
class LogCase:
    """A log."""

    robot: str
    scenario: str  # trot, crawl, shake, squat or stand
    seed: int  # of everything that is drawn
    share: float = 0.0  # of a load in the robot's mass, added in the middle; 0 for none
    force: str = ""  # external force from the middle on, a name of `FORCES`; empty for none
    duration: float = 5.0  # [s]

    @property
    def middle(self) -> float:
        """Time at which load or force is applied, and the tare ends [s]."""
        return 0.5 * self.duration

    def made(self, robot: Robot, logs: Path | None) -> tuple[Recording, Truth]:
        """The log and its truth, stored earlier in a folder or simulated now."""
        name = "-".join(str(value).replace(" ", "_") for value in vars(self).values() if value != "")
        settings = SimulateSettings(
            "real-unit-gain",
            Load(round(self.share * robot.mass, 3)) if self.share else None,
            duration=self.duration,
            rate=250.0,
            seed=zlib.crc32(f"{self.robot} {self.scenario} {self.seed}".encode()),
            load_time=self.middle if self.share else None,
            hold=2,  # periods of the test-bed between two torques of the controller
            outside=FORCES[self.force].make(robot, self.middle) if self.force else None,
            arms=HOW.arms,
        )
        return stored(logs, name, lambda: simulate(robot, self.scenario, settings))


@dataclass(frozen=True)
class FaultCase:
    """A weighing."""

    log: LogCase  # the log to weigh
    fault: str = CLEAN  # a name of `SIGNAL_FAULTS`, `CLEAN`, or the log's force

    @property
    def hidden(self) -> str:
        """Why no log of this motion can show the fault; empty where one can."""
        if self.fault in FORCES:
            return FORCES[self.fault].hidden
        fault = SIGNAL_FAULTS.get(self.fault)
        shown = fault is None or (fault.motions and self.log.scenario not in fault.motions)
        return "" if fault is None or shown else fault.hidden


@dataclass(frozen=True)
class FaultyLog:
    """A log, and the faults with which it is weighed, see `FaultCase.fault`."""

    log: LogCase
    faults: tuple[str, ...]

    @property
    def robot(self) -> str:
        """Name of the log's robot."""
        return self.log.robot


def cases(settings: ReproduceSettings) -> list[FaultyLog]:
    """All combinations of faults, robots, motions and seeds, and logs without a fault; few in a quick study."""
    signals = (CLEAN, *tuple(SIGNAL_FAULTS)[:: 2 if settings.quick else 1])
    seeds = settings.seeds or (1 if settings.quick else HOW.seeds)
    motions = [
        (i + j, robot, scenario)
        for i, robot in enumerate(ROBOTS[: 2 if settings.quick else None])
        for j, scenario in enumerate(ON_TWO_FEET.get(robot, SCENARIOS))
    ]
    found = []
    for k, (n, robot, scenario) in product(range(seeds), motions):
        seed = settings.seed + k
        found.append(FaultyLog(LogCase(robot, scenario, seed, HOW.load if (seed + n) % 2 else 0.0), signals))
        found += [FaultyLog(LogCase(robot, scenario, seed, force=force), (force,)) for force in FORCES]
    return found


def weigh_faulty(case: FaultyLog, logs: Path | None = None) -> dict[str, Any]:
    """Outcomes of a log's weighings; the log is stored in a folder for reuse, None to store none.

    `fell`: None, or a description of the fall, after which nothing is weighed. `faults`: by fault,

    - `status`: "right", verdict good and all values within 3 σ; "silent", verdict good and a value beyond; "named",
      verdict doubtful; "refused", no values; "crashed", an exception other than a StaderaError. `said`: the reason;
    - `mass`: of the robot [kg]. `errors`: [error, standard deviation] by quantity, in kg and m, for observed ones;
    - `left_out`: whether parts of the log were excluded because of a fault.

    A fault that the robot cannot have, such as of arms, is not among them.
    """
    robot = load_robot(case.log.robot)
    try:
        log, truth = case.log.made(robot, logs)
    except (ControlError, PlanError, SimulationError) as error:
        return {"fell": str(error), "faults": {}}
    if truth.fell is not None:
        return {"fell": truth.fell[1], "faults": {}}
    weighed = {name: _weighed(FaultCase(case.log, name), robot, log, truth) for name in case.faults}
    return {"fell": None, "faults": {name: outcome for name, outcome in weighed.items() if outcome is not None}}


def _weighed(case: FaultCase, robot: Robot, log: Recording, truth: Truth, kept: int = 200) -> dict[str, Any] | None:
    """Outcome of one weighing, None if the robot cannot have the fault; `kept` characters of a message are kept."""
    faulty, mass = log, robot.mass
    if case.fault in SIGNAL_FAULTS:
        fault = SIGNAL_FAULTS[case.fault]
        faulty = fault.spoil(log, robot, np.random.default_rng(zlib.crc32(repr(case).encode())))
        model = fault.model(robot)
        if faulty is log and model is robot:
            return None
        robot = model
    begin = float(faulty.time[0])
    stretched = (float(faulty.time[-1]) - begin) / (float(log.time[-1]) - float(log.time[0]))
    tare = (begin, begin + stretched * case.log.middle)
    try:
        result = weigh(robot, replace(faulty, source=f"{case.log.robot}, {case.log.scenario}"), tare)
    except Exception as error:  # crashes are part of the study
        status, said = ("refused", str(error)) if isinstance(error, StaderaError) else ("crashed", repr(error))
        return {"status": status, "said": said[:kept], "mass": mass, "errors": {}, "left_out": False}
    errors = _errors(result, truth)
    good = result.trust.verdict == "good"
    return {
        "status": ("right" if worst(errors) <= 3.0 else "silent") if good else "named",
        "said": "; ".join(result.trust.reasons)[:kept],
        "mass": mass,
        "errors": errors,
        "left_out": any(note.startswith("left out") for note in result.notes),
    }


def _errors(result: Weighing, truth: Truth) -> dict[str, list[float]]:
    """Error and standard deviation, by name, of what was observed: trunk at the end, payload's mass since the tare."""
    end, before = truth.moments[-1], truth.moments[0]
    values = [result.mass - end.mass, *(result.com - np.array(end.com))]
    stds = [result.mass_std, *result.com_std]
    if result.payload is not None:
        values.append(result.payload.mass - (end.mass - before.mass))
        stds.append(result.payload.mass_std)
    names = ("trunk mass", "trunk com x", "trunk com y", "trunk com z", "payload mass")
    pairs = zip(names, values, stds, strict=False)
    return {name: [float(value), float(std)] for name, value, std in pairs if np.isfinite(value) and np.isfinite(std)}


def worst(errors: Mapping[str, list[float]]) -> float:
    """The largest error in standard deviations; 0 without figures."""
    return max((abs(error) / std for error, std in errors.values()), default=0.0)


# -- summary ----------------------------------------------------------------------------------------------------------
_Pairs = Sequence[tuple[FaultCase, Outcome]]
_STATUS = ("right", "named", "refused", "silent", "crashed")


def summary(grid: Sequence[FaultyLog], runs: Sequence[Outcome]) -> ExperimentResult:
    """Summarises any part of the grid."""
    fell = sum(run["fell"] is not None for run in runs)
    pairs = [
        (FaultCase(case.log, name), one)
        for case, run in zip(grid, runs, strict=True)
        for name, one in run["faults"].items()
    ]
    shown = [pair for pair in pairs if pair[0].fault != CLEAN and not pair[0].hidden]
    tables = (
        _table("Faults, by where they are", pairs, _group),
        _table("Faults that a log can show, by motion", shown, lambda case: case.log.scenario),
        _table("Faults that a log can show, by robot", shown, lambda case: case.log.robot),
        _table("Every fault", pairs, lambda case: case.fault + " (hidden)" * bool(case.hidden)),
        _silent(shown),
    )
    records = (*_records(shown), *_clean([outcome for case, outcome in pairs if case.fault == CLEAN]))
    facts = {"Weighings": f"{len(pairs)}", "Logs": f"{len({c.log for c, _ in pairs})}", "Robots that fell": f"{fell}"}
    return PAPER.result(records, tables, facts=facts)


EXPERIMENT = PAPER.experiment(cases, weigh_faulty, summary, keeps=True, keeps_logs=True)


def _records(pairs: _Pairs) -> Iterator[Record]:
    case: CaseValues = {"faults": "that a log can show"}
    total = max(len(pairs), 1)
    beyond = [worst(outcome["errors"]) for _, outcome in pairs if outcome["status"] == "silent"]
    for status in _STATUS:
        share = sum(outcome["status"] == status for _, outcome in pairs) / total
        bound = {"silent": PAPER.bounds["silent_3"], "crashed": 0.0}.get(status)
        yield PAPER.record(case, f"share {status}", "1", share, bound=bound)
    over = float(sum(sigma > 5.0 for sigma in beyond))
    yield PAPER.record(case, "silent beyond 5 σ", "1", over, bound=PAPER.bounds["silent_5"])


def _clean(outcomes: Sequence[Outcome]) -> Iterator[Record]:
    if not outcomes:
        return
    case: CaseValues = {"faults": "none"}
    count, statuses = len(outcomes), [outcome["status"] for outcome in outcomes]
    called = sum(status in ("named", "refused", "crashed") for status in statuses) / count
    yield PAPER.record(case, "share called faulty", "1", called, bound=PAPER.bounds["clean"])
    yield PAPER.record(case, "share beyond 3 σ", "1", statuses.count("silent") / count)
    yield PAPER.record(case, "share with parts left out", "1", sum(bool(o["left_out"]) for o in outcomes) / count)


def _group(case: FaultCase) -> str:
    if case.fault == CLEAN:
        return "no fault"
    where = SIGNAL_FAULTS[case.fault].group if case.fault in SIGNAL_FAULTS else "force from outside"
    return f"{where}, that no log can show" if case.hidden else where


def _table(title: str, pairs: _Pairs, key: Callable[[FaultCase], str]) -> TableData:
    head = ("", "runs", "right", "named", "refused", "silent", "beyond 5 σ", "largest [σ]", "of the robot's mass [%]")
    rows = [_row(name, [outcome for _, outcome in own]) for name, own in grouped(pairs, key).items()]
    return TableData.of(title, head, rows, "The last three are of the silent ones.")


def _row(name: str, outcomes: Sequence[Outcome]) -> Row:
    counts = [sum(outcome["status"] == status for outcome in outcomes) for status in _STATUS[:4]]
    silent = [outcome for outcome in outcomes if outcome["status"] == "silent"]
    sigmas = [worst(outcome["errors"]) for outcome in silent]
    over = sum(sigma > 5.0 for sigma in sigmas)
    most = (f"{max(sigmas):.1f}", f"{max(map(_percent, silent)):.1f}") if silent else ("–", "–")
    return (name, f"{len(outcomes)}", *map(str, counts), Cell(f"{over}", strong=True, good=not over), *most)


def _percent(outcome: Outcome) -> float:
    """The larger of the mass errors, in per cent of the robot's mass."""
    errors = outcome["errors"]
    off = max((abs(errors[name][0]) for name in ("trunk mass", "payload mass") if name in errors), default=0.0)
    return 100.0 * float(off) / float(outcome["mass"])


def _silent(pairs: _Pairs) -> TableData:
    found = [(worst(outcome["errors"]), case, outcome) for case, outcome in pairs if outcome["status"] == "silent"]
    rows: list[Row] = []
    for sigma, case, outcome in sorted(found, key=lambda entry: -entry[0]):
        if sigma > 5.0:
            sizes = {name: abs(error) / std for name, (error, std) in outcome["errors"].items()}
            where = (case.fault, case.log.robot, case.log.scenario, f"{case.log.seed}")
            rows.append((*where, max(sizes, key=sizes.__getitem__), f"{sigma:.1f}", f"{_percent(outcome):.1f}"))
    head = ("fault", "robot", "motion", "seed", "figure", "error [σ]", "of the robot's mass [%]")
    return TableData.of("Silently wrong by more than 5 σ", head, rows)
