"""A robot that crawls and is loaded on its way, with or without a supervisor: Table V, survival, the demo.

The plant is MuJoCo with sensor errors; crawl, estimators and supervisor see measurements alone. The plant's truth is
read for evaluation: whether the robot fell, and how far inside its support polygon its centre of mass was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stadera.constants import GRAVITY
from stadera.inertia import InertialParameters
from stadera.lab.control import TestBed, TrunkController
from stadera.lab.control.crawl.crawl import Crawl
from stadera.lab.control.crawl.phase import CrawlPhase
from stadera.lab.control.crawl.run import Fall, WalkMonitor
from stadera.lab.control.crawl.settings import CrawlCommand
from stadera.lab.control.crawl.walker import CrawlWalker
from stadera.lab.control.planner.support import PlanError
from stadera.lab.control.trunk import ControlError
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
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration
from stadera.supervise import LoadCheck, NonstopSupervisor, State, SuperviseSettings, Supervisor, Transition
from stadera.trunk import ContactForceEstimator, TrunkModel
from stadera.trunk.load import Payload as FoundPayload
from stadera.types import Array

STAND = 1.0
"""For how long the robot stands before it walks [s]: long enough to weigh the tare."""

CORNERS = {"LF": (1, 1), "RF": (1, -1), "LH": (-1, 1), "RH": (-1, -1)}
"""Signs of x and y of the trunk's corners."""


class Supervision(StrEnum):
    """The supervisor of a walk: none, or one that weighs the load at rest or on the way."""

    NONE = "without identification"
    STOPPING = "with identification"
    NONSTOP = "without a stop"


@dataclass(frozen=True, eq=False)
class LoadedWalkCase:
    """What one walk is made of.

    Attributes:
        robot: its name.
        payload: put on under way; None for nothing.
        load_at: when [s].
        unload_at: when everything is taken off again [s]; never by default.
        supervision: without, controller and planner keep the model file's trunk.
        seconds: of the run, standing included.
        speed: [m/s], ahead.
        errors: of the sensors.
        seed: of all draws.
        terrain: None for the plane.
        settings: of the supervisor that stops; None for the defaults.
    """

    robot: str = "hyq"
    payload: Payload | None = None
    load_at: float = 5.0
    unload_at: float = np.inf
    supervision: Supervision = Supervision.STOPPING
    seconds: float = 20.0
    speed: float = 0.1
    errors: SensorErrors = STANDARD
    seed: int = 0
    terrain: Terrain | None = None
    settings: SuperviseSettings | None = None


@dataclass(frozen=True, eq=False)
class LoadedWalkOutcome:
    """How one walk went.

    Attributes:
        case: what was run.
        seconds: simulated [s].
        fall: how it fell; None if it did not.
        time, margin, position: (k,) [s], (k,) [m], (k, 3) [m], by the truth: of the centre of mass inside the support
            polygon (negative outside, NaN on fewer than three feet), and of the trunk.
        loaded_at: when the load came on [s]; NaN if none did.
        evaluated_from: the first time with four feet in stance that is a step's time and more after the load [s], since
            no supervisor can act on the step taken before; NaN if it never came.
        transitions, checks, state: of the supervisor; empty, and WALKING, without one. One that does not stop makes no
            checks.
        noticed: when changes of the load were noticed [s].
        steps: when legs were lifted [s].
        step_time: from one to the next, as commanded [s].
        model: the trunk as controller and planner have it at the end.
        truth, bare: the trunk with its load at the end, and without.
        payload: as the supervisor weighed it; None if it weighed nothing.
    """

    case: LoadedWalkCase
    seconds: float
    fall: Fall | None
    time: Array
    margin: Array
    position: Array
    loaded_at: float
    evaluated_from: float
    transitions: tuple[Transition, ...]
    checks: tuple[LoadCheck, ...]
    state: State
    noticed: tuple[float, ...]
    steps: tuple[float, ...]
    step_time: float
    model: TrunkModel
    truth: InertialParameters
    bare: InertialParameters
    payload: FoundPayload | None

    @property
    def least_margin(self) -> float:
        """[m], while evaluated; NaN if it was never seen."""
        since = self.margin[self.time >= self._evaluated]
        return float(np.nanmin(since)) if np.isfinite(since).any() else float("nan")

    @property
    def least_margin_ever(self) -> float:
        """[m], since the load came on, the steps that no supervisor can act on included."""
        since = self.margin[self.time >= self._from]
        return float(np.nanmin(since)) if np.isfinite(since).any() else float("nan")

    @property
    def way(self) -> float:
        """How far the trunk got since the load came on, seen from above [m]."""
        first = min(int(np.searchsorted(self.time, self._from)), len(self.time) - 1)
        return float(np.linalg.norm((self.position[-1] - self.position[first])[:2]))

    @property
    def outside(self) -> float:
        """For how long the centre of mass was outside the support polygon, while evaluated [s]."""
        since = self.margin[self.time >= self._evaluated]
        return float((since < 0.0).sum()) * float(np.median(np.diff(self.time)))

    @property
    def survived(self) -> bool:
        """Neither a fall, nor the centre of mass outside the support polygon, while evaluated."""
        return self.fall is None and not self.least_margin < 0.0

    @property
    def noticed_after(self) -> float:
        """Time from the load to the first change noticed [s]; NaN if none was."""
        times = [time for time in self.noticed if time >= self._from]
        return times[0] - self.loaded_at if times else float("nan")

    @property
    def updated_after(self) -> float | None:
        """Time from the load until the robot walked by a new trunk [s]; None if it never did."""
        after = [t.time for t in self.transitions if t.after is State.WALKING and t.time >= self._from]
        return after[0] - self.loaded_at if after else None

    @property
    def steps_lost(self) -> int:
        """Steps for which there was time, as commanded, while none was taken: in pauses and at the end, from the last
        step before the load on, or else from the load; 0 without one. In a pause a step counts from half its time on.
        """
        before = [time for time in self.steps if time < self._from]
        since = before[-1] if before else self.loaded_at
        if np.isnan(since):
            return 0
        lifted = np.array([since, *self.steps[len(before) :]])
        pauses = np.round(np.diff(lifted) / self.step_time) - 1.0
        return int(np.maximum(pauses, 0.0).sum()) + int((self.seconds - lifted[-1]) / self.step_time)

    @property
    def _evaluated(self) -> float:
        return -np.inf if np.isnan(self.evaluated_from) else self.evaluated_from

    @property
    def _from(self) -> float:
        return -np.inf if np.isnan(self.loaded_at) else self.loaded_at


def corner_of(robot: Robot, corner: str) -> Array:
    """A corner of the trunk's back, trunk frame (3,) [m]."""
    tray = Tray.of(robot)
    return np.array([*(tray.centre[:2] + np.array(CORNERS[corner]) * tray.half_size[:2]), tray.top])


def box_at(robot: Robot, corner: str, mass: float, size: tuple[float, float, float]) -> DroppedBox:
    """A box of a mass [kg] and edges [m] let fall on the back, flush with a corner."""
    (x, y), (sx, sy) = corner_of(robot, corner)[:2], CORNERS[corner]
    return DroppedBox(mass, size, (float(x - 0.5 * sx * size[0]), float(y - 0.5 * sy * size[1])), height=0.05)


def weight_at(robot: Robot, corner: str, force: float) -> RigidMass:
    """A body of a weight [N] fixed on the back's corner: a cube of a decimetre."""
    x, y, z = corner_of(robot, corner).tolist()
    return RigidMass.box(force / GRAVITY, (0.1, 0.1, 0.1), (x, y, z + 0.05))


Watch = Callable[["LoadedWalk"], None]


class LoadedWalk:
    """A case under way.

    Args:
        case: what is run.

    Attributes:
        bed, crawl, monitor, supervisor: its parts; no supervisor without identification.
        loaded_at, evaluated_from: as in the outcome; NaN before.

    Raises:
        StaderaError: it cannot be set up.
    """

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
        self.loaded_at = self.evaluated_from = np.nan
        self._bare, self._step_time = plant.truth(), self.crawl.settings.timing(self.crawl.command).step
        events = [(STAND, self._begin), (case.load_at, self._load), (case.unload_at, self._unload)]
        self._events = sorted(events, key=lambda event: event[0])
        self.supervisor: Supervisor | NonstopSupervisor | None = None
        if case.supervision is Supervision.STOPPING:
            forces = ContactForceEstimator(model, legs=controller.legs)
            self.supervisor = Supervisor(model, CrawlWalker(self.crawl), forces=forces, settings=case.settings)
        elif case.supervision is Supervision.NONSTOP:
            self.supervisor = NonstopSupervisor(model, CrawlWalker(self.crawl))

    def run(self, watch: Watch | None = None) -> LoadedWalkOutcome:
        """Runs it out, or until the robot has fallen; `watch` is called after every period."""
        for _ in range(round(self.case.seconds / self.bed.plant.timestep)):
            self.step()
            if watch is not None:
                watch(self)
            if self.monitor.fall is not None:
                break
        return self.outcome()

    def step(self) -> None:
        """One period. A controller or a simulation that breaks down counts as a fall."""
        while self._events and self._events[0][0] <= self.bed.plant.time + 1e-9:
            self._events.pop(0)[1]()
        try:
            self.bed.step()
            if self.supervisor is not None and self.bed.measurement is not None:
                self.supervisor.update(self.bed.measurement)
        except (ControlError, PlanError, SimulationError) as error:
            self.monitor.fall = self.monitor.fall or Fall(self.bed.plant.time, str(error))
        self.monitor.look()
        time = self.bed.plant.time
        if np.isnan(self.evaluated_from) and time > self.loaded_at + self._step_time and self.crawl.stance.all():
            self.evaluated_from = time

    def _begin(self) -> None:
        if self.supervisor is None or self.supervisor.state in (State.WALKING, State.WEIGHING):
            self.crawl.resume()

    def _load(self) -> None:
        if self.case.payload is not None:
            self.bed.plant.apply_payload(self.case.payload)
            self.loaded_at = self.bed.plant.time

    def _unload(self) -> None:
        self.bed.plant.remove_payload()

    def outcome(self) -> LoadedWalkOutcome:
        """How it went so far."""
        monitor, supervisor, plant = self.monitor, self.supervisor, self.bed.plant
        return LoadedWalkOutcome(
            case=self.case,
            seconds=plant.time,
            fall=monitor.fall,
            time=monitor.times,
            margin=monitor.margins,
            position=monitor.positions,
            loaded_at=self.loaded_at,
            evaluated_from=self.evaluated_from,
            transitions=() if supervisor is None else supervisor.transitions,
            checks=supervisor.checks if isinstance(supervisor, Supervisor) else (),
            state=State.WALKING if supervisor is None else supervisor.state,
            noticed=() if supervisor is None else supervisor.noticed,
            steps=tuple(event.time for event in self.crawl.events if event.phase is CrawlPhase.SWING),
            step_time=self._step_time,
            model=self.crawl.controller.trunk.model,
            truth=plant.truth(),
            bare=self._bare,
            payload=None if supervisor is None else supervisor.payload,
        )


def loaded_walk(case: LoadedWalkCase) -> LoadedWalkOutcome:
    """Runs one case.

    Raises:
        StaderaError: it cannot be set up.
    """
    return LoadedWalk(case).run()
