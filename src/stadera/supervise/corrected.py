"""Contact forces without the known torque offsets, and the payload weighed by them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from stadera.trunk.load import Payload
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import TrunkEstimate
from stadera.trunk.standing.detection import StaticDetector
from stadera.trunk.standing.equilibrium import ConstantErrors
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.trunk.standing.payload import payload_between, payload_of_difference
from stadera.trunk.standing.pose_means import Alike, PoseMean
from stadera.trunk.standing.poses import SETTLED
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class CorrectedForces:
    """Contact forces of torques whose constant offsets are known.

    Attributes:
        forces: its noise has the offsets' remaining uncertainty for their constant part.
        offsets: (12,) [N·m], leg by leg.
    """

    forces: ContactForceEstimator
    offsets: Array

    @classmethod
    def of(cls, forces: ContactForceEstimator, offsets: Array, std: Array) -> CorrectedForces:
        """Offsets and their standard deviations, (12,) [N·m]."""
        noise = replace(forces.noise, torque_constant=std.reshape(4, 3))
        return cls(ContactForceEstimator(forces.robot, noise, jacobian=forces.jacobian), offsets)

    @classmethod
    def none(cls, forces: ContactForceEstimator) -> CorrectedForces:
        """Without a correction."""
        return cls(forces, np.zeros(12))

    def measurement(self, m: Measurement) -> Measurement:
        """The measurement less the offsets; itself if there are none."""
        if not self.offsets.any():
            return m
        effort = m.effort.copy()
        effort[self.forces.legs.columns.ravel()] -= self.offsets
        return replace(m, effort=effort)

    def pose(self, pose: PoseMean) -> PoseMean:
        """The mean of a pose less the offsets."""
        mean = PoseMean(self.measurement(pose.measurement))
        mean.count = pose.count
        return mean


@dataclass(frozen=True)
class PayloadSettings:
    """What is kept to weigh the payload by: the last poses, and measurements that wait to be confirmed."""

    most_poses: int = 12
    most_waiting: int = 1000


class PayloadScale:
    """Keeps poses at rest without the payload and with it.

    Args:
        forces: of the robot's legs.
        tare: the trunk without the payload; used where no pose of it was held at rest.
        settings: None for the defaults.
    """

    def __init__(
        self, forces: ContactForceEstimator, tare: TrunkModel, settings: PayloadSettings | None = None
    ) -> None:
        self._forces, self._tare, self._settings = forces, tare, settings or PayloadSettings()
        self._gate, self._alike = StaticDetector(forces.legs, SETTLED), Alike()
        self._before: list[PoseMean] = []
        self._after: list[PoseMean] = []
        self._waiting: deque[Measurement] = deque(maxlen=self._settings.most_waiting)

    def take(self, m: Measurement, *, loaded: bool) -> None:
        """One more measurement, with the load or of the tare; motion is ignored.

        Those of the tare wait until a check says that nothing had changed (`confirm`).
        """
        if self._gate.complaint(m, self._forces.at(m)):
            return
        if loaded:
            self._add(m, self._after)
        else:
            self._waiting.append(m)

    def confirm(self, until: float) -> None:
        """Nothing had changed until this time [s]: the tare's measurements up to it count."""
        while self._waiting and self._waiting[0].time <= until:
            self._add(self._waiting.popleft(), self._before)

    def _add(self, m: Measurement, poses: list[PoseMean]) -> None:
        if not (poses and poses[-1].takes(m, self._alike)):
            poses.append(PoseMean(m))
            del poses[: -self._settings.most_poses]

    def new_load(self) -> None:
        """The load has changed: what has not been confirmed is dropped."""
        self._after.clear()
        self._waiting.clear()

    def payload(self, trunk: TrunkEstimate, corrected: CorrectedForces) -> Payload:
        """The payload since the tare.

        By the difference of poses, in which constant errors cancel; where none was held before, by the difference of
        `trunk` to the tare.
        """
        if not (self._before and self._after):
            return payload_of_difference(self._tare, trunk)
        before, after = ([corrected.pose(pose) for pose in poses] for poses in (self._before, self._after))
        return payload_between(before, after, corrected.forces, ConstantErrors.of(corrected.forces.noise))
