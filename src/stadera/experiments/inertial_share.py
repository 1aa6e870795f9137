"""The share of inertial forces in the joint torques of a crawl (section III), at four speeds.

Over one cycle the paper compares the integral of the norm of the joint torques with that of "the joint torques related
to inertial forces". Here, from the plant's truth. The equations of motion split into what rest would take at the same
place, and what the motion takes besides::

    τ = (g_j + n_j) - Jᵀ f,            G f = w_g + w_n
    f = f_g + f_n + f_0,   f_g = G⁺ w_g,   f_n = G⁺ w_n,   G f_0 = 0

with f the ground's forces, G their map to a wrench on the robot, w_g the weight's counterpart, w_n what the motion of
all links takes (accelerations, centrifugal and Coriolis), g_j and n_j the same of the joints, f_0 internal to the feet.
The least forces (G⁺) are taken for both parts, so that the split does not hang on how the controller shares out. Then

    τ_n = n_j - Jᵀ f_n,              share = ∫ ‖τ_n‖ dt / ∫ ‖τ‖ dt.

Neither accelerations nor the trunk's tensor are needed: w_n = G f - w_g and n_j = τ + Jᵀ f - g_j - friction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.control import Crawl, CrawlCommand, Phase, TestBed, TrunkController, WalkJudge, walk
from stadera.errors import StaderaError
from stadera.estimate import TrunkModel
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
from stadera.robot import Robot, load_robot
from stadera.robot.dynamics import LegDynamics
from stadera.robot.stance import standing_configuration
from stadera.sim import IDEAL, Plant, Sensors, TrueState

Array = NDArray[np.float64]

NAME = "inertial_share"

_PAPER = {0.05: 9.5, 0.10: 11.5, 0.15: 15.0, 0.20: 22.0}  # %, by speed [m/s]
_GRAVITY = 9.81
_EVERY = 2  # periods from one sample to the next
_LONGEST = 20.0  # s, of a run
_METRIC = "share of inertial forces in the joint torques of one cycle"
_LEAD = (
    "HyQ crawls over level ground and knows its trunk. Over its second cycle of four steps the joint torques that its "
    "motion takes are compared with all its joint torques: the integrals of their norms."
)
_NOTES = (
    "What the motion takes is worked out from the plant's truth: all torques less those that would hold the robot at "
    "rest in the same place, the ground's forces least in both. It contains the legs' swing and the feet's landing.",
    "The paper prints its speeds as 5, 10, 15 and 15 cm/s; the last is taken for 20. Its gait's cycle, stride and sway "
    "are not printed.",
)


@dataclass(frozen=True, eq=False)
class Cycle:
    """One cycle of a crawl.

    Attributes:
        speed: commanded, and
        reached: [m/s].
        time: (k,) [s], evenly spaced.
        torque: (k,) [N·m], norm of the joint torques, and
        inertial: (k,) [N·m], of those that the motion takes.
    """

    speed: float
    reached: float
    time: Array
    torque: Array
    inertial: Array

    @property
    def share(self) -> float:
        """∫ ‖τ_n‖ dt / ∫ ‖τ‖ dt."""
        return float(self.inertial.sum() / self.torque.sum())


class InertialTorques:
    """Splits a plant's joint torques; see the module.

    Args:
        robot: the plant's; its joints' viscous friction belongs to neither part, and it has no other.
    """

    def __init__(self, robot: Robot) -> None:
        self._legs = LegDynamics(robot)
        self._viscous = np.array([robot.dynamics[joint].viscous for joint in robot.tree.joints])
        trunk = robot.inertias[robot.trunk]
        self._weight, self._mass = np.array([0.0, 0.0, robot.mass * _GRAVITY]), robot.mass
        self._trunk_moment = trunk.first_moment

    def of(self, state: TrueState) -> Array:
        """τ_n (4, 3) [N·m] at a state of the plant, by leg."""
        rotation, zero = state.rotation, np.zeros(3)
        up = rotation.T @ np.array([0.0, 0.0, _GRAVITY])
        legs = self._legs.at(state.joint_position, np.zeros(len(state.joint_position)), zero, up)
        touching = state.foot_contact
        points = np.where(touching[:, None], state.contact_point - state.position, 0.0) @ rotation
        forces, weight = state.foot_force @ rotation, self._weight @ rotation
        com = (self._trunk_moment + legs.moment) / self._mass
        moving = np.concatenate(
            [forces.sum(axis=0) - weight, np.cross(points, forces).sum(axis=0) - np.cross(com, weight)]
        )
        share = np.zeros((4, 3))
        share[touching] = np.linalg.lstsq(_wrench_map(points[touching]), moving, rcond=None)[0].reshape(-1, 3)
        jacobians = legs.jacobians(points)
        effort = (state.effort - self._viscous * state.joint_velocity)[self._legs.columns]
        joints = effort - legs.bias + _transposed(jacobians, forces)
        return np.asarray(joints - _transposed(jacobians, share))


def crawl_cycle(robot: Robot, speed: float, skip: int = 1) -> Cycle:
    """Lets a robot crawl and keeps one cycle, after so many to get going.

    Raises:
        StaderaError: it fell, or stopped.
    """
    plant = Plant(robot)
    plant.reset(standing_configuration(robot))
    crawl = Crawl(TrunkController(robot, belief=TrunkModel.prior(robot)), command=CrawlCommand(speed))
    crawl.resume()
    bed, judge, split = TestBed(plant, Sensors(IDEAL, 0, robot), crawl), WalkJudge(plant), InertialTorques(robot)
    rows: list[tuple[float, float, float, float]] = []
    while (cycles := _cycles(crawl)) <= skip + 1:
        fall = walk(bed, _EVERY * plant.timestep, judge)
        if fall is not None or crawl.failed or plant.time > _LONGEST:
            how = fall.how if fall else crawl.reason or "no whole cycle"
            raise StaderaError(f"{robot.name} does not crawl at {speed:.3g} m/s: {how}")
        if cycles == skip + 1:
            state = plant.state
            norms = float(np.linalg.norm(state.effort)), float(np.linalg.norm(split.of(state)))
            rows.append((state.time, *norms, float(state.position[0])))
    time, torque, inertial, way = np.array(rows).T
    return Cycle(speed, float((way[-1] - way[0]) / (time[-1] - time[0])), time - time[0], torque, inertial)


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """The share at each of the paper's speeds."""
    robot, steps = load_robot("hyq"), Steps(NAME, progress)
    cycles = []
    for speed in list(_PAPER)[-1:] if settings.quick else _PAPER:
        steps(f"{100 * speed:.0f} cm/s")
        cycles.append(crawl_cycle(robot, speed))
    steps.finished()
    return ExperimentResult(
        name=NAME,
        title="The share of inertial forces in a crawl",
        lead=_LEAD,
        records=tuple(record for cycle in cycles for record in _records(cycle)),
        tables=(_table(cycles),),
        figures=(_figure(cycles),),
        notes=_NOTES,
        facts={"Robot": robot.name, "Plant": "MuJoCo, 1 kHz, controller in the loop; sensors without errors"},
    )


def _records(cycle: Cycle) -> list[Record]:
    case = {"speed [cm/s]": round(100 * cycle.speed, 6)}
    return [
        Record(NAME, case, _METRIC, "%", 100 * cycle.share, _PAPER[cycle.speed]),
        Record(NAME, case, "speed reached", "cm/s", 100 * cycle.reached),
    ]


def _table(cycles: list[Cycle]) -> TableData:
    head = ("", *(f"{100 * cycle.speed:.0f} cm/s" for cycle in cycles))
    rows = (
        (Cell("share here"), *(Cell(f"{100 * cycle.share:.1f} %", strong=True) for cycle in cycles)),
        (Cell("the paper's"), *(Cell(f"{_PAPER[cycle.speed]:.1f} %") for cycle in cycles)),
        (Cell("speed reached"), *(Cell(f"{100 * cycle.reached:.1f} cm/s") for cycle in cycles)),
        (Cell("time of a cycle"), *(Cell(f"{cycle.time[-1]:.2f} s") for cycle in cycles)),
    )
    return TableData("Inertial forces in the joint torques of one cycle", head, (("", rows),))


def _figure(cycles: list[Cycle]) -> FigureData:
    panels = tuple(
        Panel(
            f"{100 * cycle.speed:.0f} cm/s",
            "time in the cycle [s]",
            "norm of the joint torques [N·m]",
            (
                Line("all", "measured", cycle.time, cycle.torque),
                Line("by inertial forces", "identified", cycle.time, cycle.inertial),
            ),
        )
        for cycle in cycles
    )
    return FigureData("Joint torques over one cycle", panels)


def _cycles(crawl: Crawl) -> int:
    """How many times the first leg of the sequence has lifted."""
    first = crawl.settings.sequence[0]
    return sum(event.phase is Phase.SWING and event.leg == first for event in crawl.events)


def _wrench_map(points: Array) -> Array:
    """G (6, 3 k) of forces at points (k, 3)."""
    columns = np.zeros((6, 3 * len(points)))
    columns[:3] = np.tile(np.eye(3), len(points))
    for axis, unit in enumerate(np.eye(3)):
        columns[3:, axis::3] = np.cross(points, unit).T
    return columns


def _transposed(jacobians: Array, forces: Array) -> Array:
    """Jᵀ f, (4, 3)."""
    return np.asarray((forces[:, None, :] @ jacobians)[:, 0])


EXPERIMENT = Experiment(NAME, "Section III, the share of inertial forces in a crawl", run)
