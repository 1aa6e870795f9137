"""The share of inertial forces in the joint torques of a crawl (section III), at four speeds.

Over one cycle the paper compares the integral of the norm of the joint torques with that of "the joint torques related
to inertial forces". Here both are computed from the plant's truth. The equations of motion are split into the part
required at rest in the same configuration, and the part due to motion::

    τ = (g_j + n_j) - Jᵀ f,            G f = w_g + w_n
    f = f_g + f_n + f_0,   f_g = G⁺ w_g,   f_n = G⁺ w_n,   G f_0 = 0

with f the contact forces, G their map to a wrench on the robot, w_g the counterpart of the weight, w_n the inertial
wrench of all links (accelerations, centrifugal and Coriolis), g_j and n_j the corresponding joint torques, f_0 internal
to the feet. The least forces (G⁺) are used for both parts, so that the split does not depend on the controller's
distribution. Then

    τ_n = n_j - Jᵀ f_n,              share = ∫ ‖τ_n‖ dt / ∫ ‖τ‖ dt.

Neither accelerations nor the trunk's tensor is needed: w_n = G f - w_g and n_j = τ + Jᵀ f - g_j - friction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import StaderaError
from stadera.inertia import skew
from stadera.lab.control.crawl import Crawl, CrawlPhase
from stadera.lab.control.legs import LegDynamics
from stadera.lab.control.monitor import Falls
from stadera.lab.control.stand import TestBed
from stadera.lab.control.steps import CrawlCommand
from stadera.lab.control.trunk import TrunkController
from stadera.lab.experiments.runner import ExperimentResult, Paper, Record, ReproduceSettings
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import IDEAL, Sensors
from stadera.lab.plant.world import TrueState
from stadera.report.table import Cell, Row, TableData
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array

PAPER = Paper.of("inertial_share")

_ROBOT = "hyq"


@dataclass(frozen=True, eq=False)
class Cycle:
    """One cycle of a crawl."""

    speed: float  # commanded
    reached: float  # [m/s]
    time: Array  # (k,) [s], evenly spaced
    torque: Array  # (k,) [N·m], norm of the joint torques
    inertial: Array  # (k,) [N·m], norm of the part due to motion

    @property
    def share(self) -> float:
        """∫ ‖τ_n‖ dt / ∫ ‖τ‖ dt."""
        return float(self.inertial.sum() / self.torque.sum())


class InertialTorques:
    """Splits the plant's joint torques; viscous friction, the only friction, belongs to neither part."""

    def __init__(self, robot: Robot) -> None:
        self._legs = LegDynamics(robot)
        self._viscous = np.array([robot.dynamics[joint].viscous for joint in robot.tree.joints])
        trunk = robot.inertias[robot.trunk]
        self._weight, self._mass = np.array([0.0, 0.0, robot.mass * GRAVITY]), robot.mass
        self._trunk_moment = trunk.first_moment

    def of(self, state: TrueState) -> Array:
        """τ_n (4, 3) [N·m] at a state of the plant, by leg."""
        rotation, zero = state.rotation, np.zeros(3)
        up = rotation.T @ np.array([0.0, 0.0, GRAVITY])
        legs = self._legs.at(state.joint_position, np.zeros(len(state.joint_position)), zero, up)
        touching = state.foot_contact
        points = np.where(touching[:, None], state.contact_point - state.position, 0.0) @ rotation
        forces, weight = state.foot_force @ rotation, self._weight @ rotation
        com = (self._trunk_moment + legs.moment) / self._mass
        moving = np.concatenate(
            [forces.sum(axis=0) - weight, np.cross(points, forces).sum(axis=0) - np.cross(com, weight)]
        )
        share = np.zeros_like(forces)
        wrench_map = np.hstack([np.vstack([np.eye(3), skew(point)]) for point in points[touching]])  # G (6, 3 k)
        share[touching] = np.linalg.lstsq(wrench_map, moving, rcond=None)[0].reshape(-1, 3)
        jacobians = legs.jacobians(points)
        effort = (state.effort - self._viscous * state.joint_velocity)[self._legs.columns]
        return np.asarray(effort - legs.bias + np.einsum("li,lij->lj", forces - share, jacobians))


def crawl_cycle(robot: Robot, speed: float) -> Cycle:
    """Lets a robot crawl, and keeps its second cycle, every other period; time limit 20 s."""
    plant = Plant(robot)
    plant.reset(standing_configuration(robot))
    crawl = Crawl(TrunkController(robot), command=CrawlCommand(speed))
    crawl.resume()
    bed, falls, split = TestBed(plant, Sensors(IDEAL, 0, robot), crawl), Falls(plant), InertialTorques(robot)
    rows: list[tuple[float, float, float, float]] = []
    while (cycles := _cycles(crawl)) <= 2:
        bed.run(2 * plant.timestep)
        falls.look()
        if falls.fall is not None or crawl.failed or plant.time > 20.0:
            how = falls.fall.how if falls.fall else crawl.reason or "no whole cycle"
            raise StaderaError(f"{robot.name} does not crawl at {speed:.3g} m/s: {how}")
        if cycles == 2:
            state = plant.state
            norms = float(np.linalg.norm(state.effort)), float(np.linalg.norm(split.of(state)))
            rows.append((state.time, *norms, float(state.position[0])))
    time, torque, inertial, way = np.array(rows).T
    return Cycle(speed, float((way[-1] - way[0]) / (time[-1] - time[0])), time - time[0], torque, inertial)


@dataclass(frozen=True)
class ShareCase:
    """A crawl at a speed [m/s]."""

    speed: float


def cases(settings: ReproduceSettings) -> list[ShareCase]:
    """The paper's speeds."""
    return [ShareCase(float(speed)) for speed in PAPER.values][-1 if settings.quick else 0 :]


def summary(_: Sequence[ShareCase], cycles: Sequence[Cycle]) -> ExperimentResult:
    return PAPER.result(
        (record for cycle in cycles for record in _records(cycle)),
        (_table(cycles),),
        facts={"Robot": _ROBOT, "Plant": "MuJoCo, 1 kHz, controller in the loop; sensors without errors"},
    )


EXPERIMENT = PAPER.experiment(cases, lambda case: crawl_cycle(load_robot(_ROBOT), case.speed), summary, alone=True)


def _records(cycle: Cycle) -> list[Record]:
    case = {"speed [cm/s]": round(100 * cycle.speed, 6)}
    metric = "share of inertial forces in the joint torques of one cycle"
    return [
        PAPER.record(case, metric, "%", 100 * cycle.share, PAPER.values[f"{cycle.speed:g}"]),
        PAPER.record(case, "speed reached", "cm/s", 100 * cycle.reached),
    ]


def _table(cycles: Sequence[Cycle]) -> TableData:
    head = ("", *(f"{100 * cycle.speed:.0f} cm/s" for cycle in cycles))
    rows: tuple[Row, ...] = (
        ("share here", *(Cell(f"{100 * cycle.share:.1f} %", strong=True) for cycle in cycles)),
        ("the paper's", *(f"{PAPER.values[f'{cycle.speed:g}']:.1f} %" for cycle in cycles)),
        ("speed reached", *(f"{100 * cycle.reached:.1f} cm/s" for cycle in cycles)),
        ("time of a cycle", *(f"{cycle.time[-1]:.2f} s" for cycle in cycles)),
    )
    return TableData.of("Inertial forces in the joint torques of one cycle", head, rows)


def _cycles(crawl: Crawl) -> int:
    """Number of times that the first leg of the sequence has lifted."""
    first = crawl.settings.sequence[0]
    return sum(event.phase is CrawlPhase.SWING and event.leg == first for event in crawl.events)
