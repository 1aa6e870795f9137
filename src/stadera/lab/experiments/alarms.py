"""False alarms of the walking estimator: loads reported for unloaded robots.

They stand, set out, walk, turn, stop and sway at random.
"""

from __future__ import annotations

import time
import zlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.stats import chi2

from stadera.constants import GRAVITY
from stadera.lab.control import Crawl, CrawlCommand, Shake, TestBed, Trot, TrunkController
from stadera.lab.control.monitor import WalkMonitor, walk
from stadera.lab.control.stand import Controller
from stadera.lab.experiments.result import CaseValues, ExperimentResult, Record
from stadera.lab.experiments.runner import Outcome, Paper, ReproduceSettings, grouped
from stadera.lab.plant import Plant, Sensors, estimator_model, plant_model, sensor_errors
from stadera.lab.plant.payload import Tray
from stadera.lab.supervise.trusted import TrustedEstimator
from stadera.report.table import Cell, Row, TableData
from stadera.robot import load_robot
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import Measurement, TrunkEstimator, TrunkModel
from stadera.trunk.protocol import TrunkEstimate

PAPER = Paper.of("alarms")

Gait = Literal["crawl", "trot", "shake"]
"""Motion of a robot; a shake is on the spot."""

ROBOTS = ("hyq", "go2", "anymal_c", "b1")
GAITS: tuple[Gait, ...] = ("trot", "crawl", "shake")
SEEDS = {"standard": 5, "harsh": 2}

Doing = Literal["standing", "start", "steady", "turning", "stop", "shaking"]
DOING: tuple[Doing, ...] = ("standing", "start", "steady", "turning", "stop", "shaking")
"""Parts of a schedule; start and stop are counted from the command on."""


@dataclass(frozen=True)
class AlarmCase:
    """Settings of one run."""

    robot: str
    gait: Gait  # crawl, trot or shake
    errors: str  # of the sensors, a named set
    seed: int  # of sensors and commands
    seconds: float = 60.0  # simulated time; a shorter run is the beginning of a longer one


def cases(settings: ReproduceSettings) -> list[AlarmCase]:
    """The grid, `standard` first, seed by seed; a small part of it in quick mode."""
    if settings.quick:
        return [AlarmCase("go2", gait, "standard", settings.seed, 6.0) for gait in GAITS]
    return [
        AlarmCase(robot, gait, errors, settings.seed + k)
        for errors, seeds in SEEDS.items()
        for k in range(settings.seeds or seeds)
        for robot in ROBOTS
        for gait in GAITS
    ]


# -- schedules --------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class ScheduleSettings:
    """Settings of the robot's motion in the study."""

    start: float = 1.0  # time for it [s]
    stop: float = 1.5  # time for it [s]
    slower: float = 2.0  # factor on all times for a crawl
    trot: float = 0.26  # fastest trot, as a share of √(g h): 0.6 m/s for HyQ
    trot_turn: float = 0.4  # the fastest [rad/s]
    crawl_speed: float = 0.1  # the fastest [m/s]
    crawl_turn: float = 0.1  # the fastest [rad/s]
    looks: float = 0.02  # interval for evaluating the robot's activity [s]
    # the estimator's prior: a share of the trunk's mass, and its centre off by a share of the hips' half spacing
    light: float = 0.9
    off: float = 0.15
    hold: int = 2  # periods for which torques are held; sensors and estimator run at 1 kHz all the same


_HOW = ScheduleSettings()


@dataclass(frozen=True)
class Activity:
    """One part of a schedule."""

    doing: Doing  # kind of activity
    seconds: float  # duration
    ahead: float = 0.0  # share of the fastest speed, 0 to 1
    turn: float = 0.0  # share of the fastest turn, -1 to 1, to the left
    amplitude: float = 0.0  # of a shake

    @property
    def walked(self) -> bool:
        return self.doing in ("start", "steady", "turning")


def schedule(gait: Gait, rng: np.random.Generator) -> Iterator[Activity]:
    """Yields random activities without end; a trot sometimes shakes when it stands, a crawl takes longer."""
    slower = _HOW.slower if gait == "crawl" else 1.0
    yield Activity("standing", rng.uniform(0.3, 2.0))
    while True:
        if gait == "shake":
            yield from _shake(rng)
            continue
        ahead, turn = rng.uniform(0.0, 1.0), rng.uniform(-0.5, 0.5)
        yield Activity("start", _HOW.start * slower, ahead, turn)
        for _ in range(rng.integers(1, 4)):
            if rng.uniform() < 0.5:
                yield Activity("turning", rng.uniform(2.0, 4.0) * slower, ahead, rng.choice((-1.0, 1.0)))
            ahead = rng.uniform(0.0, 1.0)
            yield Activity("steady", rng.uniform(2.0, 5.0) * slower, ahead, 0.0)
        yield Activity("stop", _HOW.stop * slower)
        yield Activity("standing", rng.uniform(0.5, 2.0))
        if gait == "trot" and rng.uniform() < 0.3:
            yield from _shake(rng)


def _shake(rng: np.random.Generator) -> Iterator[Activity]:
    yield Activity("shaking", rng.uniform(2.0, 6.0), amplitude=rng.uniform(0.3, 1.0))
    yield Activity("stop", _HOW.stop)
    yield Activity("standing", rng.uniform(0.5, 2.0))


# -- runs -------------------------------------------------------------------------------------------------------------
def watch(case: AlarmCase) -> dict[str, Any]:
    """Changes of load reported in a run without a load.

    `fell`: None, or a description. `seconds`: simulated time by activity. `stepped`: time in seconds in which feet were
    lifted and put down. `alarms`: every reported change: its `time`, when it was `noticed`, the robot's activity
    `doing` at that time, and its `mass` as a share of the robot's. `halts`: when and why a crawl stopped unasked.
    `share_of_time`: the estimator's processor time divided by the simulated time.
    """
    run = _ScheduledRun(case)
    run.go()
    return {
        "fell": None if run.monitor.fall is None else run.monitor.fall.how,
        "seconds": dict(run.seconds),
        "stepped": run.stepped,
        "alarms": [run.alarm(change.time, change.noticed, change.mass) for change in run.estimator.inner.changes],
        "halts": run.halts,
        "share_of_time": run.estimator.seconds / max(run.bed.plant.time, 1e-3),
    }


class _Timed:
    """An estimator and its processor time [s]."""

    def __init__(self, inner: TrunkEstimator) -> None:
        self.inner, self.seconds = inner, 0.0

    def update(self, measurement: Measurement) -> None:
        begin = time.process_time()
        self.inner.update(measurement)
        self.seconds += time.process_time() - begin

    def estimate(self) -> TrunkEstimate:
        return self.inner.estimate()


class _ScheduledRun:
    """A robot that follows its schedule, and whose controller uses the walking estimator's trunk once it is accurate
    enough.
    """

    def __init__(self, case: AlarmCase) -> None:
        self.case, self.robot = case, load_robot(case.robot)
        draw = zlib.crc32(f"{case.robot} {case.gait} {case.errors} {case.seed}".encode())
        sizes = sensor_errors(case.errors)
        real = plant_model(self.robot, sizes)
        model = estimator_model(real, sizes, draw)
        self.controller = _controller_of(case.gait, model, TrunkModel.prior(self.robot))
        self.estimator = _Timed(TrunkEstimator(model, start=_wrong_start(self.robot)))
        plant, trusted = Plant(real), TrustedEstimator(self.estimator, self.robot)
        plant.reset(standing_configuration(self.robot))
        sensors = Sensors(sizes, draw, self.robot)
        self.bed = TestBed(plant, sensors, self.controller, trusted, feed_back=True, hold=_HOW.hold)
        self.monitor = WalkMonitor(plant)
        self.seconds: dict[Doing, float] = defaultdict(float)
        self.stepped = 0.0
        self.halts: list[dict[str, Any]] = []
        self._did: list[tuple[float, Doing]] = []
        self._schedule = schedule(case.gait, np.random.default_rng(draw))

    def go(self) -> None:
        controller, plant = self.controller, self.bed.plant
        for activity in self._schedule:
            if self._did:  # a controller accepts commands after its first update
                _command(controller, activity)
            end = min(plant.time + activity.seconds, self.case.seconds)
            while plant.time < end - 0.5 * _HOW.looks:
                self._look(activity)
                if walk(self.bed, _HOW.looks, self.monitor) is not None:
                    return
            if plant.time >= self.case.seconds - _HOW.looks:
                return

    def _look(self, activity: Activity) -> None:
        controller, doing = self.controller, activity.doing
        stepping = _steps(controller)
        if isinstance(controller, Crawl) and controller.failed and not stepping:
            doing = "standing"
            halt = {"time": controller.events[-1].time, "reason": controller.reason}
            if halt not in self.halts:
                self.halts.append(halt)
        self._did.append((self.bed.plant.time, doing))
        self.seconds[doing] += _HOW.looks
        self.stepped += _HOW.looks * stepping

    def alarm(self, time: float, noticed: float, mass: float) -> dict[str, Any]:
        """A reported change, and the robot's activity at its time."""
        doing = [doing for begin, doing in self._did if begin <= time] or ["standing"]
        return {"time": time, "noticed": noticed, "doing": doing[-1], "mass": mass / self.robot.mass}


def _wrong_start(robot: Robot) -> TrunkModel:
    prior, tray = TrunkModel.prior(robot), Tray.of(robot)
    return TrunkModel(_HOW.light * prior.mass, prior.com_trunk + _HOW.off * np.array([*tray.half_size[:2], 0.0]))


def _controller_of(gait: Gait, model: Robot, trunk: TrunkModel) -> Controller:
    if gait == "trot":
        return Trot.of(model, trunk)
    controller = TrunkController(model, trunk=trunk)
    return Crawl(controller) if gait == "crawl" else controller


def _steps(controller: Controller) -> bool:
    """True if it lifts feet and puts them down."""
    if isinstance(controller, Trot):
        return controller.stepping
    return isinstance(controller, Crawl) and controller.leg is not None


def _command(controller: Controller, activity: Activity) -> None:
    """Commands an activity.

    A trot that has not come to rest yet does not shake; a crawl that has failed stands until the next start.
    """
    if isinstance(controller, Crawl):
        if not activity.walked:
            controller.request_stop("the schedule says so")
        elif not controller.failed or activity.doing == "start":
            controller.command = CrawlCommand(_HOW.crawl_speed * activity.ahead, _HOW.crawl_turn * activity.turn)
            controller.resume()
    elif isinstance(controller, Trot):
        if activity.walked:
            fastest = _HOW.trot * GRAVITY * controller.settings.pendulum
            controller.walk((fastest * activity.ahead, 0.0), _HOW.trot_turn * activity.turn)
        elif controller.stepping:
            controller.stop()
        else:
            _command(controller.controller, activity)
    elif isinstance(controller, TrunkController):
        if activity.doing == "shaking":
            shake = Shake.of(controller.robot, controller.reference, controller.time, activity.amplitude)
            controller.follow(shake)
        elif activity.doing == "stop":
            controller.move(controller.reference.moved(np.zeros(3), np.zeros(3)), 0.7 * activity.seconds)


# -- summary ----------------------------------------------------------------------------------------------------------
_Pairs = Sequence[tuple[AlarmCase, Outcome]]


def summary(grid: Sequence[AlarmCase], runs: Sequence[Outcome]) -> ExperimentResult:
    """Summarises any part of the grid."""
    pairs = list(zip(grid, runs, strict=True))
    found = grouped(pairs, lambda case: case.errors)
    by_errors = {errors: found[errors] for errors in SEEDS if errors in found}
    return PAPER.result(
        (record for errors, chosen in by_errors.items() for record in _records(errors, chosen)),
        (_by_robot(by_errors), _by_doing(by_errors), _each(pairs)),
        facts={
            "Runs": f"{len(pairs)}",
            "Robots": ", ".join(dict.fromkeys(c.robot for c in grid)),
            "Watched": "; ".join(f"{minutes(chosen):.1f} min, {errors}" for errors, chosen in by_errors.items()),
            "Plant": "MuJoCo, 1 kHz, controllers in the loop, asked every other period",
        },
    )


EXPERIMENT = PAPER.experiment(cases, watch, summary, keeps=True)


def highest_rate(alarms: int, minutes: float, confidence: float = 0.95) -> float:
    """Upper end of the one-sided 95 % confidence interval of a Poisson process' rate [1/h]: χ²(2 n + 2) / 2 T."""
    return float(chi2.ppf(confidence, 2 * (alarms + 1))) / 2.0 / (minutes / 60.0)


def minutes(pairs: _Pairs) -> float:
    """Simulated time [min]."""
    return sum(sum(r["seconds"].values()) for _, r in pairs) / 60.0


def _count(pairs: _Pairs, what: str) -> int:
    return sum(len(r[what]) for _, r in pairs)


def _falls(pairs: _Pairs) -> int:
    return sum(r["fell"] is not None for _, r in pairs)


def _of(pairs: _Pairs, gait: str) -> _Pairs:
    return [(c, r) for c, r in pairs if gait in ("all", c.gait)]


def _records(errors: str, pairs: _Pairs) -> Iterator[Record]:
    promised = 0.0 if errors == "standard" else None
    for gait in ("all", *GAITS):
        if not (chosen := _of(pairs, gait)):
            continue
        time, alarms = minutes(chosen), _count(chosen, "alarms")
        stepped = sum(float(r["stepped"]) for _, r in chosen) / 60.0
        case: CaseValues = {"errors": errors, "gait": gait, "watched [min]": round(time, 2)}
        rate = highest_rate(alarms, time)
        yield PAPER.record(case, "false alarms", "1", float(alarms), bound=promised)
        yield PAPER.record(case, "rate of false alarms, not above, to 95 %", "1/h", rate)
        yield PAPER.record(case, "time in which feet stepped", "min", stepped)
        yield PAPER.record(case, "falls", "1", float(_falls(chosen)))
        yield PAPER.record(case, "crawls that stopped by themselves", "1", float(_count(chosen, "halts")))


def _alarm_cell(pairs: _Pairs) -> Cell:
    """Number of alarms, and the simulated minutes."""
    if not pairs:
        return Cell("–")
    count = _count(pairs, "alarms")
    return Cell(f"{count} in {minutes(pairs):.1f} min", strong=count > 0, good=count == 0)


def _by_robot(by_errors: Mapping[str, _Pairs]) -> TableData:
    groups: dict[str, list[Row]] = {}
    for errors, pairs in by_errors.items():
        for robot, own in {**grouped(pairs, lambda case: case.robot), "all": pairs}.items():
            cells = (_alarm_cell(_of(own, gait)) for gait in (*GAITS, "all"))
            rate = highest_rate(_count(own, "alarms"), minutes(own))
            row: Row = (robot, *cells, f"{rate:.1f}", f"{_falls(own)}", f"{_count(own, 'halts')}")
            groups.setdefault(errors, []).append(row)
    head = ("robot", *GAITS, "all", "rate at most [1/h]", "falls", "crawls stopped")
    note = "Rate: exact one-sided 95 % bound. Crawls stopped: those that did so by themselves."
    return TableData.of("False alarms by robot and gait", head, groups, note)


def _by_doing(by_errors: Mapping[str, _Pairs]) -> TableData:
    groups: dict[str, list[Row]] = {}
    for errors, pairs in by_errors.items():
        for doing in DOING:
            time = sum(float(r["seconds"].get(doing, 0.0)) for _, r in pairs) / 60.0
            count = sum(alarm["doing"] == doing for _, r in pairs for alarm in r["alarms"])
            cell = Cell(f"{count}", strong=count > 0, good=count == 0)
            groups.setdefault(errors, []).append((doing, f"{time:.1f}", cell))
    return TableData.of("By what the robot did", ("", "time [min]", "false alarms"), groups)


def _each(pairs: _Pairs) -> TableData:
    rows = [
        (
            f"{c.robot}, {c.gait}, {c.errors}, seed {c.seed}",
            f"{alarm['time']:.2f}",
            f"{alarm['noticed']:.2f}",
            str(alarm["doing"]),
            f"{100.0 * alarm['mass']:+.1f}",
        )
        for c, r in pairs
        for alarm in r["alarms"]
    ]
    head = ("run", "at [s]", "named at [s]", "while", "mass [% of the robot's]")
    return TableData.of("Every false alarm", head, rows or [("none", "", "", "", "")])
