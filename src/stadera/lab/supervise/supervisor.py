"""Supervisors that detect a change of a walking robot's load and have the trunk weighed again.

The walking estimator (`TrunkEstimator`) runs all the time and detects the change. From there the two differ:

    NonstopSupervisor:    WALKING -> WEIGHING -> WALKING
    StoppingSupervisor:   WALKING -> STOPPING -> WEIGHING_MASS -> WEIGHING_COM -> CONVERGED -> WALKING

The first waits, while the robot walks on, until the estimate is accurate enough. The second is the state machine of
the paper's section V.C: the robot stops, and is weighed at rest. Until then controller and planner keep the last
trunk. STANDING is final: the robot cannot continue, for the reason given. Supervisors have no side effects other
than commanding the walker, and store events as values.

An estimate is used only when it is accurate enough: for a controller an outdated one is safer than one that has not
converged. After a change of the load the error bars are wide, and until they are narrow again nothing is passed on.

The robot is strong enough to walk with a load if it can stand on any three legs (`hardest_effort`). A statically
stable crawl lifts each leg in turn while the centre of mass is over the triangle of the others. In the nominal
stance on level ground, with the centre of mass over the triangle's incentre c, where its three margins are equal,
vertical forces f_i hold it:

    Σ f_i = m_r g,   Σ f_i p_i = m_r g c  (seen from above)   =>   f_i = m_r g λ_i,   λ: barycentric coordinates of c

and need the torques τ_i = h_i - J_iᵀ f_i u. λ_i is the length of the edge opposite to foot i over the circumference.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stadera.constants import GRAVITY, ROUNDING
from stadera.errors import StaderaError
from stadera.lab.control.crawl import Crawl
from stadera.lab.control.legs import LegDynamics
from stadera.lab.laws.equilibrium import NoisyForces
from stadera.lab.supervise.weighing import Stage, StandingWeighing, WeighingSettings
from stadera.report.numbers import number, with_std
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.load import LoadChange, Payload
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkBounds, TrunkModel
from stadera.trunk.protocol import TrunkEstimate


@dataclass(frozen=True)
class Effort:
    """The most heavily loaded joint when the robot stands on three legs."""

    joint: str
    torque: float  # [N·m], positive
    limit: float  # [N·m], positive

    @property
    def share(self) -> float:
        """Torque as a share of the limit; zero for a joint without one."""
        return self.torque / self.limit if np.isfinite(self.limit) else 0.0


def hardest_effort(robot: Robot, trunk: TrunkModel) -> Effort:
    """The joint closest to its torque limit when the robot stands on any three legs with this trunk."""
    legs, q = LegDynamics(robot), standing_configuration(robot)
    up, zero = np.array([0.0, 0.0, 1.0]), np.zeros(len(q))
    state = legs.measured(Measurement(0.0, q, zero, zero, np.zeros(3), GRAVITY * up, np.eye(3)))
    contact = state.feet - np.array([[leg.foot_radius] for leg in robot.legs]) * up
    lifting = state.jacobians(contact)[:, 2, :]  # decrease in torques per unit of vertical force
    efforts = []
    for swing in range(len(robot.legs)):
        standing = [k for k in range(len(robot.legs)) if k != swing]
        triangle = contact[standing, :2]
        opposite = np.linalg.norm(np.roll(triangle, -1, axis=0) - np.roll(triangle, 1, axis=0), axis=1)
        forces = (trunk.mass + legs.leg_mass) * GRAVITY * opposite / opposite.sum()
        for k, force in zip(standing, forces, strict=True):
            torques = np.abs(state.bias[k] - force * lifting[k]).tolist()
            efforts += [
                Effort(joint, torque, robot.limits[joint].effort)
                for joint, torque in zip(robot.legs[k].joints, torques, strict=True)
            ]
    return max(efforts, key=lambda effort: effort.share)


class Mode(StrEnum):
    """Mode of the supervised robot."""

    WALKING = "walking"
    STOPPING = "stopping"
    WEIGHING_MASS = "weighing mass"
    WEIGHING_COM = "weighing centre of mass"
    CONVERGED = "converged"
    WEIGHING = "weighing on the way"
    STANDING = "standing"


@dataclass(frozen=True)
class Transition:
    """One change of state."""

    time: float  # [s]
    before: Mode
    after: Mode
    reason: str  # one sentence


class Supervisor:
    """What both supervisors share: the walking estimator, and the trunk that controller and planner use.

    Attributes:
        trunk: as used by controller and planner. estimator: runs in parallel with the robot.
        noticed: times of detection of changes of the load [s]. transitions: all changes of state, in order.
    """

    def __init__(self, robot: Robot, walker: Crawl) -> None:
        self.robot, self.walker, self.state = robot, walker, Mode.WALKING
        self.trunk = TrunkModel.prior(robot)
        self.estimator = TrunkEstimator(robot)
        self.noticed: tuple[float, ...] = ()
        self.transitions: tuple[Transition, ...] = ()
        self._time, self._since = 0.0, 0.0

    def _new_change(self) -> LoadChange | None:
        changes = self.estimator.changes
        if not changes or (self.noticed and changes[-1].noticed <= self.noticed[-1]):
            return None
        self.noticed = (*self.noticed, changes[-1].noticed)
        return changes[-1]

    def _too_heavy(self, trunk: TrunkModel) -> str:
        """Why the robot is too weak to walk with this trunk; empty if it is not."""
        hardest = hardest_effort(self.robot, trunk)
        if hardest.share < 1.0:
            return ""
        return (
            f"the load is too heavy to walk with: on three legs joint {hardest.joint!r} would need "
            f"{hardest.torque:.0f} N·m and has {hardest.limit:.0f} N·m"
        )

    def _stand(self, reason: str) -> None:
        if self.state is not Mode.STANDING:
            self.walker.request_stop()
            self._enter(Mode.STANDING, reason)

    def _enter(self, state: Mode, reason: str) -> None:
        self.transitions = (*self.transitions, Transition(self._time, self.state, state, reason))
        self.state, self._since = state, self._time


class NonstopSupervisor(Supervisor):
    """Weighs a load without stopping the robot: passes every new, sufficiently accurate estimate to the walker.

    The first such estimate is the tare, which is refined with the trunk until a load is added. The limits are above the
    common error of all torques, which cancels for a controller that commands these same torques, and above the effect
    of static friction in a standing robot.
    """

    mass_share = 0.12  # largest standard deviation of the mass, as a share of the robot's
    com_share = 0.05  # likewise of the horizontal centre of mass, as a share of the standing height

    def __init__(self, robot: Robot, walker: Crawl) -> None:
        super().__init__(robot, walker)
        self._bounds, self._tared = TrunkBounds.of(robot), False
        self._seen = self.estimator.estimate()

    @property
    def payload(self) -> Payload | None:
        return self.estimator.payload

    @property
    def estimate(self) -> TrunkEstimate:
        return self.estimator.estimate()

    def update(self, m: Measurement) -> None:
        """Processes one measurement. Times must increase."""
        self._time = m.time
        self.estimator.update(m)
        if self.state is Mode.STANDING:
            return
        change = self._new_change()
        if change is not None and self.state is Mode.WALKING:
            self._enter(Mode.WEIGHING, _sentence(change))
        found, seen = self.estimator.estimate(), self._seen
        self._seen = found
        if found is not seen and self.is_accurate(found):
            self._hand_on(found)
        if fault := self.walker.fault:
            self._stand(fault)

    def is_accurate(self, estimate: TrunkEstimate) -> bool:
        """True if an estimate is plausible and its error bars are within the limits."""
        mass, x, y, _ = estimate.std
        height = float(self._bounds.high[2] - self._bounds.low[2])
        narrow = mass <= self.mass_share * self.robot.mass and max(x, y) <= self.com_share * height
        return bool(narrow) and not estimate.reason and self._bounds.complaint(estimate.trunk) is None

    def _hand_on(self, found: TrunkEstimate) -> None:
        """Passes the trunk to the walker."""
        if not self._tared:
            self.estimator.tare()
            self._tared = True
        if not self.walker.update_trunk(found.trunk):
            return
        self.trunk = found.trunk
        if self.state is not Mode.WEIGHING:
            return
        if heavy := self._too_heavy(found.trunk):
            self._stand(heavy)
            return
        mass, x, y, _ = found.std
        known = f"{with_std(found.trunk.mass, mass)} kg, its centre of mass to {number(1e3 * max(x, y), 2)} mm"
        self._enter(Mode.WALKING, f"controller and planner have taken the new trunk: {known}")


@dataclass(frozen=True)
class StopSettings:
    """Settings of the supervisor that stops, and limits for giving up."""

    period: float = 0.004  # interval between measurements used for weighing [s]
    stop_within: float = 5.0  # time after which a robot that has not stopped is given up [s]
    restarts: int = 3  # number of times a weighing may restart because the load changes
    settling: float = 0.5  # time for controller and trunk to settle with a new model of the trunk [s]


class StoppingSupervisor(Supervisor):
    """Stops the robot to weigh a changed load at rest, and passes the new trunk on once mass and centre of mass have
    both converged. `forces` estimates the contact forces at rest, `estimate` is that of the present or last weighing,
    and `payload` since the beginning that of the last one that converged; None before the first.
    """

    settings = StopSettings()

    def __init__(self, robot: Robot, walker: Crawl, weighing: WeighingSettings | None = None) -> None:
        super().__init__(robot, walker)
        self.forces, self._how = NoisyForces(robot), weighing or WeighingSettings()
        self._tare, self._restarts = self.trunk, 0
        self._weighing: StandingWeighing | None = None
        self.estimate: TrunkEstimate | None = None
        self.payload: Payload | None = None

    def update(self, m: Measurement) -> None:
        """Processes one measurement. Times must increase."""
        self.estimator.update(m)
        change = self._new_change()
        if change is None and m.time - self._time < self.settings.period - ROUNDING:
            return
        self._time = m.time
        match self.state:
            case Mode.WALKING if self.walker.fault:
                self._stand(self.walker.fault)
            case Mode.WALKING if change is not None:
                self.weigh(_sentence(change))
            case Mode.STOPPING:
                self._stop()
            case Mode.WEIGHING_MASS | Mode.WEIGHING_COM:
                self._weigh(m, change)
            case Mode.CONVERGED if m.time - self._since >= self.settings.settling:
                self.walker.resume()
                self._enter(Mode.WALKING, "controller and planner have taken the new trunk")

    def weigh(self, reason: str) -> None:
        """Stops and weighs, for the caller's reason; StaderaError unless it is WALKING or STANDING."""
        if self.state not in (Mode.WALKING, Mode.STANDING):
            raise StaderaError(f"a weighing begins from walking or standing, and the robot is {self.state}")
        self._restarts = 0
        self.walker.request_stop()
        self._enter(Mode.STOPPING, reason)

    def _stop(self) -> None:
        if self.walker.stopped:
            self._begin_weighing("the robot stands")
        elif self._time - self._since > self.settings.stop_within:
            self._stand(f"the robot does not come to stand within {self.settings.stop_within:g} s {self.walker.fault}")

    def _begin_weighing(self, reason: str) -> None:
        drives = self.estimator.drives  # as the walk has shown them so far
        self._weighing = StandingWeighing(self.forces, self.trunk, self._time, self._how, drives=drives)
        self._enter(Mode.WEIGHING_MASS, reason)

    def _weigh(self, m: Measurement, change: LoadChange | None) -> None:
        weighing = self._weighing
        if change is not None or weighing is None:
            self._again("" if change is None else _sentence(change))
            return
        weighing.update(m)
        found = self.estimate = weighing.estimate
        if weighing.stage is Stage.FAILED:
            self._give_up(weighing.reason)
        elif found is not None and weighing.stage is Stage.COM and self.state is Mode.WEIGHING_MASS:
            said = f"the trunk with its load weighs {found.trunk.mass:.2f} ± {found.std[0]:.2f} kg"
            self._enter(Mode.WEIGHING_COM, said)
        elif found is not None and weighing.stage is Stage.DONE:
            self._converged(found)

    def _again(self, why: str) -> None:
        self._restarts += 1
        if self._restarts > self.settings.restarts:
            self._give_up(f"the load keeps changing, the weighing began anew {self.settings.restarts} times: {why}")
        else:
            self._begin_weighing(f"{why}, the weighing begins anew")

    def _converged(self, found: TrunkEstimate) -> None:
        trunk, self._weighing = found.trunk, None
        x, y, z = trunk.com_trunk
        self._enter(Mode.CONVERGED, f"{trunk.mass:.2f} kg with the centre of mass at ({x:.4f}, {y:.4f}, {z:.4f}) m")
        if heavy := self._too_heavy(trunk):
            self._stand(heavy)
        elif not self.walker.update_trunk(trunk):
            self._stand("controller and planner refused the new trunk, both keep the last one")
        else:
            self.trunk, self.payload = trunk, _payload_of_difference(self._tare, found)

    def _give_up(self, reason: str) -> None:
        self._weighing = None
        self._stand(reason)


def _sentence(change: LoadChange) -> str:
    ago = change.noticed - change.time
    grew = "+" if change.mass > 0.0 else ""
    return f"{ago:.2f} s ago the load changed by {grew}{with_std(change.mass, change.mass_std)} kg"


def _payload_of_difference(tare: TrunkModel, loaded: TrunkEstimate) -> Payload:
    """Payload as the difference from a tare that is taken as exact, in mass and first moment; components of the centre
    of mass that were not observed in `loaded` are not observed in the payload.
    """
    m, c = loaded.trunk.mass, loaded.trunk.com_trunk
    moments = np.array([m - tare.mass, *(m * c - tare.mass * tare.com_trunk)])
    hidden = ~loaded.observed
    known = np.where(hidden[:, None] | hidden, 0.0, loaded.covariance)
    slope = np.eye(4)  # derivative of mass and first moment with respect to mass and centre of mass
    slope[1:, 0], slope[1:, 1:] = c, m * np.eye(3)
    return Payload.of_moments(moments, slope @ known @ slope.T, np.where(hidden[1:], 0.0, np.inf))
