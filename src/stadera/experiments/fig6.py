"""Fig. 6: a load is put on while the robot stands, and contact forces find the new centre of mass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.control import TestBed, TrunkController
from stadera.estimate import ContactForceEstimator
from stadera.estimate.contact_com import ContactCom
from stadera.estimate.convergence import settling_time
from stadera.experiments.result import (
    Cell,
    Experiment,
    ExperimentResult,
    FigureData,
    Line,
    Panel,
    Progress,
    Record,
    ReproduceSettings,
    Steps,
    TableData,
)
from stadera.experiments.standing_case import load_point
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.sim import IDEAL, Plant, Sensors, VirtualForce

Array = NDArray[np.float64]

NAME = "fig6"

_LOAD = 100.0  # N
_BEFORE, _AFTER = 1.0, 5.0  # s
_ACCURACY = 0.002  # m
_FAST = 0.6  # s, the settling time asked for
_BOUND = 2.0  # s
_LEAD = (
    "HyQ stands and knows its trunk. At zero time 100 N begin to press at (-0.75, 0.4, 0.0) m in the trunk's frame, "
    "and nobody is told. Contact forces, method (c), find mass and centre of mass anew, and the controller takes them "
    "over while they are on the way."
)
_NOTES = (
    "The time counts from the load on, the tilting of the trunk included, until the error stays below 2 mm for good.",
    "The paper prints the step of its experiments, α = 0.002 at 1 kHz, which leaves 5 % of an error after 1.5 s, and "
    "not that of this figure. Both are run: that step, and one for 0.6 s.",
)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The estimate after the load was put on; time [s] from there, (k,); com (k, 3) [m]; true_com (3,) [m]."""

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
        above = np.flatnonzero(self.error >= _ACCURACY)
        return float(self.time[above[-1]]) if len(above) else 0.0


def trajectory(settling: float, seed: int) -> Trajectory:
    """Puts the load on a standing HyQ that weighs itself with this settling time [s]."""
    robot = load_robot("hyq")
    plant = Plant(robot)
    plant.reset(standing_configuration(robot))
    controller = TrunkController(robot)
    forces = ContactForceEstimator(robot, legs=controller.legs)
    estimator = ContactCom(robot, forces=forces, settling=settling)
    bed = TestBed(plant, Sensors(IDEAL, seed, robot), controller, estimator, feed_back=True)
    bed.run(_BEFORE)
    plant.apply_payload(VirtualForce(_LOAD, load_point(robot)))
    applied, times, coms = plant.time, [0.0], [estimator.estimate().trunk.com_trunk]

    def note(bed: TestBed) -> None:
        times.append(bed.plant.time - applied)
        coms.append(estimator.estimate().trunk.com_trunk)

    bed.run(_AFTER, note)
    return Trajectory(settling, np.array(times), np.array(coms), plant.truth().com)


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """One trajectory with a fast step, one with the paper's."""
    step = Steps(NAME, progress)
    ways = []
    for settling in (_FAST,) if settings.quick else (_FAST, settling_time()):
        step(f"weighing with a settling time of {settling:.1f} s")
        ways.append(trajectory(settling, settings.seed))
    step.finished()
    return ExperimentResult(
        name=NAME,
        title="Fig. 6: the centre of mass after a load is put on",
        lead=_LEAD,
        records=tuple(record for way in ways for record in _records(way)),
        tables=(_table(ways),),
        figures=tuple(_figure(way) for way in ways),
        notes=_NOTES,
        facts={"Robot": "hyq", "Load": f"{_LOAD:g} N", "Plant": "MuJoCo, 1 kHz, controller and estimator in the loop"},
    )


def _records(way: Trajectory) -> tuple[Record, ...]:
    fast = way.settling == _FAST
    case: dict[str, str | float] = {"settling time asked for [s]": round(way.settling, 3)}
    return (
        Record(NAME, case, "time to stay under 2 mm", "s", way.reached, 2.0, _BOUND if fast else None),
        Record(NAME, case, "‖δ‖ in x-y when the load comes on", "cm", 100 * float(way.error[0])),
        Record(NAME, case, "‖δ‖ in x-y at the end", "cm", 100 * float(way.error[-1])),
    )


def _table(ways: list[Trajectory]) -> TableData:
    head = ("settling time asked for", "‖δ‖ at first [cm]", "under 2 mm after [s] (paper)", "‖δ‖ at the end [cm]")
    rows = tuple(
        (
            Cell(f"{way.settling:.2f} s"),
            Cell(f"{100 * way.error[0]:.2f}"),
            Cell(f"{way.reached:.2f} (2)", strong=True),
            Cell(f"{100 * way.error[-1]:.4f}"),
        )
        for way in ways
    )
    return TableData("How fast", head, (("", rows),), "The settling time is that after which 5 % of an error is left.")


def _figure(way: Trajectory) -> FigureData:
    panels = []
    for axis, name in enumerate("xy"):
        lines = (
            Line("estimate", "identified", way.time, way.com[:, axis]),
            Line("truth", "prior", way.time[[0, -1]], np.full(2, way.true_com[axis])),
        )
        panels.append(Panel(f"trunk's centre of mass, {name}", "time since the load [s]", f"{name} [m]", lines))
    error = Line("‖δ‖ in x-y", "measured", way.time, np.maximum(1000 * way.error, 1e-3))
    panels.append(Panel("error", "time since the load [s]", "‖δ‖ [mm]", (error,), log_y=True))
    return FigureData(f"Settling time of {way.settling:.2f} s", tuple(panels))


EXPERIMENT = Experiment(NAME, "Fig. 6, the centre of mass after a load is put on", run)
