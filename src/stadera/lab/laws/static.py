"""Base of the laws for a robot at rest: which measurements they learn from, the errors they state, what they say."""

from __future__ import annotations

from abc import abstractmethod
from math import isnan

import numpy as np

from stadera.lab.laws.equilibrium import ConstantErrors, constant_errors_of
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import ImplausibleError, TrunkBounds, TrunkModel
from stadera.trunk.protocol import Status, StepEstimator, TrunkEstimate
from stadera.trunk.standing.detection import StaticDetector, StaticLimits, not_finite, stretched
from stadera.trunk.standing.forces import ContactForceEstimator, ContactForces, ForceNoise
from stadera.types import Array


def stated_errors(
    robot: Robot, noise: ForceNoise, orientation: float = np.deg2rad(0.2), common_torque: float = 0.0
) -> ConstantErrors:
    """Independent constant errors of stated sizes, except for a part of the torques that is common to all joints.

    Args:
        noise: of torques, feet and links' masses.
        orientation: of each component of ε [rad].
        common_torque: standard deviation of an offset common to all joints [N·m].
    """
    places = constant_errors_of(robot)
    std, torque = np.empty(len(places)), places["torque"]
    std[torque], std[places["foot"]] = noise.torque_constant, noise.foot_position
    std[places["vertical"]], std[places["link_mass"]] = orientation, noise.leg_mass
    C = np.diag(np.maximum(std, 1e-9) ** 2)
    C[torque, torque] += common_torque**2
    return ConstantErrors(places, C)


def white_covariance(forces: ContactForces) -> Array:
    """Covariance (6, 6) of the feet's wrench due to the torques' white noise."""
    scaled = forces.wrench_slope[:, : len(forces.left)] * forces.noise.torque_white
    return np.asarray(scaled @ scaled.T)


class StaticEstimator(StepEstimator):
    """Base of estimators at rest: selects measurements, keeps the last good estimate, and tells why others are refused.

    Args:
        robot: the model of the legs.
        start: initial estimate; None for the robot's own trunk.
        forces: estimator of contact forces; None for a new one.
        limits: for a robot at rest; None for the estimator's own.

    Raises:
        ImplausibleError: the start lies outside `TrunkBounds.of(robot)`.
    """

    _WITHOUT_IMU = False  # whether its covariance includes a vertical computed from the forces

    def __init__(
        self,
        robot: Robot,
        start: TrunkModel | None = None,
        forces: ContactForceEstimator | None = None,
        limits: StaticLimits | None = None,
    ) -> None:
        self.robot, self.forces = robot, forces or ContactForceEstimator(robot)
        self.bounds = TrunkBounds.of(robot)
        self.gate = StaticDetector(robot, limits)
        self._trunk = self._start = self.bounds.check(start or TrunkModel.prior(robot))
        self._status, self._reason = Status.WAITING, ""
        self._learnt, self._seen, self._ran_away = np.nan, -np.inf, False

    def update(self, measurement: Measurement) -> None:
        """Uses a measurement at rest; refuses any other and keeps its estimate."""
        if reason := self._complaint(measurement):
            self._refuse(reason)
            return
        forces = self.forces.at(measurement)
        reason = stretched(forces, self.robot, measurement.stance) or self.gate.complaint(measurement, forces)
        if reason:
            self._refuse(reason)
            self._interrupted()
            return
        if self._status is Status.REFUSED and not self._ran_away:
            self._status, self._reason = Status.WAITING if isnan(self._learnt) else Status.MOVING, ""
        self._learn(measurement, forces)

    def estimate(self) -> TrunkEstimate:
        """The present estimate; after a refusal the last good one, with the reason."""
        return TrunkEstimate(self._learnt, self._trunk, self._covariance(), self._status, self._reason)

    @abstractmethod
    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        """Processes a measurement at rest."""

    @abstractmethod
    def _covariance(self) -> Array:
        """Covariance (4, 4) of mass and centre of mass."""

    def _interrupted(self) -> None:
        """Called after an interruption of rest."""

    def _refuse(self, reason: str) -> None:
        self._status, self._reason = Status.REFUSED, reason

    def _adopt(self, time: float, mass: float, com: Array, converged: bool) -> bool:
        """Makes mass [kg] and centre of mass (3,) [m] the estimate, unless they are implausible."""
        self._ran_away = True
        try:
            trunk = TrunkModel(mass, com, self._start.inertia_com)
        except ImplausibleError as error:
            self._refuse(f"the estimate runs away: {error}")
            return False
        if complaint := self.bounds.complaint(trunk):
            self._refuse(f"the estimate runs away: {complaint}")
            return False
        self._trunk, self._learnt, self._ran_away = trunk, time, False
        self._status, self._reason = Status.CONVERGED if converged else Status.MOVING, ""
        return True

    def _complaint(self, m: Measurement) -> str:
        if m.vertical_by_forces and not self._WITHOUT_IMU:
            return f"{type(self).__name__} needs an IMU: it takes the vertical for independent of the feet's forces"
        if reason := not_finite(m, self.robot.tree.joints):
            return reason
        if not m.time > self._seen:
            return f"time must increase, got {m.time:.6f} s after {self._seen:.6f} s"
        self._seen = m.time
        return ""
