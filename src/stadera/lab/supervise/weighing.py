"""Weighs a robot that has stopped: first the mass (eq. 7), then the centre of mass by a chosen method.

Controller and planner keep their model meanwhile. The result is a `TrunkEstimate`, or a sentence on why there is none.
"""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum

import numpy as np

from stadera.errors import StaderaError
from stadera.lab.laws.mass import MassEstimator
from stadera.lab.laws.static_poses import PoseOffset, static_poses
from stadera.lab.supervise.corrected import CorrectedForces
from stadera.lab.supervise.settings import SuperviseSettings
from stadera.lab.supervise.walker import PosingWalker, Walker
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import Estimator, Status, TrunkEstimate
from stadera.trunk.registry import Setup, make_estimator


class Stage(StrEnum):
    """Stage of a weighing."""

    MASS = "mass"
    COM = "centre of mass"
    DONE = "done"
    FAILED = "failed"


class StandingWeighing:
    """Weighs mass, then centre of mass, of a robot that stands, from corrected contact forces.

    The walker leans, for methods that need poses, and states its posture for the method "orientation". `trunk` is the
    controller's meanwhile, `begin` the present time [s], `reason` that of a failure, `estimate` None before the first.

    Raises:
        StaderaError: the method needs poses or the posture, and the walker provides neither.
    """

    def __init__(
        self, corrected: CorrectedForces, trunk: TrunkModel, walker: Walker, settings: SuperviseSettings, begin: float
    ) -> None:
        self.corrected, self.forces, self.settings = corrected, corrected.forces, settings
        self.stage, self.reason = Stage.MASS, ""
        self.estimate: TrunkEstimate | None = None
        self._trunk, self._begin = trunk, begin
        self._walker = require_poses(walker, settings.method) if settings.method != "contact" else None
        self._estimator: Estimator = MassEstimator(self.forces.robot, trunk, self.forces)
        count = settings.posing.poses.get(settings.method)
        self._poses = [] if count is None else list(static_poses(self.forces.robot, count=count))
        self._held_from, self._held_until = -np.inf, np.inf

    def update(self, m: Measurement) -> None:
        """Processes one measurement."""
        if self.stage in (Stage.DONE, Stage.FAILED):
            return
        if m.time >= self._held_from:
            self._estimator.update(self.corrected.measurement(m))
            self.estimate = self._estimator.estimate()
        if self.stage is Stage.MASS:
            self._weigh(m)
        elif self._poses or self._held_until < np.inf:
            self._pose(m)
        else:
            self._locate(m)

    def _weigh(self, m: Measurement) -> None:
        found = self.estimate
        if found is None or found.status is not Status.CONVERGED:
            self._give_up_after(m.time, self.settings.mass_within)
            return
        start = TrunkModel(found.trunk.mass, self._trunk.com_trunk, self._trunk.inertia_com)
        posture = None if self._walker is None else replace(self._walker.posture(), feeds_back=False)
        setup = Setup(self.forces.robot, start, self.forces, posture)
        self._estimator = make_estimator(self.settings.method, setup)
        self.stage, self._begin = Stage.COM, m.time

    def _locate(self, m: Measurement) -> None:
        if self.estimate is not None and self.estimate.status is Status.CONVERGED:
            self.stage = Stage.DONE
        else:
            self._give_up_after(m.time, self.settings.com_within)

    def _pose(self, m: Measurement) -> None:
        """Leads the trunk through the poses and back; measurements in between are ignored."""
        how = self.settings.posing
        if m.time < self._held_until < np.inf or self._walker is None:
            return
        if self._poses:
            self._walker.lean(self._poses.pop(0), how.move)
            self._held_from, self._held_until = m.time + how.move, m.time + how.move + how.hold
        elif self._held_from < np.inf:
            self._walker.lean(PoseOffset(), how.move)
            self._held_from, self._held_until = np.inf, m.time + how.move + how.back
        else:
            self._held_until = np.inf
            self._end_poses()

    def _end_poses(self) -> None:
        status = Status.WAITING if self.estimate is None else self.estimate.status
        if status in (Status.CONVERGED, Status.MOVING):
            self.stage = Stage.DONE
        else:
            self._fail(f"the poses did not show the centre of mass: {self._last_word()}")

    def _give_up_after(self, time: float, limit: float) -> None:
        if time - self._begin > limit:
            self._fail(f"the {self.stage} did not converge within {limit:g} s: {self._last_word()}")

    def _last_word(self) -> str:
        if self.estimate is None:
            return "nothing was measured"
        return self.estimate.reason or f"the estimate is {self.estimate.status}"

    def _fail(self, reason: str) -> None:
        self.stage, self.reason = Stage.FAILED, reason


def require_poses(walker: Walker, method: str) -> PosingWalker:
    """Returns the walker if it can lean; else StaderaError."""
    if not isinstance(walker, PosingWalker):
        raise StaderaError(f"the method {method!r} needs a walker that can lean and tells its posture; use 'contact'")
    return walker
