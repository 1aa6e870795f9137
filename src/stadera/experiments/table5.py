"""Table V: a robot that walks is loaded, stops, and is weighed by contact forces (c) and by static poses (a)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stadera.errors import StaderaError
from stadera.experiments.grid import Outcome, run_grid
from stadera.experiments.loaded_walk import LoadedWalk, LoadedWalkCase, weight_at
from stadera.experiments.result import (
    Cell,
    Experiment,
    ExperimentResult,
    Progress,
    Record,
    ReproduceSettings,
    TableData,
)
from stadera.robot import load_robot
from stadera.supervise import State, SuperviseSettings, Supervisor
from stadera.supervise.standing import StandingWalker
from stadera.supervise.weighing import Stage, StandingWeighing
from stadera.supervise.zeroed import ZeroedForces

NAME = "table5"

LOADS = (0.0, 50.0, 100.0)
PAPER = {0.0: 0.45, 50.0: 0.20, 100.0: 0.32}
"""Distance of (c) to (a) in the paper [cm], by load [N]."""

_BOUND = 0.45  # cm
_SEEDS = 5
_LOAD_AT, _ASK_AT = 5.5, 6.0  # s
_EVERY = 4  # periods, from one measurement that is weighed by to the next
_LONGEST = 45.0  # s
_LEAD = (
    "HyQ crawls at 10 cm/s with standard sensor errors, and a weight comes onto the left-hind corner of its back. The "
    "supervisor notices (without a load it is told), lets it stop, and has it weighed by contact forces, approach (c). "
    "Then the robot leans through five poses for batch least squares, approach (a). The paper had no ground truth; "
    "here both are held against it."
)
_NOTES = (
    "‖δ‖ is the distance in the trunk's x-y.",
    "Legs in the air tell the constant offsets of their torques on the way, and these are taken off before weighing. "
    "As the paper has it, without that, is (c) on torques as measured: the same moments of the same runs.",
    "Without a load the weighing begins at the model file's centre of mass, which is the true one.",
    "The load is a body fixed to the trunk, a cube of a decimetre on the corner of the back, above the hip.",
)


@dataclass(frozen=True)
class Table5Case:
    """A load [N] and a seed."""

    load: float
    seed: int


def weigh_on_the_way(case: Table5Case) -> Outcome:
    """Centres of mass (x, y) [m] by (c), by (c) on torques as measured and by (a), and the truth.

    Raises:
        StaderaError: the robot fell, or was not weighed.
    """
    return _Run(case).outcome()


class _Run:
    """A walk with a weighing in it, and another one after it."""

    def __init__(self, case: Table5Case) -> None:
        self.case = case
        payload = weight_at(load_robot("hyq"), "LH", case.load) if case.load else None
        self.walk = LoadedWalk(LoadedWalkCase(payload=payload, load_at=_LOAD_AT, seed=case.seed))
        assert isinstance(self.walk.supervisor, Supervisor)
        self.supervisor = self.walk.supervisor
        self._periods = 0

    def outcome(self) -> Outcome:
        as_measured = self._by_forces()
        found = self.supervisor.believed
        by_poses = self._weighed(self._weighing(self.supervisor.zeroed, "poses"))
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
        """Lets the supervisor weigh; beside it, from the same moment on, without torque offsets taken off."""
        supervisor, asked = self.supervisor, self.case.load > 0.0
        while not supervisor.weighing:
            time = self._step()
            if not asked and time >= _ASK_AT:
                supervisor.weigh("Table V asks for it")
                asked = True
        beside = self._weighing(ZeroedForces.none(supervisor.forces), "contact")
        while supervisor.state is not State.CONVERGED:
            self._step(beside)
        self.walk.supervisor = None  # it stays where it stands
        return self._weighed(beside)

    def _weighing(self, scale: ZeroedForces, method: str) -> StandingWeighing:
        settings, time = SuperviseSettings(method=method), self.walk.bed.plant.time
        walker = StandingWalker(self.walk.crawl.controller)
        return StandingWeighing(scale, self.supervisor.believed, walker, settings, time)

    def _weighed(self, weighing: StandingWeighing) -> list[float]:
        """Runs a weighing out; the centre of mass in x and y."""
        while weighing.stage is not Stage.DONE:
            if weighing.stage is Stage.FAILED:
                raise StaderaError(f"{self.case}: {weighing.reason}")
            self._step(weighing)
        assert weighing.estimate is not None
        return [float(c) for c in weighing.estimate.trunk.com_trunk[:2]]

    def _step(self, weighing: StandingWeighing | None = None) -> float:
        """One period; the time [s]."""
        self.walk.step()
        bed, self._periods = self.walk.bed, self._periods + 1
        if self.walk.judge.fall is not None:
            raise StaderaError(f"{self.case}: the robot fell, {self.walk.judge.fall.how}")
        if self.supervisor.state in (State.STANDING, State.SITTING):
            raise StaderaError(f"{self.case}: {self.supervisor.transitions[-1].reason}")
        if bed.plant.time > _LONGEST:
            raise StaderaError(f"{self.case}: not weighed within {_LONGEST} s")
        if weighing is not None and self._periods % _EVERY == 0 and bed.measurement is not None:
            weighing.update(bed.measurement)
        return bed.plant.time


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """All loads, several seeds each."""
    seeds = range(settings.seed, settings.seed + (1 if settings.quick else _SEEDS))
    cases = [Table5Case(load, seed) for load in LOADS for seed in seeds]
    outcomes = run_grid(NAME, weigh_on_the_way, cases, progress, settings.keep)
    by_load = {load: [o for c, o in zip(cases, outcomes, strict=True) if c.load == load] for load in LOADS}
    return ExperimentResult(
        name=NAME,
        title="Table V: weighed on the way",
        lead=_LEAD,
        records=tuple(record for load, found in by_load.items() for record in _records(load, found)),
        tables=(_first(by_load, settings.seed), _all(by_load)),
        notes=_NOTES,
        facts={
            "Robot": "hyq",
            "Sensors": "standard errors",
            "Seeds": f"{len(seeds)} a load",
            "Plant": "MuJoCo, 1 kHz, crawl, controller and supervisor in the loop",
        },
    )


def distances(outcomes: Sequence[Outcome], one: str, other: str) -> list[float]:
    """‖δ‖ [cm] in x-y between two of a run's centres of mass, run by run."""
    return [100.0 * float(np.linalg.norm(np.subtract(o[one], o[other]))) for o in outcomes]


def _records(load: float, outcomes: Sequence[Outcome]) -> tuple[Record, ...]:
    case: dict[str, str | float] = {"load [N]": load}
    exact, raw = distances(outcomes, "contact", "truth"), distances(outcomes, "contact_as_measured", "truth")
    return (
        Record(NAME, case, "(c) to the truth, ‖δ‖, median", "cm", float(np.median(exact)), None, _BOUND),
        Record(NAME, case, "(c) to the truth, ‖δ‖, largest", "cm", max(exact), None, _BOUND),
        Record(
            NAME,
            case,
            "(c) to (a), ‖δ‖, median",
            "cm",
            float(np.median(distances(outcomes, "contact", "poses"))),
            PAPER[load],
        ),
        Record(
            NAME, case, "(a) to the truth, ‖δ‖, median", "cm", float(np.median(distances(outcomes, "poses", "truth")))
        ),
        Record(NAME, case, "(c) on torques as measured to the truth, ‖δ‖, median", "cm", float(np.median(raw))),
        Record(NAME, case, "(c) on torques as measured to the truth, ‖δ‖, largest", "cm", max(raw)),
        Record(NAME, case, "mass, |error|, largest", "kg", max(abs(o["mass"] - o["true_mass"]) for o in outcomes)),
    )


def _first(by_load: dict[float, list[Outcome]], seed: int) -> TableData:
    """The paper's table, of the first seed, and the truth."""
    rows = []
    for load, outcomes in by_load.items():
        first = outcomes[:1]
        error = distances(first, "contact", "truth")[0]
        rows.append(
            (
                Cell(f"{load:.0f} N"),
                *(Cell(_place(first[0][name])) for name in ("contact", "poses", "truth")),
                Cell(f"{distances(first, 'contact', 'poses')[0]:.2f} ({PAPER[load]:.2f})"),
                Cell(f"{error:.2f}", strong=True, good=error <= _BOUND),
            )
        )
    head = ("payload", "(c) [m]", "(a) [m]", "truth [m]", "(c) to (a) [cm] (paper)", "(c) to the truth [cm]")
    return TableData(
        "Table V", head, (("", tuple(rows)),), f"Centres of mass of the trunk with its load, x and y; seed {seed}."
    )


def _all(by_load: dict[float, list[Outcome]]) -> TableData:
    """All seeds."""
    names = (("contact", "(c)"), ("contact_as_measured", "(c), torques as measured"), ("poses", "(a)"))
    rows = []
    for name, title in names:
        errors = [distances(outcomes, name, "truth") for outcomes in by_load.values()]
        cells = (
            Cell(f"{np.median(e):.2f}, {max(e):.2f}", strong=True, good=max(e) <= _BOUND if name == "contact" else None)
            for e in errors
        )
        rows.append((Cell(title), *cells))
    count = len(next(iter(by_load.values())))
    head = ("‖δ‖ to the truth [cm]: median, largest", *(f"{load:.0f} N" for load in by_load))
    return TableData(f"{count} seeds", head, (("", tuple(rows)),))


def _place(com: Sequence[float]) -> str:
    return f"({com[0]:.4f}, {com[1]:.4f})"


EXPERIMENT = Experiment(NAME, "Table V, weighed on the way", run)
