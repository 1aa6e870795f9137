"""Fig. 6: a load is added to a standing robot, and contact forces determine the new centre of mass."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stadera.lab.control.stand import TestBed
from stadera.lab.control.trunk import TrunkController
from stadera.lab.experiments.runner import ExperimentResult, Paper, Record, ReproduceSettings, crossed
from stadera.lab.experiments.standing import load_point
from stadera.lab.laws.equilibrium import NoisyForces
from stadera.lab.laws.recursive import ContactCom, LawSettings, settling_time
from stadera.lab.plant.payload import VirtualForce
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import IDEAL, Sensors
from stadera.report.figures import Axis, Figure, Guide, Panel, Series, line, stacked
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array

PAPER = Paper.of("fig6")


@dataclass(frozen=True)
class Fig6Settings:
    """The run."""

    load: float = 100.0  # [N]
    before: float = 1.0  # time before the load [s]
    after: float = 5.0  # time after it [s]
    accuracy: float = 0.002  # error below which the load counts as found [m]
    fast: float = 0.6  # the shorter of the two settling times [s]; the other is the paper's


_HOW = Fig6Settings()


@dataclass(frozen=True, eq=False)
class Settling:
    """The estimate after the load was added; time [s] from then, (k,); com (k, 3) [m]; true_com (3,) [m]."""

    settling: float
    time: Array
    com: Array
    true_com: Array

    @property
    def error(self) -> Array:
        """‖δ‖ in x-y, (k,) [m]."""
        return np.asarray(np.linalg.norm((self.com - self.true_com)[:, :2], axis=1))

    @property
    def reached(self) -> float:
        """Time [s] from which the error stays below 2 mm; the whole run's where it never does."""
        above = np.flatnonzero(self.error >= _HOW.accuracy)
        return float(self.time[above[-1]]) if len(above) else 0.0


@dataclass(frozen=True)
class Fig6Case:
    """A run that settles in this time [s], and the seed of the sensors."""

    settling: float
    seed: int


def trajectory(case: Fig6Case) -> Settling:
    """Adds the load to a standing HyQ that weighs itself."""
    robot = load_robot("hyq")
    plant = Plant(robot)
    plant.reset(standing_configuration(robot))
    controller = TrunkController(robot)
    forces = NoisyForces(robot)
    estimator = ContactCom(robot, forces=forces, settings=LawSettings(settling=case.settling))
    bed = TestBed(plant, Sensors(IDEAL, case.seed, robot), controller, estimator, feed_back=True)
    bed.run(_HOW.before)
    plant.apply_payload(VirtualForce(_HOW.load, load_point(robot)))
    applied, times, coms = plant.time, [0.0], [estimator.estimate().trunk.com_trunk]

    def note(bed: TestBed) -> None:
        times.append(bed.plant.time - applied)
        coms.append(estimator.estimate().trunk.com_trunk)

    bed.run(_HOW.after, note)
    return Settling(case.settling, np.array(times), np.array(coms), plant.truth().com)


def cases(settings: ReproduceSettings) -> list[Fig6Case]:
    """A fast step, and the paper's."""
    settlings = (_HOW.fast,) if settings.quick else (_HOW.fast, settling_time())
    return [Fig6Case(settling, settings.seed) for settling in settlings]


def summary(_: Sequence[Fig6Case], ways: Sequence[Settling]) -> ExperimentResult:
    records = [record for way in ways for record in _records(way)]
    note = "In brackets the paper's. The settling time is that after which 5 % of an error is left."
    asked = "settling time asked for [s]"
    return PAPER.result(
        records,
        [crossed("How fast", records, lambda r: "", lambda r: f"{r.case[asked]} s", Record.label, asked, note)],
        [_figure(way) for way in ways],
        {"Robot": "hyq", "Load": f"{_HOW.load:g} N", "Plant": "MuJoCo, 1 kHz, controller and estimator in the loop"},
    )


EXPERIMENT = PAPER.experiment(cases, trajectory, summary, alone=True)


def _records(way: Settling) -> tuple[Record, ...]:
    bound = PAPER.bounds["reached"]
    case = {"settling time asked for [s]": round(way.settling, 3)}
    return (
        PAPER.record(case, "time to stay under 2 mm", "s", way.reached, PAPER.values["reached"], bound),
        PAPER.record(case, "‖δ‖ in x-y when the load comes on", "cm", 100 * float(way.error[0])),
        PAPER.record(case, "‖δ‖ in x-y at the end", "cm", 100 * float(way.error[-1])),
    )


def _figure(way: Settling) -> Figure:
    panels, since = [], Axis("time since the load [s]")
    for axis, name in enumerate("xy"):
        lines = (
            line(way.time, way.com[:, axis], "estimate", "blue"),
            Series(way.time[[0, -1]], np.full(2, way.true_com[axis]), "truth", "green", dashed=True),
        )
        panels.append(Panel(since, Axis(f"{name} [m]"), lines, title=f"trunk's centre of mass, {name}"))
    error = line(way.time, np.maximum(1000 * way.error, 1e-3), "‖δ‖ in x-y", "ink")
    bounds = (
        Guide(1000 * _HOW.accuracy, of="y", colour="red", name="2 mm"),
        Guide(PAPER.bounds["reached"], name="2 s"),
    )
    panels.append(Panel(since, Axis("‖δ‖ [mm]", log=True), (error,), bounds, "error"))
    return stacked(f"Settling time of {way.settling:.2f} s", panels)
