"""What the paper's feedback laws (b) and (c) share: small steps towards where the statics say the CoM is.

Both find, from one instant, the error δ = c - ĉ of the WHOLE robot's centre of mass, normal to the vertical u (trunk
axes); along u nothing is felt. The legs being known, the trunk's own error is δ m_r / m_tr (the paper's remark 1 leaves
the factor out, and its steps are smaller by it). E = 1 - u uᵀ = ᵂR_bᵀ E_xy ᵂR_b is the world's x-y plane in trunk axes:

    ĉ_tr ← ĉ_tr + β (m_r / m_tr) E δ,        m̂_r ← m̂_r + β (u · Σ f / g - m̂_r)      (eq. 7, 13, 19)

What is wrong with a wrench w = (Σ f, μ) about the trunk's origin moves them by

    δm = uᵀ δΣf / g,    δc = [u]x (δμ - [c]x δΣf) / (m_r g),    δc_tr = (m_r / m_tr) δc + δm (c - c_tr) / m_tr
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.contact import ContactForces
from stadera.estimate.convergence import TOLERANCE, Settled, positive
from stadera.estimate.equilibrium import ConstantErrors, wrench_slope
from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.protocol import unobserved
from stadera.estimate.static import StaticEstimator
from stadera.estimate.stillness import GRAVITY, StillnessLimits
from stadera.estimate.trunk import TrunkModel
from stadera.inertia import skew
from stadera.robot.model import Robot

Array = NDArray[np.float64]

SLOW = StillnessLimits(angular_velocity=0.3, joint_velocity=0.5, specific_force=1.0, quiet=0.02)
"""Slow enough for small steps: while a law's own corrections turn the trunk, moments of inertia stay small."""

_MASS_SETTLED = 1e-3  # share of the robot's mass
_STALE = 0.1  # s, after which the covariance is worked out anew
_HIDDEN = 0.5  # share of the vertical along an axis, from which this component is not observed


@dataclass(frozen=True, eq=False)
class Instant:
    """What a law knew at one instant, trunk axes.

    Attributes:
        forces: of the feet. up: (3,), the vertical. com: (3,) [m], of the whole robot. trunk: as believed.
    """

    forces: ContactForces
    up: Array
    com: Array
    trunk: TrunkModel

    @cached_property
    def from_wrench(self) -> Array:
        """(4, 6): change of mass and of the trunk's centre of mass with the wrench."""
        slope = np.zeros((4, 6))
        slope[0, :3] = self.up / GRAVITY
        slope[1:, 3:] = skew(self.up) / (self.trunk.mass * GRAVITY)
        away = (self.com - self.trunk.com_trunk) / self.trunk.mass
        slope[1:, :3] = np.outer(away, slope[0, :3]) - slope[1:, 3:] @ skew(self.com)
        return slope


class RecursiveCom(StaticEstimator):
    """A law that steps towards the centre of mass, in the plane normal to gravity.

    Args:
        settling: time [s] after which 5 % of an error is left.
        height_std: how far off the centre of mass may be along the vertical, where it is not felt [m]; on a slope it
            counts into the other components' covariance.
        orientation_std: constant error of the measured orientation [rad].
        The rest as for `StaticEstimator`.

    Raises:
        ModelError: a time or a length that is not positive.
    """

    def __init__(
        self,
        robot: Robot,
        start: TrunkModel | None,
        forces: ContactForceEstimator | None,
        limits: StillnessLimits | None,
        settling: float,
        height_std: float,
        orientation_std: float = np.deg2rad(0.2),
    ) -> None:
        super().__init__(robot, start, forces, limits or SLOW)
        self.settling = positive("settling time", settling)
        self.height_std = positive("height_std", height_std)
        self._errors = ConstantErrors.of(self.forces.noise, orientation_std)
        self._settled = Settled(TOLERANCE)
        self._known: Array | None = None
        self._seen_from: Instant | None = None
        self._seen_at = -np.inf

    # -- for the laws -----------------------------------------------------------------------------------------
    @property
    def _leg_mass(self) -> float:
        return self.forces.legs.mass

    def _robot_com(self, leg_moment: Array) -> Array:
        """The whole robot's centre of mass as believed, trunk frame (3,) [m]."""
        trunk = self._trunk
        return np.asarray((trunk.mass * trunk.com_trunk + leg_moment) / (trunk.mass + self._leg_mass))

    def _weighed(self, forces: ContactForces, up: Array, step: float) -> tuple[float, bool]:
        """The trunk's mass [kg] after this step (eq. 7), and whether it has settled."""
        robot_mass = self._trunk.mass + self._leg_mass
        change = float(up @ forces.total_force) / GRAVITY - robot_mass
        return robot_mass + step * change - self._leg_mass, abs(change) < _MASS_SETTLED * robot_mass

    @abstractmethod
    def _averaging(self) -> float:
        """Share of the white noise's variance that is left."""

    def _looked_at(self, time: float, forces: ContactForces, up: Array, com: Array) -> None:
        """Now and then, keeps an instant to work the covariance out from when asked."""
        if time - self._seen_at >= _STALE:
            self._seen_from, self._seen_at = Instant(forces, up, com, self._trunk), time
            self._known = None

    def _covariance(self) -> Array:
        if self._seen_from is None:
            return unobserved()
        if self._known is None:
            self._known = self._worked_out(self._seen_from)
        return self._known

    def _worked_out(self, instant: Instant) -> Array:
        up, sensitivity = instant.up, self._sensitivity(instant)
        covariance = sensitivity @ self._errors.covariance @ sensitivity.T + self._white(instant)
        covariance[1:, 1:] += self.height_std**2 * np.outer(up, up)
        hidden = np.flatnonzero(np.abs(up) > _HIDDEN) + 1
        covariance[hidden, :] = covariance[:, hidden] = np.nan
        return np.asarray(covariance)

    def _sensitivity(self, instant: Instant) -> Array:
        """(4, 27): how far mass and centre of mass end up off, by constant errors of torques, feet and the vertical."""
        return np.hstack([instant.from_wrench @ wrench_slope(instant.forces), np.zeros((4, 3))])

    def _white(self, instant: Instant) -> Array:
        """(4, 4), what the steps leave of the torques' white noise."""
        slope = instant.from_wrench
        return np.asarray(self._averaging() * slope @ instant.forces.wrench_covariance("white") @ slope.T)
