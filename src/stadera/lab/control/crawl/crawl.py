"""Statically stable crawl: one leg swings at a time, and before each swing the body moves over the other three feet.

A state machine, driven by events and time (section V.C of the paper, [13] there)::

            walk                 centre of mass over the coming triangle, load off the leg
    STAND ────────▶ BODY ◀────────────────────────────────────────────┐ touch-down
      ▲               └──────────────────────────────────────▶ SWING ─┤
      │  touch-down, and a stop was asked for                   │     │
      ├───────────────────────────────────────────────────────────────┘
      │  touch-down                                             │ no ground within reach
      └───────────────────────────────── RETREAT ◀──────────────┘   back to where the foot stood

Everything is planned in the odometry frame from measurements. The trunk model is the trunk controller's: one call of
`update_trunk` sets it for both, at any time. The current plan keeps the model with which it was made, until that is off
by a fifth of the margin; then the body's motion is planned again from its present position and velocity, at once or,
with a leg in the air, for its landing. The coming step keeps its time if the new plan moves the centre of mass over the
coming triangle by then, and is otherwise delayed by as little as necessary.
"""

from __future__ import annotations

import numpy as np

from stadera.lab.control.crawl.body import BodyReference
from stadera.lab.control.crawl.legs import LegSwing, StepSequence
from stadera.lab.control.crawl.settings import (
    CrawlCommand,
    CrawlError,
    CrawlEvent,
    CrawlPhase,
    CrawlSettings,
    StepTiming,
)
from stadera.lab.control.loading import OverloadWatch
from stadera.lab.control.planner.feet import GroundPlane, SupportPolygon
from stadera.lab.control.planner.steps import Airborne, support_phases
from stadera.lab.control.stand import Gait
from stadera.lab.control.trunk import TrunkController
from stadera.robot.model import LEG_NAMES
from stadera.trunk.measurement import Measurement
from stadera.types import Array


class Crawl(Gait):
    """Walks with a trunk controller. Uses measurements only; one `update` per control period.

    It starts standing; `resume` starts walking, and `request_stop` stops after the current step. `reason` says why it
    stands, sits or retreats, `failed` whether it stopped because it could not continue; `events` has every transition.
    """

    def __init__(
        self, controller: TrunkController, settings: CrawlSettings | None = None, command: CrawlCommand | None = None
    ) -> None:
        super().__init__(controller)
        self.settings = settings or CrawlSettings.of(controller.robot)
        self.phase, self.reason, self.failed = CrawlPhase.STAND, "not asked to walk yet", False
        self.events: list[CrawlEvent] = []
        self._steps = StepSequence(controller.robot, self.settings, command or CrawlCommand())
        self._walks, self._stop = False, ""
        self._body: BodyReference | None = None
        self._swing = LegSwing(controller, self.settings)
        self._due, self._put_off, self._relieving, self._target = 0.0, 0.0, False, np.zeros(3)
        self._overload = OverloadWatch(controller.robot.tree.joints)

    # -- asked for ------------------------------------------------------------------------------------------------
    @property
    def command(self) -> CrawlCommand:
        """Desired motion; a new command applies from the next step on."""
        return self._steps.command

    @command.setter
    def command(self, command: CrawlCommand) -> None:
        self._steps.command = command

    def resume(self) -> None:
        """Starts walking, or continues with the leg whose turn it is."""
        if self.phase is CrawlPhase.SIT:
            raise CrawlError("a robot that sits cannot walk on")
        self._walks, self._stop, self.failed = True, "", False

    def request_stop(self, reason: str = "asked to stop") -> None:
        """Stops on four feet after the current step; see `stopped`."""
        self._walks, self._stop = False, self._stop or reason

    def sit(self, reason: str = "asked to sit") -> None:
        """Lowers the trunk permanently."""
        if self.phase is not CrawlPhase.STAND or self._body is None:
            raise CrawlError("a robot sits down from a stand: ask it to stop first")
        how = self.settings.tuning
        self._body.lower(self.controller.time, how.sitting, how.sit_time * self.settings.lead)
        self._enter(CrawlPhase.SIT, None, reason)

    @property
    def stopped(self) -> bool:
        """True if it stands on four feet, with its reference at rest."""
        standing = self.phase in (CrawlPhase.STAND, CrawlPhase.SIT)
        return standing and self._body is not None and self.controller.time >= self._body.plan.end

    @property
    def leg(self) -> str | None:
        """The swinging leg, or the next one to swing; None while standing."""
        return None if self.phase in (CrawlPhase.STAND, CrawlPhase.SIT) else LEG_NAMES[self._leg]

    # -- what the test-bed's loop asks for ------------------------------------------------------------------------
    def update(self, measurement: Measurement) -> Array:
        """Joint torques (n,) [N·m] for one measurement."""
        if self._body is None:
            torque = self.controller.update(measurement)
            self._start(measurement)
            return torque
        self._body.see(measurement)
        overload = self._overload.update(measurement.time, self.controller.saturated)
        if self._walks and overload:
            self._fail(overload)
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
        self._body = BodyReference(controller, self.settings.tuning)
        self._body.see(measurement)
        self._body.begin()
        controller.follow(self._body)
        nose = controller.rotation[:, 0]
        self._steps.start(controller.feet, float(np.arctan2(nose[1], nose[0])))
        self.events.append(CrawlEvent(measurement.time, self.phase, None, self.reason))

    def _advance(self, time: float) -> None:
        match self.phase:
            case CrawlPhase.STAND if self._walks:
                self._begin_step(time, self.settings.lead, None)
            case CrawlPhase.BODY:
                self._shift_body(time)
            case CrawlPhase.SWING:
                self._watch_swing(time)
            case CrawlPhase.RETREAT:
                if self._swing.back(time, self._planned.stretched(self._leg)):
                    self._stand(time, self._stop)

    def _begin_step(self, time: float, body: float, landed: int | None) -> None:
        """Starts the body's motion so that the next leg can swing after `body` [s]; `landed`: the last leg to land."""
        timing, feet, target = self._timing, self.controller.feet, self._steps.target
        self._put_off = 0.0
        self._target = np.array([*target, GroundPlane.of(feet).at(target)])
        before = None if landed is None else Airborne(landed, feet[landed, :2], timing.transfer)
        body = self._plan_step(time, before, body)
        self._planned.follow_ground(time, self._steps.heading, body + timing.swing)
        self._enter(CrawlPhase.BODY, self._leg, "")

    def _plan_step(self, time: float, before: Airborne | None, body: float) -> float:
        """Plans for a lift after `body` [s], or later if a new model needs more time; returns that time."""
        new = self._model_moved()
        for delay in self.settings.tuning.delays if new else (0.0,):
            later = body + delay * self.settings.lead
            self._replan(time, before, later)
            if self._reaches(time + later):
                break
        self._due = time + later
        return later

    def _reaches(self, lift: float) -> bool:
        """True if centre of mass and zero-moment point are inside the coming triangle for a lift at this time."""
        begin, end = lift - 0.5 * self._timing.transfer, lift + self._timing.swing
        return self._planned.least_margin(self._triangle(), begin, end) >= self.settings.least_margin

    def _model_moved(self) -> bool:
        return self._planned.moved > self.settings.tuning.moved * self.settings.margin

    def _shift_body(self, time: float) -> None:
        leg, controller, timing = self._leg, self.controller, self._timing
        if self._stop:
            self._stand(time, self._stop)
        elif not self._relieving and self._model_moved():
            self._plan_step(time, None, max(self._due - time, timing.transfer))
        elif not self._relieving and time >= self._due - timing.transfer:
            if self._over_triangle():
                controller.relieve(leg, timing.transfer)
                self._relieving = True
            else:
                self._put_step_off(time)
        elif time >= self._due and controller.relieved[leg]:
            if self._over_triangle():
                self._swing.lift(time, leg, self._target, self._planned.normal, timing)
                self._enter(CrawlPhase.SWING, leg, "")
            else:
                self._put_step_off(time)

    def _triangle(self) -> SupportPolygon:
        return SupportPolygon.of(np.delete(self.controller.feet, self._leg, axis=0))

    def _margin(self) -> float:
        """Margin of the modelled centre of mass in the coming triangle [m]."""
        return self._triangle().margin(self._planned.com)

    def _over_triangle(self) -> bool:
        return self._margin() >= self.settings.least_margin

    def _put_step_off(self, time: float) -> None:
        """Gives the body the same time again; stops when the time limit is reached."""
        settings, timing = self.settings, self._timing
        if self._put_off >= settings.patience:
            place = f"the triangle without {LEG_NAMES[self._leg]}"
            found = f"margin {self._margin():.3f} m, needed {settings.least_margin:.3f} m"
            self._fail(f"the centre of mass does not get over {place}: {found}")
            self._stand(time, self._stop)
            return
        if self._relieving:
            self.controller.land(self._leg, timing.transfer)
            self._relieving = False
        wait = max(settings.lead, 3.0 * timing.transfer)
        self._put_off += max(time + wait - self._due, 0.0)
        self._due = time + wait
        self._replan(time, None, wait)

    def _watch_swing(self, time: float) -> None:
        leg, swing = self._leg, self._swing
        stretched = self._planned.stretched(leg)
        if swing.landed(time, stretched):
            self._steps.done()
            if self._stop:
                self._stand(time, self._stop)
            else:
                self._begin_step(time, self._steps.body_time(swing.overdue(time)), leg)
        elif swing.out_of_reach(time, stretched):
            self._retreat(time)
        elif swing.overdue_long(time) and not swing.late:  # the body waits over the three feet
            swing.late = True
            self._replan(time, swing.airborne(), None)

    def _retreat(self, time: float) -> None:
        leg, (x, y, _) = self._leg, self._swing.target
        self._fail(f"{LEG_NAMES[leg]} found no ground within {self.settings.search:.2f} m below ({x:.2f}, {y:.2f}) m")
        self._swing.retreat(time)
        self._replan(time, self._swing.airborne(), None)
        self._enter(CrawlPhase.RETREAT, leg, self._stop)

    def _stand(self, time: float, reason: str) -> None:
        """Moves the body to the middle of four feet on the ground, and stays."""
        if self._relieving:
            self.controller.land(self._leg, self._timing.transfer)
        self._walks, self._stop = False, ""
        self._replan(time, None, None)
        self._enter(CrawlPhase.STAND, None, reason)

    def _fail(self, reason: str) -> None:
        self._walks, self._stop, self.failed = False, reason, True

    def _enter(self, phase: CrawlPhase, leg: int | None, reason: str) -> None:
        self.phase, self.reason, self._relieving = phase, reason, False
        self.events.append(CrawlEvent(self.controller.time, phase, None if leg is None else LEG_NAMES[leg], reason))

    # -- planning -------------------------------------------------------------------------------------------------
    @property
    def _planned(self) -> BodyReference:
        assert self._body is not None
        return self._body

    def _replan(self, time: float, airborne: Airborne | None, body: float | None) -> None:
        """Plans the body's motion again, with coming steps, the first after `body` [s]; None for a stand."""
        timing, settings, feet = self._timing, self.settings, self.controller.feet
        steps = [] if body is None or self._stop else self._steps.ahead(body)
        phases = support_phases(feet, steps, timing, settings.margin, settings.lead, airborne)
        self._planned.replan(time, phases, settings.margin, timing.rest)
