"""Study of weighing without stopping: robots crawl, trot and sway, loads are added, all methods use the same runs.

The controllers use the walking estimator's estimate when it can be trusted, and the model file's trunk before. The
estimators' prior is wrong: 10 % too light, with a centre of mass off by 15 % of the hips' half spacing. The only
information on the load is that the last instant before it is the tare.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from stadera.inertia import InertialParameters
from stadera.lab.baselines import ALL_METHODS
from stadera.lab.control import Crawl, Trot, TrunkController
from stadera.lab.control.monitor import WalkMonitor, walk
from stadera.lab.control.stand import Controller
from stadera.lab.experiments.motion import Gait, RobotInMotion, fastest_trot, sway, walk_on
from stadera.lab.experiments.result import Bounds, CaseValues, ExperimentResult, Record, spread
from stadera.lab.experiments.runner import Outcome, Paper, ReproduceSettings, grouped
from stadera.lab.plant import RigidMass
from stadera.lab.plant.payload import Tray
from stadera.report.table import Row, TableData
from stadera.robot import Robot, load_robot
from stadera.trunk import TrunkEstimator, make_estimator
from stadera.trunk.registry import Setup

PAPER = Paper.of("walking")

ROBOTS = ("hyq", "go2", "anymal_c", "b1")
GAITS: tuple[Gait, ...] = ("crawl", "trot", "shake")
ERRORS = ("standard", "harsh")
SHARES = (0.05, 0.10, 0.25)
WALKING = "walking"
METHODS: Mapping[str, str] = {
    WALKING: "walking",
    "contact": "(c) contact forces",
    "rls": "recursive least squares",
    "kalman": "Kalman filter, m and m c",
}
OTHERS = tuple(name for name in METHODS if name != WALKING)

_TOWARDS = {
    "middle": (0, 0),
    "left front": (1, 1),
    "right front": (1, -1),
    "left hind": (-1, 1),
    "right hind": (-1, -1),
}
PLACES = tuple(_TOWARDS)
"""Positions of a load on the back: the tray's middle, or three quarters of the way to a corner."""


@dataclass(frozen=True)
class WalkSettings:
    """Settings of the runs."""

    seeds: int = 5  # by default
    still: float = 0.3  # time before it moves [s]
    # by gait, time in motion before the load [s]
    before: Mapping[Gait, float] = field(default_factory=lambda: {"crawl": 6.0, "trot": 3.0, "shake": 3.0})
    soon: float = 1.0  # time after the load at which results are evaluated [s]
    late: float = 3.0  # likewise
    slower: int = 10  # periods between two samples of the other methods: 100 Hz
    out: float = 0.75  # position of a load towards a corner, as a share of the tray's half size [1]
    edge: float = 0.04  # of a box of 1 kg [m]; proportional to the cube root of the mass


_HOW = WalkSettings()


@dataclass(frozen=True)
class WalkingCase:
    """Settings of one run."""

    robot: str
    gait: Gait  # crawl, trot or shake
    share: float  # of the load in the robot's mass; 0 for none
    place: str  # one of `PLACES`
    errors: str  # of the sensors, a named set
    seed: int  # of sensors and commands
    others: tuple[str, ...] = ()  # additional methods, by their registry's names, on the same measurements


def cases(settings: ReproduceSettings) -> list[WalkingCase]:
    """The grid; a small part of it in quick mode."""
    if settings.quick:
        return [WalkingCase(name, "trot", 0.10, "left hind", "standard", settings.seed, OTHERS) for name in ROBOTS[:2]]
    return [
        WalkingCase(robot, gait, share, place, errors, settings.seed + k, OTHERS)
        for k in range(settings.seeds or _HOW.seeds)
        for errors in ERRORS
        for robot in ROBOTS
        for gait in GAITS
        for share in SHARES
        for place in PLACES
    ]


def weigh_in_motion(case: WalkingCase) -> dict[str, Any]:
    """Results of the run.

    `fell`: None, or a description. `robot_mass`: [kg]. `noticed`: [s] from the load to its detection, None if it was
    not detected. `false_alarms`: number of false changes. `share_of_time`: the estimator's processor time divided by
    the simulated time. `methods`: errors by method, see `compared`; for the walking estimator also its error bars.
    """
    robot = load_robot(case.robot)
    run = _WeighedRun(case, robot)
    fell = run.until_loaded() or run.after_load()
    return {
        "fell": fell,
        "robot_mass": robot.mass,
        "noticed": run.noticed,
        "false_alarms": run.false_alarms,
        "share_of_time": run.motion.share_of_time,
        "methods": {WALKING: run.figures} | {name: _other(name, run) for name in case.others},
    }


class _WeighedRun:
    """The robot in motion, with the walking estimator."""

    def __init__(self, case: WalkingCase, robot: Robot) -> None:
        self.case, self.robot = case, robot
        draw = zlib.crc32(repr(replace(case, others=())).encode())  # no two cases share a draw
        self.motion = RobotInMotion(robot, case.gait, case.errors, draw, keep=_HOW.slower if case.others else 0)
        self.estimator, self.bed = self.motion.estimator, self.motion.bed
        self._commands = np.random.default_rng(draw)
        self.figures: dict[str, Any] = {}
        self.loaded_at = np.inf
        self.bare = self.loaded = self.bed.plant.truth()

    def until_loaded(self) -> str | None:
        """Stands, sets out, and walks until the load; returns a description of a fall, or None."""
        monitor = WalkMonitor(self.bed.plant)
        walk(self.bed, _HOW.still, monitor)
        _set_out(self.motion.controller, self._commands)
        walk(self.bed, _HOW.before[self.case.gait], monitor)
        return None if monitor.fall is None else monitor.fall.how

    def after_load(self) -> str | None:
        """Adds the load and walks on; returns a description of a fall, or None."""
        plant = self.bed.plant
        self.estimator.tare()
        self.loaded_at = plant.time
        if self.case.share > 0:
            plant.apply_payload(payload_of(self.case, self.robot))
        self.loaded = plant.truth()
        monitor = WalkMonitor(plant)
        for end, name in ((_HOW.soon, "soon"), (_HOW.late, "late")):
            fall = walk(self.bed, self.loaded_at + end - plant.time, monitor)
            if fall is not None:
                return fall.how
            self.figures |= self._payload_figures(name)
        self.figures |= normalised(self.estimator, self.loaded)
        return None

    def _payload_figures(self, when: str) -> dict[str, Any]:
        found = self.estimator.payload
        if found is None or found.parameters is None:
            return {}
        now = self.estimator.parameters()
        tare = InertialParameters(now.inertial.vector - found.parameters.vector)
        figures = compared(tare, now.inertial, self.bare, self.loaded, when)
        if not now.observed[3]:
            figures[f"{when}.com_z"] = None
        return figures

    @property
    def noticed(self) -> float | None:
        """Time from the load to the first change detected after it [s]."""
        after = [c.noticed - self.loaded_at for c in self.estimator.changes if c.noticed > self.loaded_at]
        return after[0] if after and self.case.share > 0 else None

    @property
    def false_alarms(self) -> int:
        """Number of changes detected before the load, and of all but one after it."""
        before = sum(change.noticed <= self.loaded_at for change in self.estimator.changes)
        after = len(self.estimator.changes) - before
        return before + max(after - (self.case.share > 0), 0)


def payload_of(case: WalkingCase, robot: Robot) -> RigidMass:
    tray, mass = Tray.of(robot), case.share * robot.mass
    edge = _HOW.edge * mass ** (1.0 / 3.0)
    towards = ("front" in case.place) - ("hind" in case.place), ("left" in case.place) - ("right" in case.place)
    x, y = (tray.centre[:2] + _HOW.out * np.asarray(towards) * tray.half_size[:2]).tolist()
    return RigidMass.box(mass, (edge, edge, edge), (x, y, tray.top + 0.5 * edge))


def compared(
    tare: InertialParameters, now: InertialParameters, bare: InertialParameters, loaded: InertialParameters, when: str
) -> dict[str, Any]:
    """Errors [kg], [m] of payload (mass, x-y) and trunk (shift in x-y, height); `bare`, `loaded` are true."""
    figures: dict[str, Any] = {f"{when}.payload_mass": float((now.mass - tare.mass) - (loaded.mass - bare.mass))}
    shift = (now.com - tare.com) - (loaded.com - bare.com)
    figures[f"{when}.shift_xy"] = float(np.linalg.norm(shift[:2]))
    figures[f"{when}.com_z"] = float(now.com[2] - loaded.com[2])
    put_on, found = loaded - bare, now - tare
    if put_on.mass > 0 and found.mass > 0.2 * put_on.mass:
        figures[f"{when}.payload_xy"] = float(np.linalg.norm((found.com - put_on.com)[:2]))
    return figures


def normalised(estimator: TrunkEstimator, truth: InertialParameters) -> dict[str, Any]:
    """NEES of the observed ones of mass and centre of mass, and their number."""
    found = estimator.parameters()
    which = found.observed[:4]
    if not which.any():
        return {}
    error = (np.array([found.inertial.mass, *found.inertial.com]) - [truth.mass, *truth.com])[which]
    nees = float(error @ np.linalg.solve(found.covariance[np.ix_(which, which)], error))
    return {"loaded.nees": nees, "loaded.observed": int(which.sum())}


def _set_out(controller: Controller, rng: np.random.Generator) -> None:
    """Starts the motion: forwards, and slightly to one side, at random."""
    if isinstance(controller, Trot):
        walk_on(controller, rng.uniform(0.0, 1.0) * fastest_trot(controller), rng.uniform(-0.2, 0.2))
    elif isinstance(controller, Crawl):
        walk_on(controller, 0.12 * rng.uniform(0.3, 0.8), rng.uniform(-0.02, 0.02))
    elif isinstance(controller, TrunkController):
        sway(controller)


def _other(name: str, run: _WeighedRun) -> dict[str, Any]:
    """Results of a method on the run's measurements, as if fed at 100 Hz."""
    estimator = make_estimator(name, Setup(run.motion.model, run.motion.start), ALL_METHODS)
    figures: dict[str, Any] = {}
    marks = [("tare", run.loaded_at), ("soon", run.loaded_at + _HOW.soon), ("late", run.loaded_at + _HOW.late)]
    tare: InertialParameters | None = None
    for m in run.motion.kept:
        while marks and m.time >= marks[0][1] - 1e-9:
            when, _ = marks.pop(0)
            trunk = estimator.estimate().trunk
            now = InertialParameters.from_com(trunk.mass, trunk.com_trunk, np.zeros((3, 3)))
            if when == "tare":
                tare = now
            elif tare is not None:
                figures |= compared(tare, now, run.bare, run.loaded, when)
        estimator.update(m)
    return figures


# -- summary ----------------------------------------------------------------------------------------------------------
_Pairs = Sequence[tuple[WalkingCase, Outcome]]
_Groups = Mapping[tuple[str, Gait], _Pairs]
"""By errors and gait."""


@dataclass(frozen=True)
class Metric:
    """A quantity of the study."""

    title: str
    unit: str
    key: str  # of a method's values
    scale: float  # factor to the unit
    # median, high: bounds of median and 95th percentile under `standard`, of robots that walk; None for none
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

    def bounds(self, errors: str, gait: str, method: str) -> Bounds:
        """Of median and 95th percentile."""
        if method != WALKING or gait == "shake":
            return None, None
        wider = 1.0 if errors == "standard" else self.harsher
        median, high = (None if bound is None else bound * wider for bound in (self.median, self.high))
        return median, high


METRICS = (
    Metric("payload mass", "% of the robot's", "soon.payload_mass", 100.0, 0.2, 0.6, of_robot=True),
    Metric("shift of the trunk's CoM, x-y", "mm", "soon.shift_xy", 1e3, 1.5, 4.0),
    Metric("payload's CoM, x-y", "mm", "soon.payload_xy", 1e3, 5.0, None, least_share=0.10),
    Metric("trunk's CoM, z, after 3 s", "mm", "late.com_z", 1e3, None, 10.0),
)


def summary(grid: Sequence[WalkingCase], runs: Sequence[Outcome]) -> ExperimentResult:
    """Summarises any part of the grid."""
    pairs = list(zip(grid, runs, strict=True))
    found = grouped(pairs, lambda case: (case.errors, case.gait))
    groups = {(errors, gait): found[errors, gait] for errors in ERRORS for gait in GAITS if (errors, gait) in found}
    records = {key: list(_records(*key, chosen)) for key, chosen in groups.items()}
    return PAPER.result(
        [record for of_group in records.values() for record in of_group],
        (_table(groups), _by_robot(pairs), _behaviour(groups, records)),
        facts={
            "Runs": f"{len(pairs)}",
            "Robots": ", ".join(dict.fromkeys(c.robot for c in grid)),
            "Plant": "MuJoCo, 1 kHz, controllers in the loop",
        },
    )


EXPERIMENT = PAPER.experiment(cases, weigh_in_motion, summary, keeps=True)


def _records(errors: str, gait: str, pairs: _Pairs) -> Iterator[Record]:
    case: CaseValues = {"errors": errors, "gait": gait, "method": WALKING}
    for metric in METRICS:
        if metric.values(pairs, WALKING):
            for method in METHODS:
                values, bounds = metric.values(pairs, method), metric.bounds(errors, gait, method)
                yield from PAPER.spread({**case, "method": method}, metric.title, metric.unit, values, bounds)
    yield from _calibration(case, errors, [run["methods"][WALKING] for _, run in pairs])
    yield from _noticing(case, [run for _, run in pairs])


def _calibration(case: CaseValues, errors: str, figures: Sequence[Mapping[str, Any]]) -> Iterator[Record]:
    given = [f for f in figures if f.get("loaded.nees") is not None]
    if not given:
        return
    count = sum(f["loaded.observed"] for f in given)
    nees = sum(f["loaded.nees"] for f in given) / count
    low, high = (float(limit) for limit in chi2.ppf([0.025, 0.975], count) / count)
    bounded = errors == "standard"
    yield PAPER.record(case, "NEES / n, not more than chance makes it", "1", nees, bound=high if bounded else None)
    yield PAPER.least(case, "NEES / n, not less", "1", nees, low if bounded else None)


def _noticing(case: CaseValues, runs: Sequence[Outcome]) -> Iterator[Record]:
    stood = [run for run in runs if run["fell"] is None]
    yield PAPER.record(case, "falls", "1", float(len(runs) - len(stood)))
    noticed = [run["noticed"] for run in stood if run["noticed"] is not None]
    if stood:
        yield PAPER.record(case, "loads not noticed", "1", float(len(stood) - len(noticed)), bound=0.0)
    if noticed:
        yield PAPER.record(case, "load noticed after, longest", "s", float(max(noticed)), bound=0.2)
    yield PAPER.record(case, "false alarms", "1", float(sum(run["false_alarms"] for run in runs)), bound=0.0)
    share = float(np.median([run["share_of_time"] for run in runs]))
    yield PAPER.record(case, "estimator's time in the robot's, median", "1", share)


def _head(first: str) -> tuple[str, ...]:
    return (first, *(f"{metric.title} [{metric.unit}]" for metric in METRICS))


def _table(groups: _Groups) -> TableData:
    def row(errors: str, gait: str, pairs: _Pairs, method: str) -> Row:
        return (METHODS[method], *(spread(m.values(pairs, method), m.bounds(errors, gait, method)) for m in METRICS))

    body = {
        f"{gait}, {errors}": [row(errors, gait, pairs, method) for method in METHODS]
        for (errors, gait), pairs in groups.items()
    }
    note = "Median; 95th percentile. Coloured where something was promised."
    return TableData.of("Errors of every method", _head("method"), body, note)


def _by_robot(pairs: _Pairs) -> TableData:
    body: dict[str, list[Row]] = {}
    for (errors, robot), own in grouped(pairs, lambda case: (case.errors, case.robot)).items():
        body.setdefault(errors, []).append((robot, *(spread(m.values(own, WALKING)) for m in METRICS)))
    return TableData.of("The walking estimator, by robot", _head("robot"), body, "Median; 95th percentile.")


def _behaviour(groups: _Groups, records: Mapping[tuple[str, Gait], Sequence[Record]]) -> TableData:
    head = ("", "runs", "falls", "not noticed", "noticed after [s], longest", "false alarms", "NEES / n")
    rows: list[Row] = []
    for (errors, gait), pairs in groups.items():
        by = {r.metric: r.value for r in records[errors, gait] if r.case["method"] == WALKING}
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
