"""A crawl's leg in the air: lifted, put down where it feels the ground, taken back where there is none."""

from __future__ import annotations

import numpy as np

from stadera.lab.control.crawl.settings import CrawlSettings, StepTiming
from stadera.lab.control.planner.steps import Airborne
from stadera.lab.control.swing import SwingTrajectory
from stadera.lab.control.trunk import TrunkController
from stadera.types import Array


class LegSwing:
    """One leg at a time, on its way by the trunk controller.

    Args:
        controller: after its first update.
        settings: sizes of the way.

    Attributes:
        leg: its index.
        target: (3,) [m], where the foot is to land.
        late: whether whoever asks has taken note that it is overdue; set by them.
    """

    def __init__(self, controller: TrunkController, settings: CrawlSettings) -> None:
        self._controller, self._settings = controller, settings
        self.leg, self.target, self.late = 0, np.zeros(3), False
        self._from, self._ends, self._swing, self._transfer, self._above = np.zeros(3), 0.0, 1.0, 1.0, False

    def lift(self, time: float, leg: int, target: Array, normal: Array, timing: StepTiming) -> None:
        """Off to a target (3,) [m], pressed into the ground of that normal (3,) a little."""
        self.leg, self.target, self.late = leg, target, False
        self._swing, self._transfer, self._from = timing.swing, timing.transfer, self._foot
        goal = target - self._settings.press * normal
        self._go(time, goal, self._settings.clearance, self._settings.search_speed)

    def landed(self, time: float, stretched: bool) -> bool:
        """Puts the foot down where it has touched the ground; torques of a stretched leg do not tell it."""
        controller = self._controller
        trajectory = controller.swinging.trajectories[self.leg]
        if trajectory is None or stretched or not controller.touched[self.leg]:
            return False
        if trajectory.progress(time) < self._settings.tuning.earliest:
            return False
        controller.land(self.leg, self._transfer)
        return True

    def overdue(self, time: float) -> float:
        """How long ago the foot was to land [s]; negative before."""
        return time - self._ends

    def overdue_long(self, time: float) -> bool:
        """Whether the body had better wait for it."""
        return self.overdue(time) >= 0.5 * self._transfer

    def out_of_reach(self, time: float, stretched: bool) -> bool:
        """Whether it has felt for the ground deep enough, or can get no farther."""
        deep = self.target[2] - float(self._foot[2]) > self._settings.search
        return self.overdue(time) >= 0 and (deep or stretched)

    def retreat(self, time: float) -> None:
        """Straight up out of the hole first; `back` does the rest."""
        here = self._foot
        high = max(self.target[2], self._from[2]) + self._settings.clearance
        self.target, self.late, self._above = self._from, True, True
        self._go(time, np.array([*here[:2], high]), 0.0, 0.0)

    def back(self, time: float, stretched: bool) -> bool:
        """From above the hole to where the foot stood; True as it stands there again."""
        if self._above:
            if time >= self._ends:
                self._above = False
                self._go(time, self.target, 0.0, self._settings.search_speed)
            return False
        return self.landed(time, stretched)

    def airborne(self) -> Airborne:
        """For the body's plan: where the foot lands, after the others have carried for long."""
        return Airborne(self.leg, self.target[:2], self._settings.tuning.longest_airborne)

    @property
    def _foot(self) -> Array:
        return np.array(self._controller.feet[self.leg])

    def _go(self, time: float, goal: Array, clearance: float, descent: float) -> None:
        self._ends = time + self._swing
        way = SwingTrajectory(self._foot, goal, time, self._swing, clearance, descent=descent)
        self._controller.swing(self.leg, way)
