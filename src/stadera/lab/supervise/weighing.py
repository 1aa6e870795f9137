"""Weighs a robot that has stopped: the mass (eq. 7), then the centre of mass by contact forces (c) or static poses (a).

Contact forces come from torques minus the offsets that the walk has shown. Controller and planner keep their model
meanwhile. The result is a `TrunkEstimate`, or a sentence on why there is none.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from stadera.lab.laws.equilibrium import NoisyForces
from stadera.lab.laws.static import MassEstimator
from stadera.lab.laws.static_poses import PoseOffset, static_poses
from stadera.trunk.drives import TERMS, Drives
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import Estimator, Status, TrunkEstimate
from stadera.trunk.registry import Setup, make_estimator

Lean = Callable[[PoseOffset, float], None]
"""Moves the trunk to a pose relative to that in which the robot stopped, within a duration [s]."""


@dataclass(frozen=True)
class WeighingSettings:
    """Times of a weighing at rest [s]."""

    mass_within: float = 6.0  # allowed for the mass to converge
    com_within: float = 15.0  # the same for the centre of mass by contact forces
    poses: int = 5  # number of static poses, each reached and held for
    move: float = 0.8
    hold: float = 1.2
    back: float = 0.5  # to settle after they have been left


class Stage(StrEnum):
    """Stage of a weighing."""

    MASS = "mass"
    COM = "centre of mass"
    DONE = "done"
    FAILED = "failed"


class StandingWeighing:
    """Weighs a standing robot by approach (c), or by (a) if it can `lean`.

    `trunk` is the controller's meanwhile, `begin` the present time [s], `reason` that of a failure, `estimate` None
    before the first. Of `drives`, if they are known, the torques' offsets are subtracted, and what remains unknown of
    these is the constant part of the forces' noise.
    """

    def __init__(
        self,
        forces: NoisyForces,
        trunk: TrunkModel,
        begin: float,
        settings: WeighingSettings | None = None,
        lean: Lean | None = None,
        drives: Drives | None = None,
    ) -> None:
        self._forces, self._offsets, self.settings = forces, np.zeros(()), settings or WeighingSettings()
        if drives is not None:
            at = list(TERMS).index("offset")
            noise = replace(forces.noise, torque_constant=drives.std[:, at])
            self._forces, self._offsets = NoisyForces(forces.robot, noise), (drives.value - drives.model)[:, at]
        self.stage, self.reason = Stage.MASS, ""
        self.estimate: TrunkEstimate | None = None
        self._trunk, self._begin, self._lean = trunk, begin, lean
        self._estimator: Estimator = MassEstimator(forces.robot, trunk, self._forces)
        self._poses = [] if lean is None else list(static_poses(forces.robot, count=self.settings.poses))
        self._held_from, self._held_until = -np.inf, np.inf

    def update(self, m: Measurement) -> None:
        """Processes one measurement."""
        if self.stage in (Stage.DONE, Stage.FAILED):
            return
        if m.time >= self._held_from:
            effort = m.effort.copy()
            effort[self._forces.body.in_legs] -= self._offsets
            self._estimator.update(replace(m, effort=effort))
            self.estimate = self._estimator.estimate()
        converged = self.estimate is not None and self.estimate.status is Status.CONVERGED
        if self.stage is Stage.MASS:
            if converged:
                self._begin_com(m.time)
            else:
                self._give_up_after(m.time, self.settings.mass_within)
        elif self._lean is not None:
            self._pose(m.time, self._lean)
        elif converged:
            self.stage = Stage.DONE
        else:
            self._give_up_after(m.time, self.settings.com_within)

    def _begin_com(self, time: float) -> None:
        assert self.estimate is not None
        start = TrunkModel(self.estimate.trunk.mass, self._trunk.com_trunk, self._trunk.inertia_com)
        setup = Setup(self._forces.robot, start, self._forces)
        self._estimator = make_estimator("contact" if self._lean is None else "poses", setup)
        self.stage, self._begin = Stage.COM, time

    def _pose(self, time: float, lean: Lean) -> None:
        """Leads the trunk through the poses and back; measurements in between are ignored."""
        how = self.settings
        if time < self._held_until < np.inf:
            return
        if self._poses:
            lean(self._poses.pop(0), how.move)
            self._held_from, self._held_until = time + how.move, time + how.move + how.hold
        elif self._held_from < np.inf:
            lean(PoseOffset(), how.move)
            self._held_from, self._held_until = np.inf, time + how.move + how.back
        elif self.estimate is not None and self.estimate.status in (Status.CONVERGED, Status.MOVING):
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
