"""A crawling robot that is loaded, with or without a supervisor: for Table V and the demo.

The plant is MuJoCo with sensor errors; crawl, estimators and supervisor receive measurements only. The plant's truth is
used for evaluation: how the walk ended, and the margin of the centre of mass in the support polygon.

With v the commanded speed, and s(t) the forward position of the trunk, a walk that ends at T without a fall is stuck if

- over its last gait cycle C it advanced by less than a share of the command, s(T) - s(T - C) < share · v C, or took
  fewer than that share of the commanded steps: so a robot that stops to weigh its load and walks on has walked;
- since the load, the trunk sagged by more than a share of its height for longer than a limit;
- since the load, one joint was continuously at its torque limit for longer than a limit.

The same limits hold with and without identification. The margin is not part of the outcome: a robot that tips onto the
foot it was about to lift may still walk on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from stadera.constants import GRAVITY
from stadera.inertia import InertialParameters
from stadera.lab.control.com_plan import PlanError
from stadera.lab.control.crawl import Crawl, CrawlPhase
from stadera.lab.control.monitor import Fall, WalkMonitor
from stadera.lab.control.reference import ControlError
from stadera.lab.control.stand import TestBed
from stadera.lab.control.steps import CrawlCommand
from stadera.lab.control.trunk import TrunkController
from stadera.lab.plant.payload import DroppedBox, Payload, RigidMass, Tray
from stadera.lab.plant.plant import Plant, SimulationError
from stadera.lab.plant.sensors import STANDARD, Sensors, estimator_model, plant_model
from stadera.lab.supervise.supervisor import Mode, NonstopSupervisor, StoppingSupervisor, Transition
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import TrunkModel
from stadera.trunk.load import Payload as FoundPayload
from stadera.types import Array, Bools


class WalkOutcome(StrEnum):
    """Outcome of a walk."""

    WALKED = "walked"
    STUCK = "stuck"
    FELL = "fell"


@dataclass(frozen=True)
class OutcomeLimits:
    """Limits for being stuck; those for a fall are `FallLimits`."""

    # of the commanded distance and steps over the last cycle below which the robot is stuck. Half: a loaded robot may
    # be slower, while one that only steps in place has stopped.
    share: float = 0.5
    # decrease of the trunk's height above ground, as a share. 0.15: three times the deflection of the virtual springs
    # under 40 % of the robot's mass (m g / k = 0.05 h), and more than a swing's ground clearance.
    sag: float = 0.15
    # [s], time for which it must be that low. A step's time, since a landing load may push it down briefly.
    sagging: float = 0.8
    # [s], time for which a joint may be at its torque limit, since drives heat up. The controllers' own limit.
    overload: float = 0.5


@dataclass(frozen=True, eq=False)
class WalkTrace:
    """True states of a walk, evenly sampled, and the command; how it ended, as in the module's text."""

    time: Array  # (k,) [s]
    margin: Array  # (k,) [m], of the true centre of mass in the support polygon; NaN on fewer than three feet
    position: Array  # (k, 3) [m], of the trunk's origin, world; the walk leads along x
    height: Array  # (k,) [m], of the trunk's origin above the ground
    limited: Bools  # (k, n) bool, joints whose torque is at its limit
    joints: tuple[str, ...]  # their n names
    steps: tuple[float, ...]  # when legs were lifted [s]
    speed: float  # commanded [m/s]
    step_time: float  # of one step, as commanded [s]
    loaded_at: float  # time of the load [s]; NaN if there is none
    fall: Fall | None  # None if it did not fall
    fault: str = ""  # why the controller failed; empty otherwise

    @property
    def since(self) -> int:
        """Index of the first sample with the load."""
        first = 0 if np.isnan(self.loaded_at) else int(np.searchsorted(self.time, self.loaded_at))
        return min(first, len(self.time) - 1)

    @property
    def distance(self) -> float:
        """Forward distance of the trunk since the load [m]."""
        return float(self.position[-1, 0] - self.position[self.since, 0])

    @property
    def commanded(self) -> float:
        """Commanded distance in that time [m], until the fall if there was one."""
        return self.speed * float(self.time[-1] - self.time[self.since])

    @property
    def least_margin(self) -> float:
        """Least margin since the load [m], including the step that no supervisor can affect."""
        margin = self.margin[self.since :]
        return float(np.nanmin(margin)) if np.isfinite(margin).any() else float("nan")

    @property
    def steps_lost(self) -> int:
        """Number of commanded steps that were not taken, in pauses and at the end, counted from the last step before
        the load, or else from the load; 0 without one. In a pause a step counts from half its time on.
        """
        before = [time for time in self.steps if time < self.loaded_at]
        since = before[-1] if before else self.loaded_at
        if np.isnan(since):
            return 0
        lifted = np.array([since, *self.steps[len(before) :]])
        pauses = np.round(np.diff(lifted) / self.step_time) - 1.0
        return int(np.maximum(pauses, 0.0).sum()) + int((self.time[-1] - lifted[-1]) / self.step_time)

    @property
    def outcome(self) -> WalkOutcome:
        if self.fall is not None:
            return WalkOutcome.FELL
        return WalkOutcome.STUCK if self.reasons else WalkOutcome.WALKED

    @cached_property
    def reasons(self) -> tuple[str, ...]:
        """Why it fell or is stuck; none if it walked."""
        why = (self.fall.how,) if self.fall is not None else (self._overload(), self._sagging(), self._progress())
        return tuple(reason for reason in (*why, self.fault) if reason)

    def _overload(self) -> str:
        spells = [longest_spell(self.time[self.since :], limited) for limited in self.limited[self.since :].T]
        worst = int(np.argmax(spells))
        if spells[worst] <= OutcomeLimits.overload:
            return ""
        return f"joint {self.joints[worst]} was at its torque limit for {spells[worst]:.1f} s"

    def _sagging(self) -> str:
        height = self.height[self.since :]
        spell = longest_spell(self.time[self.since :], height < (1.0 - OutcomeLimits.sag) * height[0])
        sagged = f"the trunk sagged by up to {100.0 * (height[0] - height.min()):.0f} cm"
        return sagged if spell > OutcomeLimits.sagging else ""

    def _progress(self) -> str:
        """The shortfall over the last cycle, or over the time since the load if that is shorter."""
        end, cycle = float(self.time[-1]), 4.0 * self.step_time
        window = min(cycle, end - float(self.time[self.since]))
        first = int(np.searchsorted(self.time, end - window))
        ahead = float(self.position[-1, 0] - self.position[first, 0])
        taken = sum(time > end - window for time in self.steps)
        if ahead < OutcomeLimits.share * self.speed * window:
            return (
                f"it got {100.0 * ahead:.0f} of {100.0 * self.speed * window:.0f} cm ahead in the last {window:.1f} s"
            )
        if taken < OutcomeLimits.share * np.floor(window / self.step_time):
            return f"it took {taken} of {window / self.step_time:.0f} steps in the last {window:.1f} s"
        return ""


def longest_spell(time: Array, true: Bools) -> float:
    """Longest time [s] for which samples (k,) at times (k,) were continuously true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(true, dtype=int), [0]])))
    begins, ends = edges[::2], edges[1::2] - 1
    return float((time[ends] - time[begins]).max()) if len(begins) else 0.0


CORNERS = {"LF": (1, 1), "RF": (1, -1), "LH": (-1, 1), "RH": (-1, -1)}
"""Signs of x and y of the trunk's corners."""


@dataclass(frozen=True, eq=False)
class LoadedWalkCase:
    """Settings of one walk."""

    robot: str = "hyq"
    payload: Payload | None = None  # the load added; None for none
    load_at: float = 5.0  # time at which it is added [s]
    # has the load weighed; None for none: controller and planner keep the model file's trunk
    supervisor: type[StoppingSupervisor] | type[NonstopSupervisor] | None = StoppingSupervisor
    seconds: float = 20.0  # of the run, standing included
    speed: float = 0.1  # [m/s], ahead
    seed: int = 0  # of all draws


@dataclass(frozen=True, eq=False)
class LoadedWalkOutcome:
    """Outcome of one walk; transitions, detections and payload are the supervisor's."""

    case: LoadedWalkCase
    trace: WalkTrace  # true states, and the command
    transitions: tuple[Transition, ...]
    noticed: tuple[float, ...]  # times of detection of changes of the load [s]
    model: TrunkModel  # trunk model of controller and planner at the end
    truth: InertialParameters  # the trunk with its load at the end
    bare: InertialParameters  # the trunk without it
    payload: FoundPayload | None  # as estimated; None without an estimate

    @property
    def com_error(self) -> float:
        """Error of the modelled trunk's centre of mass at the end, in x and y [m]."""
        return float(np.linalg.norm((self.model.com_trunk - self.truth.com)[:2]))

    @property
    def noticed_after(self) -> float | None:
        """Time from the load to the first detected change [s]; None if there is none."""
        return self._first_after_load(self.noticed)

    @property
    def updated_after(self) -> float | None:
        """Time from the load until the robot used a new trunk model [s]; None if it never did."""
        return self._first_after_load(t.time for t in self.transitions if t.after is Mode.WALKING)

    def _first_after_load(self, times: Iterable[float]) -> float | None:
        return next((time - self.trace.loaded_at for time in times if time >= self.trace.loaded_at), None)


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


class LoadedWalk:
    """A walk in progress. `fault` says why the controller failed, so that the drives only brake."""

    stands = 1.0  # time for which the robot stands before it walks [s]: enough to weigh the tare
    braked = 10.0  # joint velocity above which braking drives apply their full torque [rad/s]

    def __init__(self, case: LoadedWalkCase) -> None:
        self.case, robot = case, load_robot(case.robot)
        real = plant_model(robot, STANDARD)
        model = estimator_model(real, STANDARD, case.seed)
        plant = Plant(real)
        plant.reset(standing_configuration(robot))
        self.crawl = Crawl(TrunkController(model), command=CrawlCommand(case.speed))
        self.bed = TestBed(plant, Sensors(STANDARD, case.seed, robot), self.crawl)
        self.monitor = WalkMonitor(plant)
        self.loaded_at, self.fault, self._bare = np.nan, "", plant.truth()
        effort = np.array([robot.limits[joint].effort for joint in robot.tree.joints])
        self._brake = np.where(np.isfinite(effort), effort / self.braked, 0.0)
        self._events = sorted([(self.stands, self._begin), (case.load_at, self._load)], key=lambda event: event[0])
        self.supervisor = None if case.supervisor is None else case.supervisor(model, self.crawl)

    def run(self, watch: Callable[[LoadedWalk], None] | None = None) -> LoadedWalkOutcome:
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
        if self.supervisor is None or self.supervisor.state in (Mode.WALKING, Mode.WEIGHING):
            self.crawl.resume()

    def _load(self) -> None:
        if self.case.payload is not None:
            self.bed.plant.apply_payload(self.case.payload)
            self.loaded_at = self.bed.plant.time

    def outcome(self) -> LoadedWalkOutcome:
        plant, supervisor = self.bed.plant, self.supervisor
        trace = WalkTrace(
            **self.monitor.history,
            joints=plant.robot.tree.joints,
            steps=tuple(event.time for event in self.crawl.events if event.phase is CrawlPhase.SWING),
            speed=self.case.speed,
            step_time=self.crawl.steps.timing.step,
            loaded_at=self.loaded_at,
            fall=self.monitor.fall,
            fault=self.fault,
        )
        return LoadedWalkOutcome(
            case=self.case,
            trace=trace,
            transitions=() if supervisor is None else supervisor.transitions,
            noticed=() if supervisor is None else supervisor.noticed,
            model=self.crawl.controller.trunk.model,
            truth=plant.truth(),
            bare=self._bare,
            payload=None if supervisor is None else supervisor.payload,
        )
