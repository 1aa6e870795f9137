"""Adapters to the supervisors: a crawl, and a trunk controller that only stands, for weighing without walking."""

from __future__ import annotations

import numpy as np

from stadera.lab.control.crawl.crawl import Crawl
from stadera.lab.control.crawl.settings import CrawlPhase
from stadera.lab.control.gains import ANGULAR, DAMPING
from stadera.lab.control.reference import TrunkPose
from stadera.lab.control.trunk import TrunkController
from stadera.lab.laws.static_poses import PoseOffset
from stadera.trunk.model import TrunkModel
from stadera.trunk.posture import PostureLaw


class CrawlWalker:
    """Implements `Walker` with a `Crawl`, whose planner and trunk controller share one trunk model."""

    def __init__(self, crawl: Crawl) -> None:
        self.crawl = crawl

    @property
    def phase(self) -> str:
        leg = self.crawl.leg
        return str(self.crawl.phase) if leg is None else f"{self.crawl.phase} of {leg}"

    @property
    def stopped(self) -> bool:
        return self.crawl.stopped and self.crawl.phase is CrawlPhase.STAND

    @property
    def fault(self) -> str:
        return self.crawl.reason if self.crawl.failed and self.crawl.phase is CrawlPhase.STAND else ""

    def request_stop(self) -> None:
        self.crawl.request_stop("asked by the supervisor")

    def resume(self) -> None:
        self.crawl.resume()

    def sit(self) -> None:
        self.crawl.sit("asked by the supervisor")

    def update_trunk(self, trunk: TrunkModel) -> bool:
        return self.crawl.update_trunk(trunk)


_SIT, _SITTING_HEIGHT = 1.5, 0.5  # s; share of the standing height


class StandingWalker:
    """A `PosingWalker` on four feet; poses are relative to its reference at the first; `resumed` counts."""

    def __init__(self, controller: TrunkController) -> None:
        self.controller, self.resumed = controller, 0
        self._home: TrunkPose | None = None
        self._phase = "standing"

    @property
    def phase(self) -> str:
        return self._phase

    @property
    def stopped(self) -> bool:
        return self._phase == "standing"

    @property
    def fault(self) -> str:
        return ""

    def posture(self) -> PostureLaw:
        return PostureLaw(self.controller.gains.angular_stiffness, self._at_home().rotation, ANGULAR, DAMPING)

    def request_stop(self) -> None:
        """Does nothing, since it always stands."""

    def resume(self) -> None:
        self.resumed += 1

    def sit(self) -> None:
        """Lowers the trunk by half the height of its feet below it."""
        if self._phase == "standing":
            self._phase = "sitting"
            home = self._at_home()
            anchors = self.controller.odometry.anchors
            height = float(home.position[2] - anchors[:, 2].mean())
            self.controller.move(home.moved(np.array([0.0, 0.0, -_SITTING_HEIGHT * height]), np.zeros(3)), _SIT)

    def update_trunk(self, trunk: TrunkModel) -> bool:
        return self.controller.update_trunk(trunk)

    def lean(self, pose: PoseOffset, duration: float) -> None:
        home = self._at_home()
        self.controller.move(home.moved(home.rotation @ pose.shift, pose.turn), duration)

    def _at_home(self) -> TrunkPose:
        self._home = self._home or self.controller.reference
        return self._home
