"""Study of robots with `real` errors, weighed with their model file only, by every method on the same logs.

The only information on a run is the time of the tare, the last instant before the load.
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from stadera.errors import IdentificationError
from stadera.identify.legs import identify
from stadera.identify.schema import with_identified_legs
from stadera.identify.settings import IdentifySettings
from stadera.lab.baselines import ALL_METHODS
from stadera.lab.control.com_plan import PlanError
from stadera.lab.control.reference import ControlError
from stadera.lab.experiments.runner import (
    Bounds,
    CaseValues,
    ExperimentResult,
    Outcome,
    Paper,
    Record,
    ReproduceSettings,
    crossed,
    grouped,
)
from stadera.lab.plant.payload import Tray
from stadera.lab.plant.plant import SimulationError
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate, stored, swing
from stadera.lab.truth import Truth
from stadera.logs import Recording, stream
from stadera.robot import Robot, load_robot
from stadera.trunk import make_estimator
from stadera.trunk.load import LoadChange, Payload
from stadera.trunk.protocol import TrunkEstimate
from stadera.trunk.registry import Setup
from stadera.trunk.samples import Samples
from stadera.types import Array

OURS = "walking"
"""Name of the library's estimator in the registry of methods."""
LEGS = "walking, legs identified"
"""The same with legs identified from a log of the robot's legs in the air."""

_TRUNK = ("trunk mass", "trunk com x", "trunk com y", "trunk com z")
_PAYLOAD, _CHANGE = ("payload mass", "payload x", "payload y", "payload z"), "change mass"
FIGURES = (*_TRUNK, *_PAYLOAD, _CHANGE)
"""Estimated quantities, each with error and standard deviation [kg, m]."""


@dataclass(frozen=True)
class RealitySettings:
    """Settings common to all runs of the study, and to their evaluation."""

    duration: float = 10.0  # [s]
    loaded_at: float = 5.0  # [s]
    out: float = 0.6  # of the tray's half size, within which loads are placed [1]
    half_cube: float = 0.05  # of a load [m]
    hold: int = 2  # periods of the test-bed for which the controller's torques are held
    heavy: float = 0.10  # least load whose position is evaluated, as a share of the robot's mass
    noticeable: float = 0.05  # least load that should be detected, likewise
    soon: float = 0.5  # time after the load for that [s]


HOW = RealitySettings()


@dataclass(frozen=True)
class RealityCase:
    """Settings of one run."""

    robot: str
    scenario: str  # trot, crawl, shake or stand
    share: float  # of the load in the robot's mass; 0 for none
    errors: str  # real or real-unit-gain
    # of the draw, combined with the other fields: no two cases draw the same robot, except for the common gain
    seed: int


def weigh_real(case: RealityCase, logs: Path | None = None) -> dict[str, Any]:
    """Results of a run, its logs stored in a folder for reuse; None to store none.

    `fell`: None, or a description. `robot_mass`: [kg]. `methods`: by method (of the registry, and `LEGS`) a mapping
    with every quantity of `FIGURES` that it gives, as [error, standard deviation]; `verdict_before`, `verdict`: of the
    fit, at the tare and at the end; `noticed`: [s] from the load to its detection;
    `false_changes`.
    """
    robot = load_robot(case.robot)
    try:
        log, truth = real_log(case, robot, logs)
    except (ControlError, PlanError, SimulationError) as error:
        return {"fell": str(error), "robot_mass": robot.mass, "methods": {}}
    if truth.fell is not None:
        return {"fell": truth.fell[1], "robot_mass": robot.mass, "methods": {}}
    samples = Samples.of_recording(next(stream(log, rows=len(log))), robot)  # as a user's log is read
    methods = {name: _weighed(name, robot, samples, truth) for name in (OURS, "ls", "rls", "kalman")}
    legs = _identified(case, robot, logs)
    if legs is not None:
        methods[LEGS] = _weighed(OURS, legs, samples, truth)
    return {"fell": None, "robot_mass": robot.mass, "methods": methods}


def real_log(case: RealityCase, robot: Robot, logs: Path | None) -> tuple[Recording, Truth]:
    """The run's log and truth, stored earlier or simulated now; its load is a cube on the tray, away from its edges."""
    draw, load, loaded_at, tray = _draw(case), None, None, Tray.of(robot)
    if case.share:
        loaded_at = HOW.loaded_at
        aside = HOW.out * np.random.default_rng(draw).uniform(-1.0, 1.0, 2) * tray.half_size[:2]
        x, y = (tray.centre[:2] + aside).tolist()
        load = Load(case.share * robot.mass, "kg", (x, y, tray.top + HOW.half_cube))
    settings = SimulateSettings(case.errors, load, duration=HOW.duration, seed=draw, load_time=loaded_at, hold=HOW.hold)
    return stored(logs, _name(case), lambda: simulate(robot, case.scenario, settings))


def _identified(case: RealityCase, robot: Robot, logs: Path | None) -> Robot | None:
    """The model file with legs identified from the robot's own log in the air; None if log or fit is refused."""
    with TemporaryDirectory() as folder:
        path = (Path(folder) if logs is None else logs) / f"{_name(case)}.legs.json"
        try:
            if not path.exists():
                in_air = swing(robot, settings=SimulateSettings(case.errors, seed=_draw(case)))
                identify(robot, in_air.recording, IdentifySettings(split=1.0)).save_json(path)
            return with_identified_legs(robot, path)
        except IdentificationError:
            return None


def _name(case: RealityCase) -> str:
    return "-".join(str(value) for value in vars(case).values())


def _draw(case: RealityCase) -> int:
    return zlib.crc32(repr(replace(case, errors="")).encode())


def _weighed(name: str, robot: Robot, samples: Samples, truth: Truth) -> dict[str, Any]:
    estimator = make_estimator(name, Setup(robot), ALL_METHODS)
    estimator.add(samples[samples.time < HOW.loaded_at])
    before, verdict_before = estimator.estimate(), estimator.trust.verdict
    if name == OURS:
        estimator.tare()
    estimator.add(samples[samples.time >= HOW.loaded_at])
    bare, load = truth.moments[0], truth.moments[-1]
    figures: dict[str, Any] = {"verdict_before": verdict_before, "verdict": estimator.trust.verdict}
    figures |= _errors(_TRUNK, before.value - np.array([bare.mass, *bare.com]), before.std)
    value, std = _payload(estimator.payload) if name == OURS else _difference(before, estimator.estimate())
    place = np.full(3, np.nan) if load.payload_com is None else np.asarray(load.payload_com)
    figures |= _errors(_PAYLOAD, value - np.array([load.payload_mass, *place]), std)
    if name == OURS:
        figures |= _changes(estimator.changes, load.payload_mass)
    return figures


def _errors(names: tuple[str, ...], errors: Array, stds: Array) -> dict[str, list[float]]:
    pairs = zip(names, errors.tolist(), stds.tolist(), strict=True)
    return {name: [error, std] for name, error, std in pairs if np.isfinite(error) and np.isfinite(std)}


def _payload(found: Payload | None) -> tuple[Array, Array]:
    """Mass and position of the payload since the tare, and their standard deviations, (4,) each."""
    if found is None:
        return np.full(4, np.nan), np.full(4, np.nan)
    return np.array([found.mass, *found.com]), np.array([found.mass_std, *found.com_std])


def _difference(before: TrunkEstimate, after: TrunkEstimate) -> tuple[Array, Array]:
    """The same from two estimates of the trunk with independent errors; no standard deviations for the position."""
    mass = after.trunk.mass - before.trunk.mass
    moment = after.trunk.mass * after.trunk.com_trunk - before.trunk.mass * before.trunk.com_trunk
    seen = np.isfinite(before.std) & np.isfinite(after.std)
    std = np.where(seen, np.hypot(before.std, after.std), np.nan)
    place = moment / mass if mass else np.full(3, np.nan)
    return np.array([mass, *place]), std


def _changes(changes: tuple[LoadChange, ...], mass: float) -> dict[str, Any]:
    """The first change detected after the load is assigned to the load; all others are false."""
    after = [change for change in changes if change.noticed > HOW.loaded_at]
    found = after[0] if after and mass > 0 else None
    false = len(changes) - (found is not None)
    if found is None:
        return {"noticed": None, "false_changes": false}
    change = [found.mass - mass, found.mass_std]
    return {"noticed": found.noticed - HOW.loaded_at, "false_changes": false, _CHANGE: change}


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

    def bounds(self, errors: str, scenario: str, method: str) -> Bounds:
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


def summary(grid: Sequence[RealityCase], runs: Sequence[Outcome]) -> ExperimentResult:
    """Summarises any part of the grid."""
    pairs = list(zip(grid, runs, strict=True))
    sets = grouped(pairs, lambda case: case.errors)
    accuracy = [
        record
        for errors, chosen in sets.items()
        for scenario, own in grouped(chosen, lambda case: case.scenario).items()
        for record in _accuracy(errors, scenario, own)
    ]
    bars = [record for errors, chosen in sets.items() for method in _OWN for record in _bars(errors, chosen, method)]
    return PAPER.result(
        (*accuracy, *bars),
        (
            crossed("Errors", accuracy, _place, _method, Record.label, "method"),
            crossed("Error bars, verdicts, changes of the load", bars, _place, Record.label, _method, ""),
        ),
        facts={
            "Runs": f"{len(pairs)}",
            "Falls": f"{sum(run['fell'] is not None for run in runs)}",
            "Robots": ", ".join(dict.fromkeys(c.robot for c in grid)),
        },
    )


def _place(record: Record) -> str:
    title = _TITLES[str(record.case["errors"])]
    return f"{record.case['scenario']}, {title}" if "scenario" in record.case else title


def _method(record: Record) -> str:
    return METHODS[str(record.case["method"])]


EXPERIMENT = PAPER.experiment(cases, weigh_real, summary, keeps=True, keeps_logs=True)


# -- accuracy -----------------------------------------------------------------------------------------------------
def _accuracy(errors: str, scenario: str, pairs: _Pairs) -> Iterator[Record]:
    case: CaseValues = {"errors": errors, "scenario": scenario}
    for quantity in ERROR_SIZES:
        sizes = {method: quantity.values(pairs, method) for method in METHODS}
        for method, values in sizes.items():
            bounds = quantity.bounds(errors, scenario, method)
            yield from PAPER.spread({**case, "method": method}, quantity.title, quantity.unit, values, bounds)
        yardstick = float(np.median(sizes[_YARDSTICK])) if sizes[_YARDSTICK] else 0.0
        for method in _OWN:
            if sizes[method] and yardstick:
                ratio, own = float(np.median(sizes[method])) / yardstick, {**case, "method": method}
                yield PAPER.record(own, f"{quantity.title}, median over plain least squares'", "1", ratio, bound=1.0)


# -- error bars and behaviour -------------------------------------------------------------------------------------
def _coverage(pairs: _Pairs, name: str, method: str) -> tuple[float, int] | None:
    """Coverage of a quantity's error bars: the share of errors within 2 σ, and the number beyond 4 σ with a good
    verdict. None if the quantity was never estimated.
    """
    sigmas, good = [], []
    for _, outcome in pairs:
        figures = outcome["methods"].get(method, {})
        verdict = figures.get("verdict_before" if name.startswith("trunk") else "verdict")
        if name in figures and verdict != "bad":
            error, std = figures[name]
            sigmas.append(abs(error) / std)
            good.append(verdict == "good")
    if not sigmas:
        return None
    size = np.array(sigmas)
    return float((size <= 2.0).mean()), int(((size > 4.0) & np.array(good)).sum())


def _bars(errors: str, pairs: _Pairs, method: str) -> Iterator[Record]:
    case: CaseValues = {"errors": errors, "method": method}
    own = [(c, outcome["methods"][method]) for c, outcome in pairs if method in outcome["methods"]]
    if not own:
        return
    for name in FIGURES:
        coverage = _coverage(pairs, name, method)
        if coverage is not None:
            within, beyond = coverage
            yield PAPER.record(case, f"{name}, within 2 σ", "1", within, None, 0.90, "at least")
            yield PAPER.record(case, f"{name}, beyond 4 σ with verdict good", "1", float(beyond), bound=0.0)
    good = sum(figures["verdict"] == "good" for _, figures in own)
    yield PAPER.record(case, "verdict good", "1", good / len(own), None, 0.8, "at least")
    late = [figures["noticed"] for c, figures in own if c.share >= HOW.noticeable]
    if late:
        soon = float(np.mean([time is not None and time <= HOW.soon for time in late]))
        yield PAPER.record(case, f"load noticed within {HOW.soon} s", "1", soon, None, 0.95, "at least")
    rate = 600.0 * sum(figures["false_changes"] for _, figures in own) / (HOW.duration * len(own))
    yield PAPER.record(case, "false changes in 10 minutes", "1", rate, bound=1.0)
