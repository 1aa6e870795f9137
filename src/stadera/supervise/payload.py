"""What was put on since the tare, told by a robot that walks: poses at rest, before and after."""

from __future__ import annotations

from collections import deque

from stadera.estimate.equilibrium import ConstantErrors
from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.measurement import Measurement
from stadera.estimate.pose_means import Alike, PoseMean
from stadera.estimate.poses import SETTLED
from stadera.estimate.protocol import TrunkEstimate
from stadera.estimate.stillness import StillnessGate
from stadera.estimate.trunk import TrunkModel
from stadera.supervise.zeroed import ZeroedForces
from stadera.weigh.payload import PayloadEstimate, payload_between, payload_of_difference

_MOST_POSES = 12
_MOST_WAITING = 1000  # measurements


class PayloadScale:
    """Keeps poses at rest without the payload and with it.

    Args:
        forces: whose legs are believed in.
        tare: the trunk without the payload, as believed; used where no pose of it was held at rest.
    """

    def __init__(self, forces: ContactForceEstimator, tare: TrunkModel) -> None:
        self._forces, self._tare = forces, tare
        self._gate, self._alike = StillnessGate(forces.legs, SETTLED), Alike()
        self._before: list[PoseMean] = []
        self._after: list[PoseMean] = []
        self._waiting: deque[Measurement] = deque(maxlen=_MOST_WAITING)

    def take(self, m: Measurement, *, loaded: bool) -> None:
        """One more measurement, of the load or of the tare; those that are not at rest are left alone.

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
            del poses[:-_MOST_POSES]

    def new_load(self) -> None:
        """The load is another one; what has not been confirmed is of no use."""
        self._after.clear()
        self._waiting.clear()

    def payload(self, trunk: TrunkEstimate, scale: ZeroedForces) -> PayloadEstimate:
        """What the trunk carries more than at the tare.

        By the difference of poses, in which constant errors cancel; where none was held before, by the difference of
        `trunk` to what was believed.

        Args:
            trunk: as weighed.
            scale: the torque offsets, as known by now.
        """
        if not (self._before and self._after):
            return payload_of_difference(self._tare, trunk)
        before, after = ([_zeroed(pose, scale) for pose in poses] for poses in (self._before, self._after))
        return payload_between(before, after, scale.forces, ConstantErrors.of(scale.forces.noise))


def _zeroed(pose: PoseMean, scale: ZeroedForces) -> PoseMean:
    mean = PoseMean(scale.measurement(pose.measurement))
    mean.count = pose.count
    return mean
