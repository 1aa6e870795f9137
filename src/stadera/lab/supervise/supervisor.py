"""Supervisor that stops the robot to weigh a changed load: the state machine of the paper's section V.C.

    WALKING -> STOPPING -> WEIGHING_MASS -> WEIGHING_COM -> CONVERGED -> WALKING

Controller and planner receive the new trunk once, after mass and centre of mass have both converged; until then both
keep the old one. If the weighing fails, the robot stays in STANDING or SITTING, with the reason. The supervisor has no
side effects other than commanding the walker, and stores events as values.
"""

from __future__ import annotations

from math import cos

import numpy as np

from stadera.constants import ROUNDING, SATURATED
from stadera.errors import StaderaError
from stadera.lab.supervise.corrected import CorrectedForces, PayloadScale
from stadera.lab.supervise.load_test import LoadCheck, LoadTest
from stadera.lab.supervise.offsets import SwingOffsets
from stadera.lab.supervise.rest import RestWatch
from stadera.lab.supervise.settings import SuperviseSettings
from stadera.lab.supervise.strength import hardest_effort
from stadera.lab.supervise.walker import State, Supervised, Walker
from stadera.lab.supervise.weighing import Stage, StandingWeighing, require_poses
from stadera.robot.model import Robot
from stadera.trunk.load import Payload
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import TrunkEstimate
from stadera.trunk.standing.forces import ContactForceEstimator


class Supervisor(Supervised):
    """Processes every measurement, and commands a walker, which is walking, to stop, to use a new trunk, and to
    continue. StaderaError if it cannot be weighed by the chosen method.
    """

    def __init__(
        self,
        robot: Robot,
        walker: Walker,
        trunk: TrunkModel | None = None,
        forces: ContactForceEstimator | None = None,
        settings: SuperviseSettings | None = None,
    ) -> None:
        super().__init__(robot, walker, trunk)
        self.settings = settings or SuperviseSettings()
        if self.settings.method != "contact":
            require_poses(walker, self.settings.method)
        self.forces = forces or ContactForceEstimator(robot)
        self.load_test = LoadTest(robot.mass, self.trunk.mass, self.forces.noise, self.settings.load_test)
        self._rest = RestWatch(self.forces, self.settings.rest)
        self._scale = PayloadScale(self.forces, self.trunk)
        self._swings = SwingOffsets(self.forces.legs, self.forces.noise, self.settings.offsets)
        self._weighing: StandingWeighing | None = None
        self._estimate: TrunkEstimate | None = None
        self._payload: Payload | None = None
        self._checks: list[LoadCheck] = []
        self._time, self._since, self._restarts = -np.inf, 0.0, 0
        self._saturated = 0.0
        self._loaded = self._is_down = False
        effort = np.array([robot.limits[joint].effort for joint in robot.tree.joints])
        self._effort = SATURATED * effort

    # -- what happened --------------------------------------------------------------------------------------------
    @property
    def checks(self) -> tuple[LoadCheck, ...]:
        """All checks of the mass, in order."""
        return tuple(self._checks)

    @property
    def noticed(self) -> tuple[float, ...]:
        """Times of detection of changes of the load [s]."""
        return tuple(check.time for check in self._checks if check.changed)

    @property
    def estimate(self) -> TrunkEstimate | None:
        """Estimate of the present or last weighing; None before the first."""
        return self._estimate

    @property
    def weighing(self) -> bool:
        """True while a weighing is in progress."""
        return self._weighing is not None

    @property
    def corrected(self) -> CorrectedForces:
        """Contact forces corrected for the torque offsets known so far."""
        if not self.settings.correct_torques:
            return CorrectedForces.none(self.forces)
        return CorrectedForces.of(self.forces, self.load_test.offsets, self.load_test.offsets_std)

    @property
    def payload(self) -> Payload | None:
        """The payload since the beginning, from the last weighing that converged; None before."""
        return self._payload

    # -- each period ----------------------------------------------------------------------------------------------
    def update(self, measurement: Measurement) -> None:
        """Processes one measurement; uses one per period."""
        m = measurement
        elapsed = m.time - self._time
        if elapsed < self.settings.period - ROUNDING:
            return
        self._time = m.time
        if self.state is State.SITTING:
            self._set_down()
            return
        if self._in_danger(m, min(elapsed, self.settings.period)):
            return
        if self.settings.correct_torques:
            for swing in self._swings.update(m):
                self.load_test.learn_offsets(swing)
        change = self._check(m)
        match self.state:
            case State.WALKING:
                self._walk(m, change)
            case State.STOPPING:
                self._stop(m)
            case State.WEIGHING_MASS | State.WEIGHING_COM:
                self._weigh(m, change)
            case State.CONVERGED:
                self._settle(m)

    def weigh(self, reason: str) -> None:
        """Stops and weighs, for the caller's reason; StaderaError unless it is WALKING or STANDING."""
        if self.state not in (State.WALKING, State.STANDING):
            raise StaderaError(f"a weighing begins from walking or standing, and the robot is {self.state}")
        self._restarts = 0
        self.walker.request_stop()
        self._enter(State.STOPPING, reason)

    # -- states -----------------------------------------------------------------------------------------------
    def _walk(self, m: Measurement, change: LoadCheck | None) -> None:
        if fault := self.walker.fault:
            self._stand(fault)
        elif change is not None:
            self._restarts, self._loaded = 0, True
            self._scale.new_load()
            self.walker.request_stop()
            self._enter(State.STOPPING, _sentence(change))
        elif not self._loaded and self.walker.stopped:  # it has not begun to walk yet
            self._scale.take(m, loaded=False)

    def _stop(self, m: Measurement) -> None:
        if self.walker.stopped:
            self._begin_weighing("the robot stands")
        elif m.time - self._since > self.settings.stop_within:
            said = self.walker.fault or f"it is still in {self.walker.phase!r}"
            self._sit(f"the robot does not come to stand within {self.settings.stop_within:g} s: {said}")

    def _weigh(self, m: Measurement, change: LoadCheck | None) -> None:
        weighing = self._weighing
        if weighing is None or change is not None:
            self._again(change)
            return
        weighing.update(m)
        self._scale.take(m, loaded=True)
        self._estimate = weighing.estimate
        if weighing.stage is Stage.FAILED:
            self._stand(weighing.reason)
        elif weighing.stage is Stage.COM and self.state is State.WEIGHING_MASS and self._estimate is not None:
            found = self._estimate
            self._enter(
                State.WEIGHING_COM, f"the trunk with its load weighs {found.trunk.mass:.2f} ± {found.std[0]:.2f} kg"
            )
        elif weighing.stage is Stage.DONE and self._estimate is not None:
            self._converged(self._estimate)

    def _again(self, change: LoadCheck | None) -> None:
        self._restarts += 1
        why = "" if change is None else _sentence(change)
        if self._restarts > self.settings.restarts:
            self._stand(f"the load keeps changing, the weighing began anew {self.settings.restarts} times: {why}")
            return
        self._scale.new_load()
        self._begin_weighing(f"{why}, the weighing begins anew")

    def _begin_weighing(self, reason: str) -> None:
        self._weighing = StandingWeighing(self.corrected, self.trunk, self.walker, self.settings, self._time)
        self._enter(State.WEIGHING_MASS, reason)

    def _converged(self, found: TrunkEstimate) -> None:
        trunk, self._weighing = found.trunk, None
        x, y, z = trunk.com_trunk
        self._enter(State.CONVERGED, f"{trunk.mass:.2f} kg with the centre of mass at ({x:.4f}, {y:.4f}, {z:.4f}) m")
        hardest = hardest_effort(self.robot, trunk)
        if hardest.share >= 1.0:
            self._sit(
                f"the load is too heavy to walk with: on three legs joint {hardest.joint!r} would need "
                f"{hardest.torque:.0f} N·m and has {hardest.limit:.0f} N·m"
            )
        elif not self.walker.update_trunk(trunk):
            self._stand("controller and planner refused the new trunk, both keep the last one")
        else:
            self.trunk = trunk
            self._payload = self._scale.payload(found, self.corrected)

    def _settle(self, m: Measurement) -> None:
        """Waits while the trunk settles with its new model, without checks."""
        self._rest.restart()
        if m.time - self._since >= self.settings.settling:
            self.walker.resume()
            self._enter(State.WALKING, "controller and planner have taken the new trunk")

    # -- in every state -------------------------------------------------------------------------------------------
    def _check(self, m: Measurement) -> LoadCheck | None:
        """Returns the check at this instant if it detects a change of the load."""
        if self.state is State.CONVERGED:
            return None
        moment = self._rest.update(m)
        check = None if moment is None else self.load_test.check(moment)
        if check is None:
            return None
        before = self._checks[-1].time if self._checks else -np.inf
        self._checks.append(check)
        if not check.changed:
            # a change late in this moment would not show yet; one before the last check would have shown
            self._scale.confirm(before)
            return None
        self.load_test.forget_mass()
        return check

    def _in_danger(self, m: Measurement, elapsed: float) -> bool:
        if m.up[2] < cos(self.settings.tilt):
            angle = np.rad2deg(np.arccos(m.up[2]))
            self._sit(f"the trunk is tilted by {angle:.0f}°, more than {np.rad2deg(self.settings.tilt):.0f}°")
            return True
        loads = np.abs(m.effort) / self._effort
        # time at the limit accumulates, and decays otherwise
        step = elapsed if loads.max() >= 1.0 else -elapsed
        self._saturated = max(self._saturated + step, 0.0)
        if self._saturated > self.settings.saturation:
            joint = int(loads.argmax())
            self._sit(
                f"too heavy: joint {self.robot.tree.joints[joint]!r} has been at its torque limit "
                f"({abs(m.effort[joint]):.0f} N·m) for {self.settings.saturation:g} s"
            )
            return True
        return False

    def _stand(self, reason: str) -> None:
        self._weighing = None
        self.walker.request_stop()
        self._enter(State.STANDING, reason)

    def _sit(self, reason: str) -> None:
        self._weighing = None
        self.walker.request_stop()
        self._enter(State.SITTING, reason)
        self._set_down()

    def _set_down(self) -> None:
        """Sets the robot down as soon as it stands on four feet."""
        if not self._is_down and self.walker.stopped:
            self.walker.sit()
            self._is_down = True

    def _enter(self, state: State, reason: str) -> None:
        self._become(self._time, state, reason)
        self._since = self._time


def _sentence(check: LoadCheck) -> str:
    what = "added" if check.change > 0 else "removed"
    return (
        f"{abs(check.change):.2f} kg were {what}: {check.mass:.2f} kg where {check.expected:.2f} ± {check.std:.2f} kg "
        f"were expected, more than {check.threshold:.2f} kg off"
    )
