"""The crawl: one leg after the other swings, and before each swing the body moves over the other three.

A state machine, driven by events and time (section V.C of the paper, [13] there)::

            walk                 centre of mass over the coming triangle, load off the leg
    STAND ────────▶ BODY ◀────────────────────────────────────────────┐ touch-down
      ▲               └──────────────────────────────────────▶ SWING ─┤
      │  touch-down, and a stop was asked for                   │     │
      ├───────────────────────────────────────────────────────────────┘
      │  touch-down                                             │ no ground within reach
      └───────────────────────────────── RETREAT ◀──────────────┘   back to where the foot stood

Everything is planned in the odometry frame from what is measured. The believed trunk is the trunk controller's: one
`believe` sets it for both.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from stadera.control.crawl_body import BodyReference
from stadera.control.crawl_settings import CrawlCommand, CrawlError, CrawlSettings, StepTiming
from stadera.control.crawl_steps import StepSequence
from stadera.control.planner_feet import GroundPlane, facing
from stadera.control.planner_steps import Airborne, support_phases
from stadera.control.planner_support import SupportPolygon
from stadera.control.swing import SwingTrajectory
from stadera.control.trunk import TrunkController
from stadera.estimate.measurement import Measurement
from stadera.estimate.trunk import TrunkModel
from stadera.robot.model import LEG_NAMES, Robot

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_EARLIEST = 0.5  # share of a swing after which a touch counts
_FOLLOWS = 0.5  # share of the way to the ground's inclination that one step takes
_FOREVER = 5.0  # s, that a plan holds the body over three feet, for a leg that may be long in the air
_SITTING = 0.45  # height of a sitting trunk, share of the standing one
_SIT_TIME = 3.0  # of the lead, that sitting down takes
_OVERLOADED = 0.5  # s, at its torque limit, after which a joint is overloaded


class Phase(StrEnum):
    """What a crawl is doing."""

    STAND = "stand"
    BODY = "body motion"
    SWING = "swing"
    RETREAT = "retreat"
    SIT = "sit"


@dataclass(frozen=True)
class CrawlEvent:
    """A transition: time [s], the phase that began, the leg it is about (or None), and why."""

    time: float
    phase: Phase
    leg: str | None
    reason: str


class Crawl:
    """Walks a trunk controller's robot. Sees measurements alone; one `update` a control period.

    It begins in a stand; `resume` makes it walk, `request_stop` stop after the step under way.

    Args:
        controller: fresh, or one that stands.
        settings: None for those scaled from the robot.
        command: where to walk; may be changed at any time, see `command`.

    Attributes:
        phase: what it is doing.
        reason: why it stands, sits or retreats.
        failed: whether it stopped by itself because it could not walk on.
        events: every transition so far.

    Raises:
        CrawlError: the command is too fast for this robot.
    """

    def __init__(
        self,
        controller: TrunkController,
        settings: CrawlSettings | None = None,
        command: CrawlCommand | None = None,
    ) -> None:
        self.controller = controller
        self.settings = settings or CrawlSettings.of(controller.robot)
        self.phase, self.reason, self.failed = Phase.STAND, "not asked to walk yet", False
        self.events: list[CrawlEvent] = []
        self._steps = StepSequence(controller.robot, self.settings, command or CrawlCommand())
        self._walks, self._stop = False, ""
        self._body: BodyReference | None = None
        self._height, self._normal = 0.0, np.array([0.0, 0.0, 1.0])
        self._due, self._put_off, self._target = 0.0, 0.0, np.zeros(3)
        self._lifted_from, self._at_limit = np.zeros(3), np.zeros(len(controller.robot.tree.joints))
        self._last, self._relieving, self._lifted_at = np.nan, False, 0.0

    # -- asked for ------------------------------------------------------------------------------------------------
    @property
    def command(self) -> CrawlCommand:
        """Where to walk; a new one counts from the next step on."""
        return self._steps.command

    @command.setter
    def command(self, command: CrawlCommand) -> None:
        self._steps.command = command

    def resume(self) -> None:
        """Walks, or walks on with the leg whose turn it is.

        Raises:
            CrawlError: it sits.
        """
        if self.phase is Phase.SIT:
            raise CrawlError("a robot that sits cannot walk on")
        self._walks, self._stop, self.failed = True, "", False

    def request_stop(self, reason: str = "asked to stop") -> None:
        """Stands still on four feet after the step under way; see `stopped`."""
        self._walks, self._stop = False, self._stop or reason

    def sit(self, reason: str = "asked to sit") -> None:
        """Lowers the trunk, for good.

        Raises:
            CrawlError: it does not stand on four feet.
        """
        if self.phase is not Phase.STAND or self._body is None:
            raise CrawlError("a robot sits down from a stand: ask it to stop first")
        time, plane = self.controller.time, GroundPlane.of(self.controller.feet)
        low = plane.at(self.controller.position) + _SITTING * self._height
        self._body.pose(time, self._body.at(time).rotation, low, _SIT_TIME * self.settings.lead)
        self._enter(Phase.SIT, None, reason)

    @property
    def stopped(self) -> bool:
        """Whether it stands on four feet, and its reference is at rest."""
        standing = self.phase in (Phase.STAND, Phase.SIT)
        return standing and self._body is not None and self.controller.time >= self._body.plan.end

    @property
    def leg(self) -> str | None:
        """The leg that swings, or whose turn it is; None in a stand."""
        return None if self.phase in (Phase.STAND, Phase.SIT) else LEG_NAMES[self._leg]

    # -- what the test-bed's loop asks for ------------------------------------------------------------------------
    @property
    def robot(self) -> Robot:
        """The robot that it believes in."""
        return self.controller.robot

    @property
    def stance(self) -> Bools:
        """(4,) bool, the legs that are to carry."""
        return self.controller.stance

    def believe(self, trunk: TrunkModel) -> bool:
        """Takes a new belief of the trunk, for controller and planner; False where it is not plausible."""
        return self.controller.believe(trunk)

    def update(self, measurement: Measurement) -> Array:
        """Joint torques (n,) [N·m] for one measurement.

        Raises:
            ControlError: as `TrunkController.update`.
            PlanError: as `plan_com`.
        """
        if self._body is None:
            torque = self.controller.update(measurement)
            self._start(measurement)
            return torque
        self._body.see(measurement)
        self._notice_overload(measurement.time)
        self._advance(measurement.time)
        return self.controller.update(measurement)

    # -- the state machine ----------------------------------------------------------------------------------------
    @property
    def _leg(self) -> int:
        return self._steps.leg

    @property
    def _timing(self) -> StepTiming:
        return self._steps.timing

    def _start(self, measurement: Measurement) -> None:
        controller = self.controller
        self._body = BodyReference(controller)
        self._body.see(measurement)
        self._body.begin()
        controller.follow(self._body)
        nose = controller.rotation[:, 0]
        self._steps.start(controller.feet, float(np.arctan2(nose[1], nose[0])))
        plane = GroundPlane.of(controller.feet)
        self._normal, self._height = plane.normal, float(controller.position[2] - plane.at(controller.position))
        self._last = measurement.time
        self.events.append(CrawlEvent(measurement.time, self.phase, None, self.reason))

    def _advance(self, time: float) -> None:
        match self.phase:
            case Phase.STAND if self._walks:
                self._begin_step(time, self.settings.lead, None)
            case Phase.BODY:
                self._shift_body(time)
            case Phase.SWING:
                self._watch_swing(time)
            case Phase.RETREAT:
                self._put_back(time)

    def _begin_step(self, time: float, body: float, landed: int | None) -> None:
        """Body motion, so that the next leg can swing after `body` [s]; `landed` is the leg that just did."""
        timing, feet, target = self._timing, self.controller.feet, self._steps.target
        if self._planned.outdated:
            body = max(body, self.settings.lead)
        self._due, self._put_off = time + body, 0.0
        self._target = np.array([*target, GroundPlane.of(feet).at(target)])
        before = None if landed is None else Airborne(landed, feet[landed, :2], timing.transfer)
        self._replan(time, before, body)
        self._pose_trunk(time, body + timing.swing)
        self._enter(Phase.BODY, self._leg, "")

    def _shift_body(self, time: float) -> None:
        leg, controller, timing = self._leg, self.controller, self._timing
        if self._stop:
            self._stand(time, self._stop)
        elif not self._relieving and self._planned.outdated:
            self._put_step_off(time)
        elif not self._relieving and time >= self._due - timing.transfer:
            if self._over_triangle():
                controller.relieve(leg, timing.transfer)
                self._relieving = True
            else:
                self._put_step_off(time)
        elif time >= self._due and controller.relieved[leg]:
            if self._over_triangle():
                self._lift(time)
            else:
                self._put_step_off(time)

    def _margin(self) -> float:
        """Of the believed centre of mass in the coming triangle [m]."""
        return SupportPolygon.of(np.delete(self.controller.feet, self._leg, axis=0)).margin(self._planned.com)

    def _over_triangle(self) -> bool:
        return self._margin() >= self.settings.least_margin

    def _put_step_off(self, time: float) -> None:
        """Gives the body time once more; gives up when it has had enough."""
        settings, timing = self.settings, self._timing
        if self._put_off >= settings.patience:
            place, margin = f"the triangle without {LEG_NAMES[self._leg]}", self._margin()
            least = settings.least_margin
            self._fail(f"the centre of mass does not get over {place}: margin {margin:.3f} m, needed {least:.3f} m")
            self._stand(time, self._stop)
            return
        if self._relieving:
            self.controller.land(self._leg, timing.transfer)
            self._relieving = False
        wait = max(settings.lead, 3.0 * timing.transfer)
        self._put_off += max(time + wait - self._due, 0.0)
        self._due = time + wait
        self._replan(time, None, wait)

    def _lift(self, time: float) -> None:
        leg, settings, duration = self._leg, self.settings, self._timing.swing
        self._lifted_from, self._lifted_at, self._due = self.controller.feet[leg].copy(), time, time + duration
        target = self._target - settings.press * self._normal
        self.controller.swing(
            leg,
            SwingTrajectory(
                self._lifted_from, target, time, duration, settings.clearance, descent=settings.search_speed
            ),
        )
        self._enter(Phase.SWING, leg, "")

    def _watch_swing(self, time: float) -> None:
        leg = self._leg
        if self._landed(time):
            self._steps.done()
            if self._stop:
                self._stand(time, self._stop)
            else:
                late = time - self._lifted_at - self._timing.swing
                self._begin_step(time, self._steps.body_time(late), leg)
        elif time >= self._lifted_at + self._timing.swing and self._out_of_reach():
            self._retreat(time)
        elif time >= self._due + 0.5 * self._timing.transfer:  # late: the body waits over the three feet
            self._due = np.inf
            self._replan(time, Airborne(leg, self._target[:2], _FOREVER), None)

    def _landed(self, time: float) -> bool:
        """Puts the swinging foot down where it has touched the ground."""
        leg, controller = self._leg, self.controller
        trajectory = controller.swinging.trajectories[leg]
        if trajectory is None or trajectory.progress(time) < _EARLIEST or not controller.touched[leg]:
            return False
        if self._planned.stretched(leg):  # torques of a leg that is nearly straight do not tell the ground
            return False
        controller.land(leg, self._timing.transfer)
        return True

    def _out_of_reach(self) -> bool:
        deep = self._target[2] - self.controller.feet[self._leg, 2] > self.settings.search
        return bool(deep or self._planned.stretched(self._leg))

    def _retreat(self, time: float) -> None:
        leg, settings, (x, y, _) = self._leg, self.settings, self._target
        self._fail(f"{LEG_NAMES[leg]} found no ground within {settings.search:.2f} m below ({x:.2f}, {y:.2f}) m")
        here = self.controller.feet[leg].copy()
        above = np.array([*here[:2], max(self._target[2], self._lifted_from[2]) + settings.clearance])
        self._target, self._due = self._lifted_from, time + self._timing.swing
        self.controller.swing(leg, SwingTrajectory(here, above, time, self._timing.swing, 0.0, descent=0.0))
        self._replan(time, Airborne(leg, self._target[:2], _FOREVER), None)
        self._enter(Phase.RETREAT, leg, self._stop)

    def _put_back(self, time: float) -> None:
        """Straight up out of the hole first, then to where the foot stood."""
        leg, settings = self._leg, self.settings
        if time >= self._due:
            here, self._due = self.controller.feet[leg].copy(), np.inf
            back = SwingTrajectory(here, self._target, time, self._timing.swing, 0.0, descent=settings.search_speed)
            self.controller.swing(leg, back)
        elif np.isinf(self._due) and self._landed(time):
            self._stand(time, self._stop)

    def _stand(self, time: float, reason: str) -> None:
        """Four feet on the ground: the body moves to their middle and stays."""
        if self._relieving:
            self.controller.land(self._leg, self._timing.transfer)
        self._walks, self._stop = False, ""
        self._replan(time, None, None)
        self._enter(Phase.STAND, None, reason)

    def _fail(self, reason: str) -> None:
        self._walks, self._stop, self.failed = False, reason, True

    def _enter(self, phase: Phase, leg: int | None, reason: str) -> None:
        self.phase, self.reason, self._relieving = phase, reason, False
        self.events.append(CrawlEvent(self.controller.time, phase, None if leg is None else LEG_NAMES[leg], reason))

    def _notice_overload(self, time: float) -> None:
        """Stops when a joint has been at its torque limit for long."""
        dt, self._last = time - self._last, time
        self._at_limit = np.where(self.controller.saturated, self._at_limit + dt, 0.0)
        if self._walks and self._at_limit.max() > _OVERLOADED:
            joint = self.robot.tree.joints[int(np.argmax(self._at_limit))]
            self._fail(f"joint {joint} has been at its torque limit for {_OVERLOADED} s")

    # -- planning -------------------------------------------------------------------------------------------------
    @property
    def _planned(self) -> BodyReference:
        assert self._body is not None
        return self._body

    def _replan(self, time: float, airborne: Airborne | None, body: float | None) -> None:
        """Plans the body's way anew: the airborne leg comes down, then come the next steps, the first after `body` [s];
        None for no steps, a stand.
        """
        timing, settings, feet = self._timing, self.settings, self.controller.feet
        steps = [] if body is None or self._stop else self._steps.ahead(body)
        phases = support_phases(feet, steps, timing, settings.margin, settings.lead, airborne)
        self._planned.replan(time, phases, float(feet[self.stance, 2].mean()), settings.margin, timing.rest)

    def _pose_trunk(self, time: float, duration: float) -> None:
        """Parallel to the ground under the feet, headed along the path, at its height."""
        body, plane = self._planned, GroundPlane.of(self.controller.feet)
        normal = self._normal + _FOLLOWS * (plane.normal - self._normal)
        self._normal = normal / np.linalg.norm(normal)
        way = body.plan.at(time + duration)[0] - body.plan.at(time)[0]
        height = plane.at(body.at(time).position[:2] + way) + self._height
        body.pose(time, facing(self._normal, self._steps.heading), height, duration)
