"""Least squares over static poses: approach (a) of the paper (section III.A, eq. 8-11), and with errors as unknowns.

The equations at rest see the centre of mass normal to the vertical alone; poses that tilt the trunk about two axes show
all of it. The constant errors of torques, feet and vertical are considered, or with `COMBINED` estimated as well: they
stay over a run while the poses change, and two unknown torques cannot look like a shifted load at every tilt,
height and place of the trunk. Then

    Σ_poses ‖whitened equations(θ, n)‖² + nᵀ C⁻¹ n + the weak prior

is minimised over trunk θ and errors n by Gauss-Newton: the equations are linear in all but the feet, and nearly so in
these. Legs that are held in the air add three equations each. See `standing.fit`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stadera.errors import require_positive
from stadera.information import Information
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkBounds, TrunkModel
from stadera.trunk.protocol import TrunkEstimate, unobserved
from stadera.trunk.standing.contact import ContactForces
from stadera.trunk.standing.detection import StaticLimits
from stadera.trunk.standing.equilibrium import ERRORS, ConstantErrors
from stadera.trunk.standing.fit import TRUNK_ALONE, centre_of, with_box, with_errors, with_mass, with_poses
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.trunk.standing.noise import ForceNoise
from stadera.trunk.standing.pose_means import Alike, PoseMean
from stadera.trunk.standing.static import StaticEstimator
from stadera.types import Array

SETTLED = StaticLimits(joint_velocity=0.02, quiet=0.5)
"""Still for so long that what is left of a trunk's sway does not matter."""


@dataclass(frozen=True)
class PosesSettings:
    """How poses become an estimate.

    Attributes:
        seek_errors: constant errors are unknowns; else they are considered.
        kept: closed poses that are linearised anew at every solution; older ones are summed up for good.
        iterations: of Gauss-Newton at most, where errors are sought.
        settled: change of the centre of mass that ends them [m].
        observed: share of the plausible range's standard deviation below which a component counts as observed.
        torque_constant, foot_position: sizes of torque offsets, as a share of the effort limits, and of errors of the
            feet's positions [m] (1 σ); None for those of the forces' noise. The vertical is off by 0.2°.
        still: limits of standing still.
        alike: which samples make one pose.

    Raises:
        StaderaError: a value that is not positive.
    """

    seek_errors: bool = False
    kept: int = 0
    iterations: int = 6
    settled: float = 1e-6
    observed: float = 0.2
    torque_constant: float | None = None
    foot_position: float | None = None
    still: StaticLimits = SETTLED
    alike: Alike = field(default_factory=Alike)

    def __post_init__(self) -> None:
        require_positive("pose setting", self, ("iterations", "settled", "observed"))

    def errors(self, forces: ContactForceEstimator) -> ConstantErrors:
        """Sizes of the constant errors of a source of contact forces."""
        if self.torque_constant is None or self.foot_position is None:
            return ConstantErrors.of(forces.noise)
        noise = ForceNoise.of(forces.robot, constant=self.torque_constant, foot_position=self.foot_position)
        return ConstantErrors.of(noise)


WIDE_TORQUE, WIDE_FOOT = 0.15, 0.03
"""Sizes of errors that the combined method allows for: share of the effort limits, and [m] (1 σ)."""

COMBINED = PosesSettings(seek_errors=True, kept=64, torque_constant=WIDE_TORQUE, foot_position=WIDE_FOOT)
"""The combined method: torque offsets and feet as unknowns, too. The paper's errors are up to 20 N·m and 3 cm."""


class PosesCom(StaticEstimator):
    """All three components by least squares over the poses that the robot has held; flat in memory.

    Args:
        robot: the model of the legs.
        start: value of components that no pose shows; None for the robot's own trunk.
        forces: source of contact forces; None for a new one.
        settings: None for the defaults, which are the paper's approach (a); `COMBINED` for errors as unknowns.

    Raises:
        ImplausibleError: an implausible start.
    """

    _WITHOUT_IMU = True

    def __init__(
        self,
        robot: Robot,
        start: TrunkModel | None = None,
        forces: ContactForceEstimator | None = None,
        settings: PosesSettings | None = None,
    ) -> None:
        self.settings = settings or PosesSettings()
        super().__init__(robot, start, forces, self.settings.still)
        self.errors = self.settings.errors(self.forces)
        self._folded = plausible(self._start, self.bounds)
        self._open: PoseMean | None = None
        self._closed: list[PoseMean] = []
        self._linear_at = self._anchor = np.zeros(ERRORS)
        self._known = unobserved()
        self._solved, self._latest, self._count = -np.inf, np.nan, 0

    @property
    def poses(self) -> int:
        """How many poses were held."""
        return self._count

    @property
    def sources(self) -> Array:
        """(39,), the constant errors as last estimated, in the order of `error_names`; zero where they are not."""
        return self._linear_at.copy()

    def estimate(self) -> TrunkEstimate:
        """The estimate from all poses so far, solved when asked for."""
        refusal = "" if self._ran_away else self._reason
        self._solve()
        if refusal:
            self._refuse(refusal)
        return super().estimate()

    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        self._latest = measurement.time
        if self._open is None or not self._open.takes(measurement, self.settings.alike):
            self._close()
            self._open, self._count = PoseMean(measurement), self._count + 1

    def _close(self) -> None:
        kept = self.settings.kept
        if kept and len(self._closed) >= kept:  # the oldest pose is about to be linearised for good
            self._solve()
            self._anchor = self._linear_at
        if self._open is not None:
            self._closed.append(self._open)
            self._open = None
        while len(self._closed) > kept:
            self._folded = with_poses(self._folded, self.forces, [self._closed.pop(0)], self._linear_at)

    def _gathered(self) -> Information:
        poses = [*self._closed, self._open] if self._open is not None else self._closed
        return with_poses(self._folded, self.forces, poses, self._linear_at)

    def _solution(self) -> Information:
        settings, before = self.settings, np.full(3, np.inf)
        self._linear_at = self._anchor
        if not settings.seek_errors:
            return with_errors(self._gathered(), self.errors, seek=False)
        for _ in range(settings.iterations):
            known = with_errors(self._gathered(), self.errors, seek=True)
            self._linear_at, com = known.mean[known["errors"]], centre_of(known)[0][1:]
            if float(np.abs(com - before).max()) < settings.settled:
                break
            before = com
        return known

    def _solve(self) -> None:
        if np.isnan(self._latest) or self._latest == self._solved:
            return
        value, covariance = centre_of(self._solution())
        self._solved = self._latest
        hidden = np.flatnonzero(~(np.sqrt(np.diag(covariance)) < self.settings.observed * self.bounds.spread))
        start = np.array([self._start.mass, *self._start.com_trunk])
        value = conditioned(value, covariance, hidden, start)
        if self._adopt(self._latest, float(value[0]), value[1:], not len(hidden)):
            self._known = covariance
            self._known[hidden, :] = self._known[:, hidden] = np.nan

    def _covariance(self) -> Array:
        return self._known


def plausible(start: TrunkModel, bounds: TrunkBounds) -> Information:
    """The weak prior: mass and centre of mass about the start, as wide as uniform ones in the plausible box."""
    known = with_box(Information.empty(TRUNK_ALONE), "trunk", bounds, start.mass, start.com_trunk)
    return with_mass(known, start.mass, float(bounds.spread[0]))


def conditioned(value: Array, covariance: Array, fixed: NDArray[np.intp], at: Array) -> Array:
    """What the other components are when some are known to be `at`."""
    if not len(fixed):
        return value
    gain = covariance[:, fixed] @ np.linalg.inv(covariance[np.ix_(fixed, fixed)])
    result = value + gain @ (at[fixed] - value[fixed])
    result[fixed] = at[fixed]
    return np.asarray(result)
