"""A crawling robot that is loaded, with or without a supervisor: for Table V, the survival study and the demo.

The plant is MuJoCo with sensor errors; crawl, estimators and supervisor receive measurements only. The plant's truth is
used for evaluation: whether the robot fell, and the margin of its centre of mass in the support polygon.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from stadera.constants import GRAVITY
from stadera.inertia import InertialParameters
from stadera.lab.control import TestBed, TrunkController
from stadera.lab.control.crawl.crawl import Crawl
from stadera.lab.control.crawl.run import Fall, WalkMonitor
from stadera.lab.control.crawl.settings import CrawlCommand, CrawlPhase
from stadera.lab.control.planner.feet import PlanError
from stadera.lab.control.trunk import ControlError
from stadera.lab.control.walkers import CrawlWalker
from stadera.lab.experiments.moving.outcome import Verdict, WalkTrace, verdict
from stadera.lab.plant import (
    STANDARD,
    DroppedBox,
    Payload,
    Plant,
    RigidMass,
    SensorErrors,
    Sensors,
    SimulationError,
    Terrain,
)
from stadera.lab.plant.payload import Tray
from stadera.lab.sensors import estimator_model, plant_model
from stadera.lab.supervise import LoadCheck, NonstopSupervisor, State, SuperviseSettings, Supervisor, Transition
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import ContactForceEstimator, TrunkModel
from stadera.trunk.load import Payload as FoundPayload
from stadera.types import Array

STAND = 1.0
"""Time for which the robot stands before it walks [s]: enough to weigh the tare."""

CORNERS = {"LF": (1, 1), "RF": (1, -1), "LH": (-1, 1), "RH": (-1, -1)}
"""Signs of x and y of the trunk's corners."""


_BRAKED = 10.0  # rad/s, above which braking drives apply their full torque


class Supervision(StrEnum):
    """Supervisor of a walk: none, or one that weighs the load at rest or while walking."""

    NONE = "without identification"
    STOPPING = "with identification"
    NONSTOP = "without a stop"


@dataclass(frozen=True, eq=False)
class LoadedWalkCase:
    """Settings of one walk."""

    robot: str = "hyq"
    payload: Payload | None = None  # the load added; None for none
    load_at: float = 5.0  # time at which it is added [s]
    unload_at: float = np.inf  # time at which all loads are removed [s]; never by default
    supervision: Supervision = Supervision.STOPPING  # without it, controller and planner keep the model file's trunk
    seconds: float = 20.0  # of the run, standing included
    speed: float = 0.1  # [m/s], ahead
    errors: SensorErrors = STANDARD  # of the sensors
    seed: int = 0  # of all draws
    terrain: Terrain | None = None  # None for the plane
    settings: SuperviseSettings | None = None  # of the supervisor that stops; None for the defaults

    @property
    def load(self) -> InertialParameters:
        """The load, in its own frame; zero for none."""
        return InertialParameters.zero() if self.payload is None else self.payload.parameters


@dataclass(frozen=True, eq=False)
class LoadedWalkOutcome:
    """Outcome of one walk."""

    case: LoadedWalkCase
    trace: WalkTrace  # true states, and the command
    # (k,) [m], of the true centre of mass in the support polygon at the trace's times: negative outside, NaN on fewer
    # than three feet
    margin: Array
    # first time with four feet in stance at least one step's time after the load [s], since no supervisor can affect
    # the previous step; NaN if there is none
    evaluated_from: float
    # transitions, checks, state: of the supervisor; empty, and WALKING, without one. A supervisor that does not stop
    # makes no checks.
    transitions: tuple[Transition, ...]
    checks: tuple[LoadCheck, ...]
    state: State
    noticed: tuple[float, ...]  # times of detection of changes of the load [s]
    model: TrunkModel  # trunk model of controller and planner at the end
    truth: InertialParameters  # the trunk with its load at the end
    bare: InertialParameters  # the trunk without it
    payload: FoundPayload | None  # as estimated by the supervisor; None without an estimate

    @cached_property
    def verdict(self) -> Verdict:
        return verdict(self.trace)

    @property
    def least_margin(self) -> float:
        """Least margin from `evaluated_from` on [m]; NaN without data."""
        return _least(self.margin[self.trace.time >= self._evaluated])

    @property
    def least_margin_ever(self) -> float:
        """Least margin since the load [m], including the step that no supervisor can affect."""
        return _least(self.margin[self.trace.since :])

    @property
    def outside(self) -> float:
        """Time for which the centre of mass was outside the support polygon, from `evaluated_from` on [s]."""
        since = self.margin[self.trace.time >= self._evaluated]
        return float((since < 0.0).sum()) * float(np.median(np.diff(self.trace.time)))

    @property
    def noticed_after(self) -> float:
        """Time from the load to the first detected change [s]; NaN if there is none."""
        times = [time for time in self.noticed if time >= self._from]
        return times[0] - self._from if times else float("nan")

    @property
    def updated_after(self) -> float | None:
        """Time from the load until the robot used a new trunk model [s]; None if it never did."""
        after = [t.time for t in self.transitions if t.after is State.WALKING and t.time >= self._from]
        return after[0] - self._from if after else None

    @property
    def _evaluated(self) -> float:
        return -np.inf if np.isnan(self.evaluated_from) else self.evaluated_from

    @property
    def _from(self) -> float:
        return -np.inf if np.isnan(self.trace.loaded_at) else self.trace.loaded_at


def _least(margin: Array) -> float:
    return float(np.nanmin(margin)) if np.isfinite(margin).any() else float("nan")


def corner_of(robot: Robot, corner: str) -> Array:
    """A corner of the trunk's back, trunk frame (3,) [m]."""
    tray = Tray.of(robot)
    return np.array([*(tray.centre[:2] + np.array(CORNERS[corner]) * tray.half_size[:2]), tray.top])


def box_at(
    robot: Robot, corner: str, mass: float, size: tuple[float, float, float], height: float = 0.05
) -> DroppedBox:
    """A box of a mass [kg] and edges [m] dropped from a height [m] on the back, flush with a corner."""
    (x, y), (sx, sy) = corner_of(robot, corner)[:2], CORNERS[corner]
    return DroppedBox(mass, size, (float(x - 0.5 * sx * size[0]), float(y - 0.5 * sy * size[1])), height=height)


def weight_at(robot: Robot, corner: str, force: float) -> RigidMass:
    """A cube of a decimetre with a weight [N], fixed to a corner of the back."""
    x, y, z = corner_of(robot, corner).tolist()
    return RigidMass.box(force / GRAVITY, (0.1, 0.1, 0.1), (x, y, z + 0.05))


Watch = Callable[["LoadedWalk"], None]


class LoadedWalk:
    """A walk in progress. `fault` says why the controller failed, so that the drives only brake."""

    def __init__(self, case: LoadedWalkCase) -> None:
        self.case, robot = case, load_robot(case.robot)
        real = plant_model(robot, case.errors)
        model = estimator_model(real, case.errors, case.seed)
        plant = Plant(real, case.terrain)
        plant.reset(standing_configuration(robot))
        controller = TrunkController(model)
        self.crawl = Crawl(controller, command=CrawlCommand(case.speed))
        self.bed = TestBed(plant, Sensors(case.errors, case.seed, robot), self.crawl)
        self.monitor = WalkMonitor(plant)
        self.loaded_at, self.evaluated_from, self.fault = np.nan, np.nan, ""
        self._bare, self._step_time = plant.truth(), self.crawl.settings.timing(self.crawl.command).step
        effort = np.array([robot.limits[joint].effort for joint in robot.tree.joints])
        self._brake = np.where(np.isfinite(effort), effort / _BRAKED, 0.0)
        events = [(STAND, self._begin), (case.load_at, self._load), (case.unload_at, plant.remove_payload)]
        self._events = sorted(events, key=lambda event: event[0])
        self.supervisor: Supervisor | NonstopSupervisor | None = None
        if case.supervision is Supervision.STOPPING:
            forces = ContactForceEstimator(model, legs=controller.legs)
            self.supervisor = Supervisor(model, CrawlWalker(self.crawl), forces=forces, settings=case.settings)
        elif case.supervision is Supervision.NONSTOP:
            self.supervisor = NonstopSupervisor(model, CrawlWalker(self.crawl))

    def run(self, watch: Watch | None = None) -> LoadedWalkOutcome:
        """Runs to the end, or until the robot has fallen; `watch` is called after every period."""
        for _ in range(round(self.case.seconds / self.bed.plant.timestep)):
            self.step()
            if watch is not None:
                watch(self)
            if self.monitor.fall is not None:
                break
        return self.outcome()

    def step(self) -> None:
        """Simulates one period. After a failure of the controller the drives only brake."""
        while self._events and self._events[0][0] <= self.bed.plant.time + 1e-9:
            self._events.pop(0)[1]()
        try:
            self._control()
        except (ControlError, PlanError) as error:
            self.give_up(str(error))
        except SimulationError as error:
            self.monitor.fall = self.monitor.fall or Fall(self.bed.plant.time, str(error))
        self.monitor.look()
        time = self.bed.plant.time
        if np.isnan(self.evaluated_from) and time > self.loaded_at + self._step_time and self.crawl.stance.all():
            self.evaluated_from = time

    def give_up(self, reason: str) -> None:
        """Makes the drives only brake from now on."""
        self.fault = self.fault or reason

    def _control(self) -> None:
        if self.fault:
            self.bed.plant.step(-self._brake * self.bed.plant.joint_velocity)
            return
        self.bed.step()
        if self.supervisor is not None and self.bed.measurement is not None:
            self.supervisor.update(self.bed.measurement)

    def _begin(self) -> None:
        if self.supervisor is None or self.supervisor.state in (State.WALKING, State.WEIGHING):
            self.crawl.resume()

    def _load(self) -> None:
        if self.case.payload is not None:
            self.bed.plant.apply_payload(self.case.payload)
            self.loaded_at = self.bed.plant.time

    def outcome(self) -> LoadedWalkOutcome:
        monitor, supervisor, plant = self.monitor, self.supervisor, self.bed.plant
        return LoadedWalkOutcome(
            case=self.case,
            trace=self._trace(),
            margin=monitor.margins,
            evaluated_from=self.evaluated_from,
            transitions=() if supervisor is None else supervisor.transitions,
            checks=supervisor.checks if isinstance(supervisor, Supervisor) else (),
            state=State.WALKING if supervisor is None else supervisor.state,
            noticed=() if supervisor is None else supervisor.noticed,
            model=self.crawl.controller.trunk.model,
            truth=plant.truth(),
            bare=self._bare,
            payload=None if supervisor is None else supervisor.payload,
        )

    def _trace(self) -> WalkTrace:
        monitor = self.monitor
        return WalkTrace(
            time=monitor.times,
            position=monitor.positions,
            height=monitor.heights,
            limited=monitor.limited,
            joints=monitor.plant.robot.tree.joints,
            steps=tuple(event.time for event in self.crawl.events if event.phase is CrawlPhase.SWING),
            speed=self.case.speed,
            step_time=self._step_time,
            loaded_at=self.loaded_at,
            fall=monitor.fall,
            fault=self.fault,
        )


def loaded_walk(case: LoadedWalkCase) -> LoadedWalkOutcome:
    return LoadedWalk(case).run()
