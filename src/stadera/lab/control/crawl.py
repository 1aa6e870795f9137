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
`update_trunk` sets it for both, at any time. The current plan keeps the model with which it was made, until that is
off by a fifth of the margin; then the body's motion is planned again from its present position and velocity, at once
or, with a leg in the air, for its landing. The coming step keeps its time if the new plan moves the centre of mass
over the coming triangle by then, and is otherwise delayed by as little as necessary.

The reference of the trunk is the planned centre of mass minus its lever from the trunk. With p(t) the planned centre
of mass seen from above, R(t) the planned rotation, z(t) the planned height of the trunk's origin, and c the whole
robot's centre of mass in trunk axes (the legs' part as measured),

    b_xy = p - (R c)_xy,      b_z = z.

c uses the model of the trunk with which the plan was made. So a new model does not move the reference; the next plan
starts at the new centre of mass and moves it over the supports. Plans use the controller's target model, so that
each new model causes one new plan only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stadera.constants import GRAVITY
from stadera.lab.control.com_plan import ComPlan, GroundPlane, SupportPhase, SupportPolygon, facing, plan_com
from stadera.lab.control.reference import Move, TrunkPose
from stadera.lab.control.stand import Gait
from stadera.lab.control.steps import CrawlCommand, CrawlSettings, Step, StepSequence, support_phases
from stadera.lab.control.swing import SwingTrajectory
from stadera.lab.control.trunk import TrunkController
from stadera.robot.model import LEG_NAMES
from stadera.trunk.measurement import Measurement
from stadera.types import Array


class CrawlPhase(StrEnum):
    """Phase of a crawl."""

    STAND = "stand"
    BODY = "body motion"
    SWING = "swing"
    RETREAT = "retreat"


@dataclass(frozen=True)
class CrawlEvent:
    """A transition: time [s], the phase that begins, the leg concerned (or None), and the reason."""

    time: float
    phase: CrawlPhase
    leg: str | None
    reason: str


class Crawl(Gait):
    """Walks with a trunk controller. Uses measurements only; one `update` per control period.

    It starts standing; `resume` starts walking, and `request_stop` stops after the current step. `steps.command` is the
    desired motion, which applies from the next step on. `reason` says why it stands or retreats, `failed` whether it
    stopped because it could not continue; `events` has every transition.
    """

    def __init__(
        self, controller: TrunkController, settings: CrawlSettings | None = None, command: CrawlCommand | None = None
    ) -> None:
        super().__init__(controller)
        self.settings = settings or CrawlSettings.of(controller.robot)
        self.phase, self.reason, self.failed = CrawlPhase.STAND, "not asked to walk yet", False
        self.events: list[CrawlEvent] = []
        self.steps = StepSequence(controller.robot, self.settings, command or CrawlCommand())
        self._walks, self._stop = False, ""
        self._body: BodyReference | None = None
        # of the coming or present step: its foothold, when its leg lifts, for how long that was put off
        self._target, self._due, self._put_off, self._relieving = np.zeros(3), 0.0, 0.0, False
        # of the swing: where the foot stood, when the trajectory ends, whether the body waits for it, times at its lift
        self._from, self._ends, self._late, self._above = np.zeros(3), 0.0, False, False
        self._timing = self.steps.timing
        self._overloaded, self._time = np.zeros(len(controller.robot.tree.joints)), np.nan

    # -- asked for ------------------------------------------------------------------------------------------------
    def resume(self) -> None:
        """Starts walking, or continues with the leg whose turn it is."""
        self._walks, self._stop, self.failed = True, "", False

    def request_stop(self) -> None:
        """Stops on four feet after the current step; see `stopped`."""
        self._walks, self._stop = False, self._stop or "asked to stop"

    @property
    def stopped(self) -> bool:
        """True if it stands on four feet, with its reference at rest."""
        standing = self.phase is CrawlPhase.STAND and self._body is not None
        return standing and self.controller.time >= self._planned.plan.end

    @property
    def fault(self) -> str:
        """Reason why it stands and cannot continue; empty if it can."""
        return self.reason if self.failed and self.phase is CrawlPhase.STAND else ""

    # -- what the test-bed's loop asks for ------------------------------------------------------------------------
    def update(self, measurement: Measurement) -> Array:
        """Joint torques (n,) [N·m] for one measurement."""
        if self._body is None:
            torque = self.controller.update(measurement)
            self._body = BodyReference(self.controller, self.settings, measurement)
            self.controller.follow(self._body)
            nose = self.controller.rotation[:, 0]
            self.steps.start(self.controller.feet, float(np.arctan2(nose[1], nose[0])))
            self.events.append(CrawlEvent(measurement.time, self.phase, None, self.reason))
            return torque
        self._body.see(measurement)
        self._watch_limits(measurement.time)
        self._advance(measurement.time)
        return self.controller.update(measurement)

    # -- the state machine ----------------------------------------------------------------------------------------
    def _watch_limits(self, time: float) -> None:
        """Fails if a joint has been at its torque limit for too long without a break."""
        elapsed, self._time = 0.0 if np.isnan(self._time) else time - self._time, time
        self._overloaded = np.where(self.controller.saturated, self._overloaded + elapsed, 0.0)
        worst, longest = int(np.argmax(self._overloaded)), self.settings.overload
        if self._walks and self._overloaded[worst] > longest:
            self._fail(f"joint {self.robot.tree.joints[worst]} has been at its torque limit for {longest} s")

    def _advance(self, time: float) -> None:
        match self.phase:
            case CrawlPhase.STAND if self._walks:
                self._begin_step(time, self.settings.lead, None)
            case CrawlPhase.BODY:
                self._shift_body(time)
            case CrawlPhase.SWING:
                self._watch_swing(time)
            case CrawlPhase.RETREAT:
                self._put_back(time)

    def _begin_step(self, time: float, body: float, landed: int | None) -> None:
        """Starts the body's motion so that the next leg can swing after `body` [s]; `landed`: the last leg to land."""
        timing, feet, target = self.steps.timing, self.controller.feet, self.steps.target
        self._put_off = 0.0
        self._target = np.array([*target, GroundPlane.of(feet).at(target)])
        before = None if landed is None else Step(landed, feet[landed, :2], timing.transfer)
        body = self._plan_step(time, before, body)
        self._planned.follow_ground(time, self.steps.heading, body + timing.swing)
        self._enter(CrawlPhase.BODY, self.steps.leg, "")

    def _plan_step(self, time: float, before: Step | None, body: float) -> float:
        """Plans for a lift after `body` [s], or later if a new model needs more time; returns that time."""
        timing, settings = self.steps.timing, self.settings
        for delay in settings.delays if self._model_moved() else (0.0,):
            later = body + delay * settings.lead
            self._replan(time, before, later)
            # centre of mass and zero-moment point have to be inside the coming triangle when the leg is lifted
            begin, end = time + later - 0.5 * timing.transfer, time + later + timing.swing
            if self._planned.least_margin(self._triangle(), begin, end) >= settings.least_margin:
                break
        self._due = time + later
        return later

    def _model_moved(self) -> bool:
        return self._planned.moved > self.settings.moved * self.settings.margin

    def _shift_body(self, time: float) -> None:
        leg, controller, timing = self.steps.leg, self.controller, self.steps.timing
        if self._stop:
            self._stand(time, self._stop)
        elif not self._relieving and self._model_moved():
            self._plan_step(time, None, max(self._due - time, timing.transfer))
        elif not self._relieving and time >= self._due - timing.transfer:
            if self._margin() >= self.settings.least_margin:
                controller.relieve(leg, timing.transfer)
                self._relieving = True
            else:
                self._put_step_off(time)
        elif time >= self._due and controller.relieved[leg]:
            if self._margin() >= self.settings.least_margin:
                self._lift(time)
            else:
                self._put_step_off(time)

    def _triangle(self) -> SupportPolygon:
        return SupportPolygon.of(np.delete(self.controller.feet, self.steps.leg, axis=0))

    def _margin(self) -> float:
        return self._triangle().margin(self._planned.com)

    def _put_step_off(self, time: float) -> None:
        """Gives the body the same time again; stops when the time limit is reached."""
        settings, timing = self.settings, self.steps.timing
        if self._put_off >= settings.patience:
            place = f"the triangle without {LEG_NAMES[self.steps.leg]}"
            found = f"margin {self._margin():.3f} m, needed {settings.least_margin:.3f} m"
            self._fail(f"the centre of mass does not get over {place}: {found}")
            self._stand(time, self._stop)
            return
        if self._relieving:
            self.controller.land(self.steps.leg, timing.transfer)
            self._relieving = False
        wait = max(settings.lead, 3.0 * timing.transfer)
        self._put_off += max(time + wait - self._due, 0.0)
        self._due = time + wait
        self._replan(time, None, wait)

    # -- the leg in the air ---------------------------------------------------------------------------------------
    def _lift(self, time: float) -> None:
        settings = self.settings
        self._late, self._from, self._timing = False, self._foot, self.steps.timing
        goal = self._target - settings.press * self._planned.normal  # slightly below the ground
        self._swing(time, goal, settings.clearance, settings.search_speed)
        self._enter(CrawlPhase.SWING, self.steps.leg, "")

    def _watch_swing(self, time: float) -> None:
        leg, overdue = self.steps.leg, time - self._ends
        if self._landed(time):
            self.steps.done()
            if self._stop:
                self._stand(time, self._stop)
            else:
                self._begin_step(time, self.steps.body_time(overdue), leg)
        elif overdue >= 0 and (
            self._target[2] - float(self._foot[2]) > self.settings.search or self._planned.stretched(leg)
        ):
            self._retreat(time)
        elif overdue >= 0.5 * self._timing.transfer and not self._late:
            self._late = True
            self._replan(time, self._airborne, None)  # the body waits over the three feet

    def _landed(self, time: float) -> bool:
        """Lands the foot if it has touched the ground; torques of an extended leg do not show it."""
        leg, controller = self.steps.leg, self.controller
        trajectory = controller.swinging.trajectories[leg]
        if trajectory is None or self._planned.stretched(leg) or not controller.swinging.touched[leg]:
            return False
        if trajectory.progress(time) < self.settings.earliest:
            return False
        controller.land(leg, self._timing.transfer)
        return True

    def _retreat(self, time: float) -> None:
        """Lifts a foot that has found no ground straight up; `_put_back` does the rest."""
        leg, (x, y, z), here = self.steps.leg, self._target, self._foot
        self._fail(f"{LEG_NAMES[leg]} found no ground within {self.settings.search:.2f} m below ({x:.2f}, {y:.2f}) m")
        high = max(z, self._from[2]) + self.settings.clearance
        self._target, self._late, self._above = self._from, True, True
        self._swing(time, np.array([*here[:2], high]), 0.0, 0.0)
        self._replan(time, self._airborne, None)
        self._enter(CrawlPhase.RETREAT, leg, self._stop)

    def _put_back(self, time: float) -> None:
        """Moves the foot back to its previous foothold."""
        if self._above:
            if time >= self._ends:
                self._above = False
                self._swing(time, self._target, 0.0, self.settings.search_speed)
        elif self._landed(time):
            self._stand(time, self._stop)

    @property
    def _airborne(self) -> Step:
        """For the body's plan: where the foot lands, after a long time on the other three."""
        return Step(self.steps.leg, self._target[:2], self.settings.longest_airborne)

    @property
    def _foot(self) -> Array:
        return np.array(self.controller.feet[self.steps.leg])

    def _swing(self, time: float, goal: Array, clearance: float, descent: float) -> None:
        duration = self._timing.swing
        self._ends = time + duration
        way = SwingTrajectory(self._foot, goal, time, duration, clearance, descent=descent)
        self.controller.swing(self.steps.leg, way)

    # -- planning -------------------------------------------------------------------------------------------------
    def _stand(self, time: float, reason: str) -> None:
        """Moves the body to the middle of four feet on the ground, and stays."""
        if self._relieving:
            self.controller.land(self.steps.leg, self.steps.timing.transfer)
        self._walks, self._stop = False, ""
        self._replan(time, None, None)
        self._enter(CrawlPhase.STAND, None, reason)

    def _fail(self, reason: str) -> None:
        self._walks, self._stop, self.failed = False, reason, True

    def _enter(self, phase: CrawlPhase, leg: int | None, reason: str) -> None:
        self.phase, self.reason, self._relieving = phase, reason, False
        self.events.append(CrawlEvent(self.controller.time, phase, None if leg is None else LEG_NAMES[leg], reason))

    @property
    def _planned(self) -> BodyReference:
        assert self._body is not None
        return self._body

    def _replan(self, time: float, airborne: Step | None, body: float | None) -> None:
        """Plans the body's motion again, with coming steps, the first after `body` [s]; None for a stand."""
        timing, settings, feet = self.steps.timing, self.settings, self.controller.feet
        steps = [] if body is None or self._stop else self.steps.ahead(body)
        phases = support_phases(feet, steps, timing, settings.margin, settings.lead, airborne)
        self._planned.replan(time, phases, settings.margin, timing.rest)


class BodyReference:
    """A `TrunkReference`, which holds the trunk at the controller's reference until the first `replan`: `plan` of the
    centre of mass, `normal` (3,) of the ground, to which the trunk is parallel.
    """

    def __init__(self, controller: TrunkController, settings: CrawlSettings, measurement: Measurement) -> None:
        self._controller, self._settings = controller, settings
        self._nominal = _determinants(controller.legs.nominal_jacobians())
        self._mass, self._moment = controller.trunk.target_mass, controller.trunk.target_moment
        self.see(measurement)
        here = controller.reference
        self.plan = ComPlan.standing(controller.time, (here.position + here.rotation @ self._planned_lever)[:2])
        pose = TrunkPose(np.array([0.0, 0.0, here.position[2]]), here.rotation)
        self._pose = Move(pose, pose, controller.time, 1.0)
        plane = GroundPlane.of(controller.feet)
        self.normal, self._height = plane.normal, float(controller.position[2] - plane.at(controller.position))

    def see(self, measurement: Measurement) -> None:
        """Updates the pose of the legs; must be called before each use of a new measurement."""
        state = self._controller.legs.measured(measurement)
        self._legs, self._room = state.moment, _determinants(state.jacobians(state.feet)) / self._nominal

    def stretched(self, leg: int) -> bool:
        """True if a leg is nearly extended, so that its foot cannot reach farther."""
        return bool(self._room[leg] < self._settings.stretched)

    def _lever(self, mass: float, moment: Array) -> Array:
        """c, with a trunk of this mass [kg] and first moment [kg·m]."""
        return np.asarray((moment + self._legs) / (mass + self._controller.legs.leg_mass))

    @property
    def _planned_lever(self) -> Array:
        return self._lever(self._mass, self._moment)

    @property
    def _present_lever(self) -> Array:
        return self._lever(self._controller.trunk.target_mass, self._controller.trunk.target_moment)

    @property
    def moved(self) -> float:
        """Horizontal distance of the modelled centre of mass from the plan's [m]."""
        away = self._controller.rotation @ (self._present_lever - self._planned_lever)
        return float(np.hypot(away[0], away[1]))

    @property
    def com(self) -> Array:
        """The robot's modelled centre of mass now, (3,) [m], odometry frame."""
        return np.asarray(self._controller.position + self._controller.rotation @ self._present_lever)

    @property
    def _ground(self) -> float:
        controller = self._controller
        return float(controller.feet[controller.stance, 2].mean())

    def least_margin(self, support: SupportPolygon, begin: float, end: float) -> float:
        """Least margin [m] of the planned centre of mass and zero-moment point in a polygon, over a time range [s]."""
        tau2 = (float(self.com[2]) - self._ground) / GRAVITY
        states = np.array([self.plan.at(time) for time in np.linspace(begin, end, self._settings.looks)])
        points = np.concatenate([states[:, 0], states[:, 0] - tau2 * states[:, 2]])
        return float(np.min(support.distances - points @ support.normals.T))

    def at(self, time: float) -> TrunkPose:
        (position, velocity, acceleration), pose = self.plan.at(time), self._pose.at(time)
        lever = self._planned_lever
        arm, turning = pose.rotation @ lever, pose.rotation @ np.cross(pose.angular_velocity, lever)
        return TrunkPose(
            np.array([*(position - arm[:2]), pose.position[2]]),
            pose.rotation,
            np.array([*(velocity - turning[:2]), pose.velocity[2]]),
            pose.angular_velocity,
            np.array([*acceleration, pose.acceleration[2]]),
        )

    def replan(self, time: float, phases: Sequence[SupportPhase], margin: float, rest: float) -> None:
        """Plans the centre of mass again, with the present trunk model from the present reference; see `plan_com`."""
        now = self.at(time)
        trunk = self._controller.trunk
        self._mass, self._moment = trunk.target_mass, trunk.target_moment
        com = now.position + now.rotation @ self._planned_lever
        start = self.plan.at(time).copy()
        start[0] = com[:2]
        self.plan = plan_com(time, start, phases, float(com[2]) - self._ground, margin, rest)

    def follow_ground(self, time: float, heading: float, duration: float) -> None:
        """Turns the trunk parallel to the ground under the feet, with a heading [rad], and moves it to its height at
        the place where it is going, within a duration [s]. Each call follows half of a change of inclination.
        """
        plane = GroundPlane.of(self._controller.feet)
        normal = self.normal + self._settings.follows * (plane.normal - self.normal)
        self.normal = normal / np.linalg.norm(normal)
        way = self.plan.at(time + duration)[0] - self.plan.at(time)[0]
        height = plane.at(self.at(time).position[:2] + way) + self._height
        goal = TrunkPose(np.array([0.0, 0.0, height]), facing(self.normal, heading))
        self._pose = Move(self._pose.at(time), goal, time, duration)


def _determinants(jacobians: Array) -> Array:
    return np.asarray(np.abs(np.linalg.det(jacobians)))
