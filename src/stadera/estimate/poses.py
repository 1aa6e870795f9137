"""Approach (a): batch least squares over static poses of the trunk (the paper's section III.A, eq. 8-11).

Every pose gives the six equations of `stadera.estimate.equilibrium`, linear in the trunk's mass and first moment. They
see the centre of mass normal to the vertical alone; poses that tilt the trunk about two axes see all of it. What may be
wrong all the time (torque offsets, feet, the vertical) is not sought here, but reckoned with: with the triangle of the
rows' QR over trunk θ and errors n,

    [R_θ  S] [θ]   [z]
    [0   R_n] [n] = [·],      θ̂ = R_θ⁻¹ z  at n = 0,      cov θ̂ = R_θ⁻¹ (1 + S C Sᵀ) R_θ⁻ᵀ,   C = cov n

Least squares weighs its rows by their white noise. A weak prior, the plausible box, stands for what no pose shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.contact import ContactForces
from stadera.estimate.equilibrium import ERRORS, TRUNK, ConstantErrors, equilibrium_rows, error_names
from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.measurement import Measurement
from stadera.estimate.pose_means import Alike, PoseMean
from stadera.estimate.protocol import TrunkEstimate, unobserved
from stadera.estimate.static import StaticEstimator
from stadera.estimate.stillness import StillnessLimits
from stadera.estimate.trunk import TrunkBounds, TrunkModel
from stadera.identify.information import Information
from stadera.regressors.rows import Rows
from stadera.robot.model import Robot

Array = NDArray[np.float64]

SETTLED = StillnessLimits(joint_velocity=0.02, quiet=0.5)
"""Still for so long that what is left of a trunk's sway does not matter."""

_OBSERVED = 0.2  # share of the plausible range's standard deviation under which a component counts as observed


@dataclass(frozen=True, eq=False)
class TrunkSolution:
    """Mass and centre of mass from information on the trunk, and how sure.

    Attributes:
        mass: [kg]. com: (3,) [m].
        covariance: (4, 4).
        errors: (39,), the constant errors as estimated, zero where they are only reckoned with.
    """

    mass: float
    com: Array
    covariance: Array
    errors: Array


class PosesCom(StaticEstimator):
    """All three components by least squares over the poses that the robot has held; flat in memory.

    Args:
        robot: whose legs are believed in.
        start: what components that no pose shows keep; None for the robot's own trunk.
        forces: source of contact forces; None for one of its own.
        limits: of standing still; None for `SETTLED`.
        errors: what may be wrong all the time; None for the forces' own noise and 0.2° of the vertical.
        alike: which samples make one pose.

    Raises:
        ImplausibleError: an implausible start.
    """

    _WITHOUT_IMU = True
    _KEPT = 0  # closed poses that are made linear anew every time

    def __init__(
        self,
        robot: Robot,
        start: TrunkModel | None = None,
        forces: ContactForceEstimator | None = None,
        limits: StillnessLimits | None = None,
        *,
        errors: ConstantErrors | None = None,
        alike: Alike | None = None,
    ) -> None:
        super().__init__(robot, start, forces, limits or SETTLED)
        self.errors = errors or self._usual_errors()
        self.alike = alike or Alike()
        self._names = error_names(robot)
        self._folded = Information.empty((*TRUNK, *self._names))
        self._prior = plausible(self._start, self.bounds)
        self._range = _spread(self.bounds)
        self._open: PoseMean | None = None
        self._closed: list[PoseMean] = []
        self._linear_at = self._anchor = np.zeros(ERRORS)
        self._known = unobserved()
        self._solved, self._latest, self._count = -np.inf, np.nan, 0

    @property
    def poses(self) -> int:
        """How many poses were held."""
        return self._count

    def estimate(self) -> TrunkEstimate:
        """What it believes now, worked out from all poses when asked."""
        refusal = "" if self._ran_away else self._reason
        self._solve()
        if refusal:
            self._refuse(refusal)
        return super().estimate()

    def _usual_errors(self) -> ConstantErrors:
        return ConstantErrors.of(self.forces.noise)

    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        self._latest = measurement.time
        if self._open is None or not self._open.takes(measurement, self.alike):
            self._close()
            self._open, self._count = PoseMean(measurement), self._count + 1

    def _close(self) -> None:
        if self._open is not None:
            self._closed.append(self._open)
            self._open = None
        while len(self._closed) > self._KEPT:
            self._folded = self._folded.add(self._rows(self._closed.pop(0)))

    def _rows(self, pose: PoseMean) -> Rows:
        return equilibrium_rows(
            self.forces,
            pose.measurement,
            pose.count,
            self._linear_at,
            self._names,
            pose.foot_variance,
            pose.effort_covariance,
        )

    def _gathered(self) -> Information:
        poses = [*self._closed, self._open] if self._open is not None else self._closed
        return self._folded.add([self._rows(pose) for pose in poses]) if poses else self._folded

    def _solution(self) -> TrunkSolution:
        return considered(self._gathered().merge(self._prior), self.errors)

    def _solve(self) -> None:
        if np.isnan(self._latest) or self._latest == self._solved:
            return
        solution, self._solved = self._solution(), self._latest
        variances = np.diag(solution.covariance)
        hidden = np.flatnonzero(~(np.sqrt(variances) < _OBSERVED * self._range))
        start = np.array([self._start.mass, *self._start.com_trunk])
        value = conditioned(np.array([solution.mass, *solution.com]), solution.covariance, hidden, start)
        if self._adopt(self._latest, float(value[0]), value[1:], not len(hidden)):
            self._known = np.array(solution.covariance)
            self._known[hidden, :] = self._known[:, hidden] = np.nan

    def _covariance(self) -> Array:
        return self._known


def plausible(start: TrunkModel, bounds: TrunkBounds) -> Information:
    """The weak prior: mass and centre of mass about the start, as wide as uniform ones in the plausible box."""
    spread = _spread(bounds)
    com, mass = start.com_trunk, start.mass
    # d(m c) = m dc + c dm, in terms of dc: rows (h - c m) / m = 0
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 1.0 / spread[0]
    matrix[1:, 0] = -com / (mass * spread[1:])
    matrix[1:, 1:] = np.diag(1.0 / (mass * spread[1:]))
    return Information.of([Rows(TRUNK, matrix, np.array([mass / spread[0], 0.0, 0.0, 0.0]))], TRUNK)


def considered(information: Information, errors: ConstantErrors) -> TrunkSolution:
    """The solution for the trunk with the constant errors taken as zero, their covariance reckoned with."""
    triangle, z = information.R[:4, :4], information.z[:4]
    root = np.linalg.inv(triangle)
    sensitive = root @ information.R[:4, 4:]
    theta = root @ z
    return _solution(theta, root @ root.T + sensitive @ errors.covariance @ sensitive.T, np.zeros(ERRORS))


def sought(information: Information, errors: ConstantErrors) -> TrunkSolution:
    """The solution for trunk and constant errors together, these with their prior."""
    names = information.columns[4:]
    full = information.add(Rows(names, errors.rows_root, np.zeros(ERRORS)))
    root = np.linalg.inv(full.R)
    theta = root @ full.z
    return _solution(theta[:4], (root @ root.T)[:4, :4], theta[4:])


def conditioned(value: Array, covariance: Array, fixed: NDArray[np.intp], at: Array) -> Array:
    """What the other components are when some are known to be `at`."""
    if not len(fixed):
        return value
    gain = covariance[:, fixed] @ np.linalg.inv(covariance[np.ix_(fixed, fixed)])
    result = value + gain @ (at[fixed] - value[fixed])
    result[fixed] = at[fixed]
    return np.asarray(result)


def _solution(theta: Array, covariance: Array, errors: Array) -> TrunkSolution:
    mass, com = float(theta[0]), theta[1:] / theta[0]
    slope = np.zeros((4, 4))
    slope[0, 0] = 1.0
    slope[1:, 0], slope[1:, 1:] = -com / mass, np.eye(3) / mass
    return TrunkSolution(mass, com, slope @ covariance @ slope.T, errors)


def _spread(bounds: TrunkBounds) -> Array:
    """Standard deviations (4,) of mass [kg] and centre of mass [m] spread evenly over what is plausible."""
    ranges = np.array([bounds.mass[1] - bounds.mass[0], *(np.asarray(bounds.high) - np.asarray(bounds.low))])
    return np.asarray(ranges / np.sqrt(12.0))
