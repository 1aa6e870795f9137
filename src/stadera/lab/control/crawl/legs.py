"""Legs of a crawl: sequence and footholds of the steps, and the swing of a leg until it lands or is put back."""

from __future__ import annotations

import numpy as np

from stadera.body.statics import nominal_feet
from stadera.lab.control.crawl.settings import CrawlCommand, CrawlSettings, StepTiming, standing_height
from stadera.lab.control.planner.feet import Footholds, PathPose
from stadera.lab.control.planner.steps import Airborne, PlannedStep, body_times
from stadera.lab.control.swing import SwingTrajectory
from stadera.lab.control.trunk import TrunkController
from stadera.robot.model import LEG_NAMES, Robot
from stadera.types import Array


class StepSequence:
    """The steps of a crawl along its path; `timing` is that of the command."""

    def __init__(self, robot: Robot, settings: CrawlSettings, command: CrawlCommand) -> None:
        self._settings, self._height = settings, standing_height(robot)
        self._order = tuple(LEG_NAMES.index(name) for name in settings.sequence)
        self._turn = 0
        feet = nominal_feet(robot)
        self._footholds, self._path = Footholds.of(feet, 0.0)
        self.timing: StepTiming
        self.command = command

    @property
    def command(self) -> CrawlCommand:
        """Desired motion."""
        return self._command

    @command.setter
    def command(self, command: CrawlCommand) -> None:
        settings = self._settings
        self.timing, self._command = settings.timing(command), command
        stride = abs(command.speed) * 4.0 * self.timing.step
        offsets = self._footholds.offsets
        self._body_times = body_times(offsets, self._order, stride, self.timing, self._height, settings.margin)

    def start(self, feet: Array, heading: float) -> None:
        """Starts the path in the middle of the feet (4, 3) [m], with a heading [rad]."""
        self._footholds, self._path = Footholds.of(feet, heading)

    @property
    def leg(self) -> int:
        return self._order[self._turn % 4]

    @property
    def target(self) -> Array:
        """Foothold of the next leg, (2,) [m]."""
        return self._target(self._turn, self._next(self._path))

    @property
    def heading(self) -> float:
        """Heading of the path at its landing [rad]."""
        return self._next(self._path).heading

    def done(self) -> None:
        """Advances to the next leg after a landing."""
        self._path, self._turn = self._next(self._path), self._turn + 1

    def body_time(self, late: float) -> float:
        """Time for the body's motion before the next swing [s], shorter after a late landing."""
        body = float(self._body_times[self._turn % 4])
        return max(body - late, self._settings.tuning.least_body * body, 2.0 * self.timing.transfer)

    def ahead(self, body: float) -> list[PlannedStep]:
        """The next steps, the first after a body motion of `body` [s]."""
        steps, path = [], self._path
        for turn in range(self._turn, self._turn + self._settings.tuning.planned):
            path = self._next(path)
            before = body if turn == self._turn else float(self._body_times[turn % 4])
            steps.append(PlannedStep(self._order[turn % 4], self._target(turn, path), before))
        return steps

    def _next(self, path: PathPose) -> PathPose:
        return path.ahead(self._command.speed, self._command.turn, self.timing.step)

    def _target(self, turn: int, path: PathPose) -> Array:
        command, step = self._command, self.timing.step
        return self._footholds.next(self._order[turn % 4], path, command.speed, command.turn, step)


class LegSwing:
    """Moves one leg at a time to its foothold `target` (3,) [m]; `late` is set by the caller when it is overdue."""

    def __init__(self, controller: TrunkController, settings: CrawlSettings) -> None:
        self._controller, self._settings = controller, settings
        self.leg, self.target, self.late = 0, np.zeros(3), False
        self._from, self._ends, self._swing, self._transfer, self._above = np.zeros(3), 0.0, 1.0, 1.0, False

    def lift(self, time: float, leg: int, target: Array, normal: Array, timing: StepTiming) -> None:
        """Starts a swing to a target (3,) [m], slightly below the ground with normal (3,)."""
        self.leg, self.target, self.late = leg, target, False
        self._swing, self._transfer, self._from = timing.swing, timing.transfer, self._foot
        goal = target - self._settings.press * normal
        self._go(time, goal, self._settings.clearance, self._settings.search_speed)

    def landed(self, time: float, stretched: bool) -> bool:
        """Lands the foot if it has touched the ground; torques of an extended leg do not show it."""
        controller = self._controller
        trajectory = controller.swinging.trajectories[self.leg]
        if trajectory is None or stretched or not controller.touched[self.leg]:
            return False
        if trajectory.progress(time) < self._settings.tuning.earliest:
            return False
        controller.land(self.leg, self._transfer)
        return True

    def overdue(self, time: float) -> float:
        """Time since the foot should have landed [s]; negative before."""
        return time - self._ends

    def overdue_long(self, time: float) -> bool:
        """True if the body should wait for it."""
        return self.overdue(time) >= 0.5 * self._transfer

    def out_of_reach(self, time: float, stretched: bool) -> bool:
        """True if the foot has searched deep enough, or cannot reach farther."""
        deep = self.target[2] - float(self._foot[2]) > self._settings.search
        return self.overdue(time) >= 0 and (deep or stretched)

    def retreat(self, time: float) -> None:
        """Lifts the foot straight up; `back` does the rest."""
        here = self._foot
        high = max(self.target[2], self._from[2]) + self._settings.clearance
        self.target, self.late, self._above = self._from, True, True
        self._go(time, np.array([*here[:2], high]), 0.0, 0.0)

    def back(self, time: float, stretched: bool) -> bool:
        """Moves the foot back to its previous foothold; True when it stands there."""
        if self._above:
            if time >= self._ends:
                self._above = False
                self._go(time, self.target, 0.0, self._settings.search_speed)
            return False
        return self.landed(time, stretched)

    def airborne(self) -> Airborne:
        """Data for the body's plan: where the foot lands, after a long time on the other three."""
        return Airborne(self.leg, self.target[:2], self._settings.tuning.longest_airborne)

    @property
    def _foot(self) -> Array:
        return np.array(self._controller.feet[self.leg])

    def _go(self, time: float, goal: Array, clearance: float, descent: float) -> None:
        self._ends = time + self._swing
        way = SwingTrajectory(self._foot, goal, time, self._swing, clearance, descent=descent)
        self._controller.swing(self.leg, way)
