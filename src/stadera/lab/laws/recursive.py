"""Base of the paper's feedback laws (b) and (c): small steps towards the centre of mass indicated by statics.

Both compute, from one instant, the error δ = c - ĉ of the WHOLE robot's centre of mass normal to the vertical u (trunk
axes); along u nothing is observed. The legs being known, the trunk's own error is δ m_r / m_tr (the paper's remark 1
omits the factor, and its steps are smaller by it). With E = 1 - u uᵀ = ᵂR_bᵀ E_xy ᵂR_b, the world's x-y plane

    ĉ_tr ← ĉ_tr + β (m_r / m_tr) S E δ,      m̂_r ← m̂_r + β (u · Σ f / g - m̂_r)      (eq. 7, 13, 19)

One pose determines a line along u through c, and S selects the point on it to which ĉ converges. With the paper's
S = 1 the component of the initial error along u remains, so that on a slope γ the trunk's x-y have a remaining error of
sin γ times that, which depends on the start. Here S = 1 - u e_zᵀ / u_z (e_z · S E δ = 0) keeps the prior height
instead: x and y converge to the same values from any start, with the error (u_xy / u_z) δ_z alone. In the world's x-y
plane both errors are zero, and for a level trunk both choices are the same.

A second pose determines the remaining component. With phase one at the vertical u₀, ĉ is off by s u₀ alone; for a trunk
tilted since,

    E δ = s E u₀        =>        s = u₀ · E δ / (1 - (u · u₀)²)            (eq. 15, where u₀ = e_z)

An error of the wrench w = (Σ f, μ) about the trunk's origin changes them by

    δm = uᵀ δΣf / g,    δc = [u]x (δμ - [c]x δΣf) / (m_r g),    δc_tr = (m_r / m_tr) δc + δm (c - c_tr) / m_tr

and with errors ε₁, ε of this kind in the two phases, s by u₀ · (ε - E₀ ε₁) / (1 - (u · u₀)²).

Approach (c), contact forces (section III.C, eq. 16-19). At rest the contact forces' moment about the whole robot's
centre of mass c vanishes, c x F = μ with F = Σ f_i and μ = Σ p_i x f_i about the trunk's origin, p_i where the ground
touches the foot. So -[F]x c = μ, of which [F]x has rank two; its damped pseudo-inverse ([F]xᵀ [F]x + λ² 1)⁻¹ [F]xᵀ is
-[F]x / (|F|² + λ²) on all that μ can be, hence

    c_⊥ = -[F]x⁺ μ = F x μ / (|F|² + λ²),

the point of the line of action nearest to the trunk's origin. The estimate steps towards it by α = 0.002 at 1 kHz,
first in a plane (see `RecursiveCom`), and after a tilt of the trunk along the remaining direction. All vectors
are in trunk axes, so no heading is needed.
"""

from dataclasses import dataclass
from functools import cached_property
from math import exp, log

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import IdentificationError
from stadera.inertia import skew
from stadera.lab.laws.equilibrium import error_slope
from stadera.lab.laws.static import StaticEstimator, white_covariance
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import unobserved
from stadera.trunk.standing.detection import StaticLimits
from stadera.trunk.standing.forces import ContactForces
from stadera.types import Array

STEP, PERIOD = 0.002, 0.001
"""α of the paper's approach (c), and the period [s] for which it is given."""


def settling_time(step: float = STEP, period: float = PERIOD) -> float:
    """Time t_a [s] until e^-3 (5 %) of an error remains, for a step β (0 to 1) every `period` T_s [s].

    ĉ(k+1) = ĉ(k) + β (c - ĉ(k)) leaves 1 - β of the error each time, so t_a = -3 T_s / ln(1 - β) (the paper, below
    eq. 14). Keeping t_a constant for any T_s makes an estimate independent of the sampling rate.
    """
    return -3.0 * period / log(1.0 - step)


def step_size(settling: float, period: float) -> float:
    """The step (0 to 1) every `period` [s] that leaves 5 % of an error after `settling` [s]."""
    return 1.0 - exp(-3.0 * period / settling)


class Settled:
    """The paper's criterion of convergence: the innovation |c - ĉ| is below 0.0005 m (section V.C), apart from noise.

    A single sample's innovation is dominated by noise, so a running mean of it is compared, `quicker` times faster than
    the estimate. At low rates even the mean has a noise of millimetres: the part within `deviations` standard
    deviations, from the scatter of the innovations, is ignored. The estimate is then as close as the noise allows.
    """

    quicker, deviations = 5.0, 2.0

    def __init__(self, tolerance: float = 0.0005) -> None:
        self.tolerance = tolerance
        self.restart()

    def restart(self) -> None:
        """Discards all innovations."""
        self._mean: Array | float = 0.0
        self._spread, self._noise, self._left = 0.0, 0.0, 1.0

    def take(self, innovation: Array, step: float) -> None:
        """Adds an innovation (k,); `step` is the estimate's own."""
        share = min(self.quicker * step, 1.0)
        away = innovation - self._mean
        self._mean = self._mean + share * away
        self._spread += share * ((1.0 - share) * float(away @ away) - self._spread)
        self._noise = self._spread * share / (2.0 - share)
        self._left *= 1.0 - share

    @property
    def reached(self) -> bool:
        """True if the estimate has settled; never before the mean covers a time constant."""
        if self._left >= exp(-1.0):
            return False
        return float(np.sum(np.square(self._mean))) < self.tolerance**2 + self.deviations**2 * self._noise


SLOW = StaticLimits(angular_velocity=0.3, joint_velocity=0.5, specific_force=1.0, quiet=0.02)
"""Slow enough for small steps: while a law's own corrections rotate the trunk, inertial moments stay small."""

LEAST_TILT = np.deg2rad(3.0)
"""Least tilt between the poses of the two phases [rad]."""


@dataclass(frozen=True)
class LawSettings:
    """Settings of a feedback law, all positive."""

    settling: float = settling_time()  # time after which 5 % of an error remains [s]; the paper's by default
    period: float = 0.02  # of the updates of `OrientationCom`, which averages in between [s]
    # standard deviation of the centre of mass along the vertical, where it is not observed [m]; on a slope it enters
    # the other components' covariance
    height_std: float = 0.05
    still: StaticLimits = SLOW  # limits of standing still
    mass_settled: float = 1e-3  # innovation of the mass below which it has settled, as a share of the robot's mass
    stale: float = 0.1  # interval at which the covariance is recomputed [s]
    hidden: float = 0.5  # share of the vertical along an axis above which this component is not observed
    damping: float = 1e-3  # λ of `ContactCom`'s pseudo-inverse, as a share of the weight; biases by its square
    longest_step: float = 0.1  # largest duration assigned to one measurement, as a share of `settling`

    def selection(self, up: Array) -> Array:
        """S (3, 3)."""
        select = np.eye(3)
        if up[2] > self.hidden:
            select[:, 2] -= up / up[2]
        return select


@dataclass(frozen=True, eq=False)
class Instant:
    """State of a law at one instant, trunk axes."""

    forces: ContactForces  # of the feet
    up: Array  # (3,), the vertical
    com: Array  # (3,) [m], of the whole robot
    trunk: TrunkModel  # the estimate

    @cached_property
    def from_wrench(self) -> Array:
        """Derivative (4, 6) of mass and the trunk's centre of mass with respect to the wrench."""
        slope = np.zeros((4, 6))
        slope[0, :3] = self.up / GRAVITY
        slope[1:, 3:] = skew(self.up) / (self.trunk.mass * GRAVITY)
        away = (self.com - self.trunk.com_trunk) / self.trunk.mass
        slope[1:, :3] = np.outer(away, slope[0, :3]) - slope[1:, 3:] @ skew(self.com)
        return slope


class RecursiveCom(StaticEstimator):
    """A law that steps towards the centre of mass, first in a plane and then along a line."""

    kind = LawSettings
    settings: LawSettings

    def _begin(self) -> None:
        self._settled = Settled()
        self._mass_settled = Settled(self.settings.mass_settled * self.robot.mass)
        self._known: Array | None = None
        self._seen_from: Instant | None = None
        self._seen_at = -np.inf
        self._before: Instant | None = None  # at the end of phase one; None in it
        self._step = 0.0

    def _robot_com(self, leg_moment: Array) -> Array:
        """Estimate of the whole robot's centre of mass, trunk frame (3,) [m]."""
        trunk = self._trunk
        return np.asarray((trunk.mass * trunk.com_trunk + leg_moment) / (trunk.mass + self.forces.leg_mass))

    def _weighed(self, forces: ContactForces, up: Array, step: float) -> tuple[float, bool]:
        """The trunk's mass [kg] after this step (eq. 7), and whether it has settled."""
        robot_mass = self._trunk.mass + self.forces.leg_mass
        change = float(up @ forces.wrench[:3]) / GRAVITY - robot_mass
        self._mass_settled.take(np.array([change]), step)
        return robot_mass + step * change - self.forces.leg_mass, self._mass_settled.reached

    def _selected(self, error: Array, up: Array) -> Array | None:
        """The innovation (3,) [m] from E δ of the trunk; None if the tilt is too small in phase two."""
        if self._before is not None:
            line = self._before.up
            square = 1.0 - float(up @ line) ** 2
            if square < np.sin(LEAST_TILT) ** 2:
                return None
            return line * (float(line @ error) / square)
        return self.settings.selection(up) @ error

    def look_for_height(self, reference: Array | None = None) -> None:
        """Starts phase two: the components in the plane are kept, and later tilted poses determine the height. Raises
        IdentificationError: the components in the plane have not been found yet.

        Args:
            reference: (3, 3), world, to which the controller holds the trunk from now on; of `OrientationCom`.
        """
        if (self._before is None and not self._settled.reached) or self._seen_from is None:
            raise IdentificationError("the height is estimated once the components in the plane have converged")
        self._before, self._known = self._before or self._seen_from, None
        self._settled.restart()

    def _interrupted(self) -> None:
        self._settled.restart()
        self._mass_settled.restart()

    def _looked_at(self, m: Measurement, forces: ContactForces, com: Array) -> None:
        """Stores an instant at intervals, at which the covariance is computed on demand."""
        if m.time - self._seen_at >= self.settings.stale:
            self._seen_from, self._seen_at = Instant(forces, m.up, com, self._trunk), m.time
            self._known = None

    # -- covariance -----------------------------------------------------------------------------------------------
    def _covariance(self) -> Array:
        if self._seen_from is None:
            return unobserved()
        if self._known is None:
            one_pose = self._before is None
            self._known = self._of_one_pose(self._seen_from) if one_pose else self._of_two_poses(self._seen_from)
        return self._known

    def _of_one_pose(self, instant: Instant) -> Array:
        settings, up, felt = self.settings, instant.up, self._felt(instant)
        covariance = (felt * self._error_std**2) @ felt.T + self._white(instant)
        select, lost = np.eye(4), up
        select[1:, 1:] = settings.selection(up)
        if kept := bool(up[2] > settings.hidden):
            lost = up / up[2]
        covariance = select @ covariance @ select.T
        covariance[1:, 1:] += settings.height_std**2 * np.outer(lost, lost)
        hidden = np.array([3]) if kept else np.flatnonzero(np.abs(up) > settings.hidden) + 1
        covariance[hidden, :] = covariance[:, hidden] = np.nan
        return np.asarray(covariance)

    def _of_two_poses(self, second: Instant) -> Array:
        """From A ε₁ + B ε with A = E₀ - u₀ u₀ᵀE E₀ / sin², B = u₀ u₀ᵀ / sin²; the mass is the second pose's."""
        first = self._before
        assert first is not None
        line, up = first.up, second.up
        square = 1.0 - float(up @ line) ** 2
        if square < 0.5 * np.sin(LEAST_TILT) ** 2:  # still moving to the tilt
            return unobserved()
        plane = np.eye(3) - np.outer(line, line)
        A, B = np.zeros((4, 4)), np.zeros((4, 4))
        B[0, 0], B[1:, 1:] = 1.0, np.outer(line, line) / square
        A[1:, 1:] = plane - B[1:, 1:] @ (np.eye(3) - np.outer(up, up)) @ plane
        felt = A @ self._felt(first) + B @ self._felt(second)
        white = A @ self._white(first) @ A.T + B @ self._white(second) @ B.T
        return np.asarray((felt * self._error_std**2) @ felt.T + white)

    def _felt(self, instant: Instant) -> Array:
        """Errors (4, k) of mass and centre of mass per unit of the constant errors."""
        return np.asarray(instant.from_wrench @ error_slope(instant.forces, self.robot, instant.up))

    def _white(self, instant: Instant) -> Array:
        """Covariance (4, 4) due to the torques' white noise; steps β leave β / (2 - β) of its variance."""
        slope, share = instant.from_wrench, self._step / (2.0 - self._step)
        return np.asarray(share * slope @ white_covariance(instant.forces, self.forces.noise) @ slope.T)


_NOT_TILTED = f"the height is observable in a trunk tilted by {np.rad2deg(LEAST_TILT):.0f}° since the plane was found"


class ContactCom(RecursiveCom):
    """Steps towards the line of action of the contact forces, with any controller, in closed loop or open loop."""

    _last = np.nan

    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        time, up = measurement.time, measurement.up
        elapsed, self._last = time - self._last, time
        if not elapsed > 0:  # the first after an interruption has no duration
            return
        settling = self.settings.settling
        step = self._step = step_size(settling, min(elapsed, self.settings.longest_step * settling))
        F, mu = np.split(forces.wrench, 2)
        square = float(F @ F)
        nearest = np.cross(F, mu) / (square + self.settings.damping**2 * square)
        com = self._robot_com(forces.weights.moment)
        mass, weighed = self._weighed(forces, up, step)
        error = nearest - com
        error = (1.0 + self.forces.leg_mass / self._trunk.mass) * (error - up * float(up @ error))
        innovation = self._selected(error, up)
        if innovation is None:
            self._refuse(_NOT_TILTED)
            return
        self._settled.take(innovation, step)
        if self._adopt(time, mass, self._trunk.com_trunk + step * innovation, weighed and self._settled.reached):
            self._looked_at(measurement, forces, com)

    def _interrupted(self) -> None:
        super()._interrupted()
        self._last = np.nan
