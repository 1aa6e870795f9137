"""Supervisor that weighs a payload without stopping the robot.

    WALKING -> WEIGHING -> WALKING

`WEIGHING` lasts from the detection of a change until the new estimate is accurate enough (`stadera.trunk.trusted`).
Until then controller and planner keep the last trunk; from then on they get every better one, while the robot walks on.
"""

from __future__ import annotations

from stadera.lab.supervise.strength import hardest_effort
from stadera.lab.supervise.walker import State, Supervised, Walker
from stadera.robot.model import Robot
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.load import LoadChange, Payload
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import Status, TrunkEstimate
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.trusted import TrustedEstimator, TrustLimits


class NonstopSupervisor(Supervised):
    """Processes every measurement, and passes the trunk's estimate to a walker that is walking.

    The first sufficiently accurate estimate is the tare, which is refined with the trunk until a load is added.
    STANDING is final: the walker cannot continue, or the load is too heavy. `limits`: the accuracy needed.
    """

    def __init__(
        self,
        robot: Robot,
        walker: Walker,
        trunk: TrunkModel | None = None,
        settings: TrunkSettings | None = None,
        limits: TrustLimits | None = None,
    ) -> None:
        super().__init__(robot, walker, trunk)
        self.estimator = TrunkEstimator(robot, start=self.trunk, settings=settings)
        self._trusted = TrustedEstimator(self.estimator, robot, self.trunk, limits)
        self._noticed: list[float] = []
        self._seen = self._handed = self._trusted.estimate()

    @property
    def noticed(self) -> tuple[float, ...]:
        """Times of detection of changes of the load [s]."""
        return tuple(self._noticed)

    @property
    def estimate(self) -> TrunkEstimate:
        """The trunk's estimate, whether accurate enough for the controller or not."""
        return self.estimator.estimate()

    @property
    def payload(self) -> Payload | None:
        """The payload since the tare; None before the tare."""
        return self.estimator.payload

    def update(self, m: Measurement) -> None:
        """Processes one measurement. Times must increase."""
        self._trusted.update(m)
        estimate = self.estimator.estimate()
        if self.state is State.STANDING or estimate is self._seen:
            return
        self._seen = estimate
        self._notice(m.time)
        self._hand_on(m.time)
        if fault := self.walker.fault:
            self._stand(m.time, fault)

    # -- inside -----------------------------------------------------------------------------------------------
    def _notice(self, time: float) -> None:
        changes = self.estimator.changes
        if changes and (not self._noticed or changes[-1].noticed > self._noticed[-1]):
            self._noticed.append(changes[-1].noticed)
            if self.state is State.WALKING:
                self._become(time, State.WEIGHING, _sentence(changes[-1]))

    def _hand_on(self, time: float) -> None:
        """Passes the trunk to the walker, if it is accurate enough and new."""
        found = self._trusted.estimate()
        if found is self._handed or found.status not in (Status.MOVING, Status.CONVERGED):
            return
        if self._handed.status is Status.WAITING:
            self.estimator.tare()
        self._handed = found
        if not self.walker.update_trunk(found.trunk):
            return
        self.trunk = found.trunk
        if self.state is not State.WEIGHING:
            return
        hardest = hardest_effort(self.robot, found.trunk)
        if hardest.share >= 1.0:
            self._stand(time, f"too heavy to walk with: on three legs {hardest.joint!r} has not the torque")
            return
        mass, x, y, _ = found.std
        known = f"{found.trunk.mass:.2f} ± {mass:.2f} kg, its centre of mass to {1e3 * max(x, y):.1f} mm"
        self._become(time, State.WALKING, f"controller and planner have taken the new trunk: {known}")

    def _stand(self, time: float, reason: str) -> None:
        if self.state is State.STANDING:
            return
        self.walker.request_stop()
        self._become(time, State.STANDING, reason)


def _sentence(change: LoadChange) -> str:
    if change.kind == "shifted":
        return "the load has shifted"
    what = "added" if change.kind == "on" else "removed"
    ago = change.noticed - change.time
    return f"{abs(change.mass):.1f} ± {change.mass_std:.1f} kg were {what}, {ago:.2f} s ago by the rows since"
