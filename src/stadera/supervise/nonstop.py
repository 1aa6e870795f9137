"""Notices, weighs and takes over a load without a stop: the walking estimator beside a robot that walks on.

    WALKING -> WEIGHING -> WALKING

`WEIGHING` lasts from the moment a change is noticed until the new trunk is known well enough to be walked by
(`stadera.estimate.trusted`). Until then controller and planner keep the last one; from then on they get every better
one, whole, while the legs go on stepping. Pure, as `Supervisor`: it tells the walker what to believe, and keeps what
happened as values.
"""

from __future__ import annotations

import numpy as np

from stadera.estimate.measurement import Measurement
from stadera.estimate.protocol import Status, TrunkEstimate
from stadera.estimate.trunk import TrunkModel
from stadera.estimate.trusted import TrustedEstimator, TrustLimits
from stadera.estimate.walking import WalkingEstimator
from stadera.estimate.walking_noise import WalkingNoise
from stadera.estimate.walking_result import LoadChange, centre_slope
from stadera.robot.model import Robot
from stadera.supervise.strength import hardest_effort
from stadera.supervise.walker import State, Transition, Walker
from stadera.weigh.payload import PayloadEstimate


class NonstopSupervisor:
    """Fed with every measurement, tells a walker what to believe.

    The first trunk that is known well enough is the tare. It goes on being learnt with the trunk until a load comes on.

    Args:
        robot: whose legs are believed in.
        walker: told what to believe; it is taken to walk.
        believed: the trunk that controller and planner reckon with at first; None for the robot's own.
        noise: of the sensors; None for `WalkingNoise.of(robot)`.
        limits: how well a trunk must be known to be walked by; None for `TrustLimits.of(robot)`.

    Attributes:
        state: WALKING; WEIGHING; STANDING, once and for all, when the walker cannot walk on or the load is too heavy.
        believed: the trunk that controller and planner reckon with.
        estimator: what weighs.
    """

    def __init__(
        self,
        robot: Robot,
        walker: Walker,
        believed: TrunkModel | None = None,
        noise: WalkingNoise | None = None,
        limits: TrustLimits | None = None,
    ) -> None:
        self.robot, self.walker, self.state = robot, walker, State.WALKING
        self.believed = believed or TrunkModel.prior(robot)
        self.estimator = WalkingEstimator(robot, noise, self.believed)
        self._trusted = TrustedEstimator(self.estimator, robot, self.believed, limits)
        self._transitions: list[Transition] = []
        self._noticed: list[float] = []
        self._seen = self._handed = self._trusted.estimate()

    @property
    def transitions(self) -> tuple[Transition, ...]:
        """Every change of state so far."""
        return tuple(self._transitions)

    @property
    def noticed(self) -> tuple[float, ...]:
        """When changes of the load were noticed [s]."""
        return tuple(self._noticed)

    @property
    def estimate(self) -> TrunkEstimate:
        """The trunk as known now, whether it can be walked by or not."""
        return self.estimator.estimate()

    @property
    def payload(self) -> PayloadEstimate | None:
        """What was put on since the tare; None before."""
        found = self.estimator.payload()
        if found is None:
            return None
        slope = centre_slope(found.parameters.vector[:4])[1:]
        covariance = slope @ found.covariance[:4, :4] @ slope.T
        covariance[np.isnan(found.com_std), :] = covariance[:, np.isnan(found.com_std)] = np.nan
        return PayloadEstimate(found.mass, found.mass_std, found.com, covariance)

    def update(self, m: Measurement) -> None:
        """Takes one measurement in and does what follows from it. Times must increase."""
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
                self._become(time, State.WEIGHING, _told(changes[-1]))

    def _hand_on(self, time: float) -> None:
        """The trunk to the walker, if it can be walked by and is a new one."""
        found = self._trusted.estimate()
        if found is self._handed or found.status not in (Status.MOVING, Status.CONVERGED):
            return
        if self._handed.status is Status.WAITING:
            self.estimator.tare()
        self._handed = found
        if not self.walker.believe(found.trunk):
            return
        self.believed = found.trunk
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

    def _become(self, time: float, state: State, reason: str) -> None:
        self._transitions.append(Transition(time, self.state, state, reason))
        self.state = state


def _told(change: LoadChange) -> str:
    if change.kind == "shifted":
        return "the load has shifted"
    what = "put on" if change.kind == "on" else "taken off"
    ago = change.noticed - change.time
    return f"{abs(change.mass):.1f} ± {change.mass_std:.1f} kg were {what}, {ago:.2f} s ago by the rows since"
