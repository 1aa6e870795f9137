"""Table V: a walking robot is loaded, stops, and is weighed by contact forces (c) and by static poses (a)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stadera.errors import StaderaError
from stadera.lab.control.reference import TrunkPose
from stadera.lab.experiments.loaded_walk import LoadedWalk, LoadedWalkCase, weight_at
from stadera.lab.experiments.runner import ExperimentResult, Outcome, Paper, Record, ReproduceSettings, crossed
from stadera.lab.laws.static_poses import PoseOffset
from stadera.lab.supervise.supervisor import Mode, StoppingSupervisor
from stadera.lab.supervise.weighing import Lean, Stage, StandingWeighing
from stadera.report.table import Cell, Row, TableData
from stadera.robot import load_robot
from stadera.trunk.drives import Drives

PAPER = Paper.of("table5")


@dataclass(frozen=True)
class Table5Times:
    """Times of a run [s]."""

    load: float = 5.5  # time of the load
    ask: float = 6.0  # time at which a weighing is requested without a load
    longest: float = 45.0  # of a run
    every: int = 4  # control periods between two measurements used for weighing


@dataclass(frozen=True)
class Table5Case:
    """A load [N] and a seed."""

    load: float
    seed: int
    times: Table5Times = field(default_factory=Table5Times)


def weigh_on_the_way(case: Table5Case) -> Outcome:
    """Centres of mass (x, y) [m] from (c), from (c) with uncorrected torques and from (a), and the truth."""
    return _LoadedRun(case).outcome()


class _LoadedRun:
    def __init__(self, case: Table5Case) -> None:
        self.case, self.times = case, case.times
        payload = weight_at(load_robot("hyq"), "LH", case.load) if case.load else None
        self.walk = LoadedWalk(LoadedWalkCase(payload=payload, load_at=case.times.load, seed=case.seed))
        assert isinstance(self.walk.supervisor, StoppingSupervisor)
        self.supervisor = self.walk.supervisor
        self._periods = 0
        self._home: TrunkPose | None = None

    def outcome(self) -> Outcome:
        as_measured = self._by_forces()
        found = self.supervisor.trunk
        by_poses = self._weighed(self._weighing(self._lean, self.supervisor.estimator.drives))
        truth = self.walk.bed.plant.truth()
        return {
            "contact": found.com_trunk[:2].tolist(),
            "contact_as_measured": as_measured,
            "poses": by_poses,
            "truth": truth.com[:2].tolist(),
            "mass": found.mass,
            "true_mass": truth.mass,
        }

    def _by_forces(self) -> list[float]:
        """The supervisor's weighing, and another one of the same moments without correction of torque offsets."""
        supervisor, asked = self.supervisor, self.case.load > 0.0
        while all(transition.after is not Mode.WEIGHING_MASS for transition in supervisor.transitions):
            time = self._step()
            if not asked and time >= self.times.ask:
                supervisor.weigh("Table V asks for it")
                asked = True
        uncorrected = self._weighing()
        while supervisor.state is not Mode.CONVERGED:
            self._step(uncorrected)
        self.walk.supervisor = None  # it stays in place
        return self._weighed(uncorrected)

    def _weighing(self, lean: Lean | None = None, drives: Drives | None = None) -> StandingWeighing:
        supervisor, time = self.supervisor, self.walk.bed.plant.time
        return StandingWeighing(supervisor.forces, supervisor.trunk, time, lean=lean, drives=drives)

    def _lean(self, pose: PoseOffset, duration: float) -> None:
        """Moves the trunk to a pose relative to its reference at the first."""
        controller = self.walk.crawl.controller
        self._home = home = self._home or controller.reference
        controller.move(home.moved(home.rotation @ pose.shift, pose.turn), duration)

    def _weighed(self, weighing: StandingWeighing) -> list[float]:
        while weighing.stage is not Stage.DONE:
            if weighing.stage is Stage.FAILED:
                raise StaderaError(f"{self.case}: {weighing.reason}")
            self._step(weighing)
        assert weighing.estimate is not None
        return [float(c) for c in weighing.estimate.trunk.com_trunk[:2]]

    def _step(self, weighing: StandingWeighing | None = None) -> float:
        """Simulates one period; returns the time [s]."""
        self.walk.step()
        bed, self._periods = self.walk.bed, self._periods + 1
        if self.walk.monitor.fall is not None:
            raise StaderaError(f"{self.case}: the robot fell, {self.walk.monitor.fall.how}")
        if self.supervisor.state is Mode.STANDING:
            raise StaderaError(f"{self.case}: {self.supervisor.transitions[-1].reason}")
        if bed.plant.time > self.times.longest:
            raise StaderaError(f"{self.case}: not weighed within {self.times.longest} s")
        if weighing is not None and self._periods % self.times.every == 0 and bed.measurement is not None:
            weighing.update(bed.measurement)
        return bed.plant.time


def cases(settings: ReproduceSettings) -> list[Table5Case]:
    """All loads, several seeds each."""
    count = 1 if settings.quick else 5
    seeds = range(settings.seed, settings.seed + count)
    return [Table5Case(float(load), seed) for load in PAPER.values for seed in seeds]


def summary(cases: Sequence[Table5Case], outcomes: Sequence[Outcome]) -> ExperimentResult:
    loads = dict.fromkeys(case.load for case in cases)
    by_load = {load: [o for c, o in zip(cases, outcomes, strict=True) if c.load == load] for load in loads}
    count = len(cases) // len(loads)
    records = [record for load, found in by_load.items() for record in _records(load, found)]
    every = crossed(f"{count} seeds", records, lambda r: "", Record.label, lambda r: f"{r.case['load [N]']:g} N", "")
    return PAPER.result(
        records,
        (_first(by_load, cases[0].seed), every),
        facts={
            "Robot": "hyq",
            "Sensors": "standard errors",
            "Seeds": f"{count} a load",
            "Plant": "MuJoCo, 1 kHz, crawl, controller and supervisor in the loop",
        },
    )


EXPERIMENT = PAPER.experiment(cases, weigh_on_the_way, summary, keeps=True)


def distances(outcomes: Sequence[Outcome], one: str, other: str) -> list[float]:
    """‖δ‖ [cm] in x-y between two of a run's centres of mass, run by run."""
    return [100.0 * float(np.linalg.norm(np.subtract(o[one], o[other]))) for o in outcomes]


def _paper(load: float) -> float:
    return float(PAPER.values[f"{load:g}"])


def _records(load: float, outcomes: Sequence[Outcome]) -> Iterator[Record]:
    case, bound = {"load [N]": load}, PAPER.bounds["plane"]
    exact, raw = distances(outcomes, "contact", "truth"), distances(outcomes, "contact_as_measured", "truth")
    apart, poses = distances(outcomes, "contact", "poses"), distances(outcomes, "poses", "truth")
    masses = [abs(o["mass"] - o["true_mass"]) for o in outcomes]
    for metric, unit, value, paper, most in (
        ("(c) to the truth, ‖δ‖, median", "cm", np.median(exact), None, bound),
        ("(c) to the truth, ‖δ‖, largest", "cm", max(exact), None, bound),
        ("(c) to (a), ‖δ‖, median", "cm", np.median(apart), _paper(load), None),
        ("(a) to the truth, ‖δ‖, median", "cm", np.median(poses), None, None),
        ("(c) on torques as measured to the truth, ‖δ‖, median", "cm", np.median(raw), None, None),
        ("(c) on torques as measured to the truth, ‖δ‖, largest", "cm", max(raw), None, None),
        ("mass, |error|, largest", "kg", max(masses), None, None),
    ):
        yield PAPER.record(case, metric, unit, float(value), paper, most)


def _first(by_load: Mapping[float, list[Outcome]], seed: int) -> TableData:
    """The paper's table, of the first seed, and the truth."""
    rows: list[Row] = []
    for load, (first, *_) in by_load.items():
        (error,), (apart,) = distances([first], "contact", "truth"), distances([first], "contact", "poses")
        places = (f"({first[name][0]:.4f}, {first[name][1]:.4f})" for name in ("contact", "poses", "truth"))
        good = error <= PAPER.bounds["plane"]
        last = Cell(f"{error:.2f}", strong=True, good=good)
        rows.append((f"{load:.0f} N", *places, f"{apart:.2f} ({_paper(load):.2f})", last))
    head = ("payload", "(c) [m]", "(a) [m]", "truth [m]", "(c) to (a) [cm] (paper)", "(c) to the truth [cm]")
    return TableData.of("Table V", head, rows, f"Centres of mass of the trunk with its load, x and y; seed {seed}.")
