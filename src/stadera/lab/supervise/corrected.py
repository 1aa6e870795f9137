"""Contact forces corrected for known torque offsets, and the payload weighed with them."""

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
    """Contact forces from torques whose constant offsets are known."""

    forces: ContactForceEstimator  # its noise has the offsets' remaining uncertainty as the constant part
    offsets: Array  # (12,) [N·m], leg by leg

    @classmethod
    def of(cls, forces: ContactForceEstimator, offsets: Array, std: Array) -> CorrectedForces:
        """Makes the correction from offsets and their standard deviations, (12,) [N·m]."""
        noise = replace(forces.noise, torque_constant=std.reshape(4, 3))
        return cls(ContactForceEstimator(forces.robot, noise, jacobian=forces.jacobian), offsets)

    @classmethod
    def none(cls, forces: ContactForceEstimator) -> CorrectedForces:
        """No correction."""
        return cls(forces, np.zeros(12))

    def measurement(self, m: Measurement) -> Measurement:
        """The measurement minus the offsets; the measurement itself if there are none."""
        if not self.offsets.any():
            return m
        effort = m.effort.copy()
        effort[self.forces.legs.columns.ravel()] -= self.offsets
        return replace(m, effort=effort)

    def pose(self, pose: PoseMean) -> PoseMean:
        """The mean of a pose minus the offsets."""
        mean = PoseMean(self.measurement(pose.measurement))
        mean.count = pose.count
        return mean


@dataclass(frozen=True)
class PayloadSettings:
    """Sizes of the stores for weighing the payload: latest poses, and measurements that await confirmation."""

    most_poses: int = 12
    most_waiting: int = 1000


class PayloadScale:
    """Stores poses at rest without and with the payload; `tare` is used if none was held without it."""

    def __init__(
        self, forces: ContactForceEstimator, tare: TrunkModel, settings: PayloadSettings | None = None
    ) -> None:
        self._forces, self._tare, self._settings = forces, tare, settings or PayloadSettings()
        self._gate, self._alike = StaticDetector(forces.legs, SETTLED), Alike()
        self._before: list[PoseMean] = []
        self._after: list[PoseMean] = []
        self._waiting: deque[Measurement] = deque(maxlen=self._settings.most_waiting)

    def take(self, m: Measurement, *, loaded: bool) -> None:
        """Adds a measurement, with the load or of the tare; measurements in motion are ignored.

        Those of the tare are kept back until a check confirms that nothing had changed (`confirm`).
        """
        if self._gate.complaint(m, self._forces.at(m)):
            return
        if loaded:
            self._add(m, self._after)
        else:
            self._waiting.append(m)

    def confirm(self, until: float) -> None:
        """Confirms that nothing had changed until this time [s]: the tare's measurements up to it are used."""
        while self._waiting and self._waiting[0].time <= until:
            self._add(self._waiting.popleft(), self._before)

    def _add(self, m: Measurement, poses: list[PoseMean]) -> None:
        if not (poses and poses[-1].takes(m, self._alike)):
            poses.append(PoseMean(m))
            del poses[: -self._settings.most_poses]

    def new_load(self) -> None:
        """Discards unconfirmed measurements after a change of the load."""
        self._after.clear()
        self._waiting.clear()

    def payload(self, trunk: TrunkEstimate, corrected: CorrectedForces) -> Payload:
        """The payload since the tare.

        Computed from the difference of poses, in which constant errors cancel; if no pose was held without the payload,
        from the difference between `trunk` and the tare.
        """
        if not (self._before and self._after):
            return payload_of_difference(self._tare, trunk)
        before, after = ([corrected.pose(pose) for pose in poses] for poses in (self._before, self._after))
        return payload_between(before, after, corrected.forces, ConstantErrors.of(corrected.forces.noise))
