"""Swing of a crawl's leg: lift, landing at touch-down, and return if there is no ground."""

from __future__ import annotations

import numpy as np

from stadera.lab.control.crawl.settings import CrawlSettings, StepTiming
from stadera.lab.control.planner.steps import Airborne
from stadera.lab.control.swing import SwingTrajectory
from stadera.lab.control.trunk import TrunkController
from stadera.types import Array


class LegSwing:
    """Moves one leg at a time with the trunk controller.

    Args:
        controller: after its first update.
        settings: sizes of the swing.

    Attributes:
        leg: index of the leg.
        target: (3,) [m], foothold.
        late: True if the caller has registered that it is overdue; set by the caller.
    """

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
