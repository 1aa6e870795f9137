"""Tests for a change of the load at each moment near rest, with a specified false-alarm rate.

While nothing changes, the unknowns are the trunk's mass m (load included) and the run's constant torque offsets n, as a
Gaussian x = (m, n) ~ N(x̂, P). Moment k gives

    m_k = h_k x + e_k,     h_k = (1, s_k),     e_k ~ N(0, σ_k² + σ_u²)

(s_k, σ_k: `stadera.lab.supervise.rest`; σ_u: residual of statics while a robot walks). So, if nothing has changed,

    ν_k = m_k - h_k x̂ ~ N(0, S_k),     S_k = h_k P h_kᵀ + σ_k² + σ_u²

Since m and n are estimated from all moments (Kalman filter, constant state), the innovations ν_k are independent of one
another, although offsets bias the mass alike in every cycle of a run, and

    |ν_k| > z √S_k,     z = Φ⁻¹(1 - α / 2)

raises a false alarm with probability α in each check, in any run: α = rate x interval, with at most one check in each
interval. A change δ is missed by one check with probability Φ(z - |δ| / √S_k); `LoadTest.detectable` is the δ for a
given probability. After a change the mass is unknown again and the offsets are kept: P_mm is set to a large value, P_mn
to zero. A leg in the air measures its own offsets (`stadera.lab.supervise.offsets`), three of x's components, whose
variance is increased slightly before, since offsets may drift.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import sqrt

import numpy as np
from scipy.special import ndtri

from stadera.errors import StaderaError, require_positive
from stadera.lab.supervise.offsets import LegOffsets
from stadera.lab.supervise.rest import RestMoment
from stadera.trunk.standing.noise import ForceNoise
from stadera.types import Array


@dataclass(frozen=True)
class LoadTestSettings:
    """Settings of the test. StaderaError unless positive, and with more than one false alarm in two checks."""

    false_alarms: float = 0.1  # accepted, per hour of walking
    interval: float = 0.1  # least time between checks [s]
    unexplained: float = 0.003  # σ_u, as a share of the robot's mass
    # standard deviation of the prior mass, as a share of the robot's mass; a load present from the beginning is
    # detected if it is significantly larger
    prior: float = 0.005
    # of a torque offset from one swing of its leg to the next, as a share of the offsets' usual size
    drift: float = 0.1

    def __post_init__(self) -> None:
        require_positive("load test:", self, (field.name for field in fields(self)))
        if self.alpha > 0.5:
            raise StaderaError(f"load test: {self.false_alarms} false alarms an hour are more than one in two checks")

    @property
    def alpha(self) -> float:
        """Probability of a false alarm in one check."""
        return self.false_alarms * self.interval / 3600.0

    @property
    def deviations(self) -> float:
        """z, the threshold in standard deviations."""
        return float(-ndtri(0.5 * self.alpha))


@dataclass(frozen=True)
class LoadCheck:
    """One check of the mass."""

    time: float  # [s], of the end of the moment
    mass: float  # [kg], of trunk and load, from this moment
    expected: float  # from the estimate before
    std: float  # [kg], √S of their difference if nothing has changed
    threshold: float  # [kg], z √S

    @property
    def change(self) -> float:
        """ν [kg], positive if mass was added."""
        return self.mass - self.expected

    @property
    def changed(self) -> bool:
        """True if the load has changed."""
        return abs(self.change) > self.threshold


class LoadTest:
    """Estimates mass and torque offsets, and tests each moment; shares are of `robot_mass` [kg]."""

    def __init__(
        self, robot_mass: float, trunk_mass: float, noise: ForceNoise, settings: LoadTestSettings | None = None
    ) -> None:
        self.settings = settings or LoadTestSettings()
        self._robot_mass = robot_mass
        self._unexplained = (self.settings.unexplained * robot_mass) ** 2
        self._checked = -np.inf
        self._x = np.array([trunk_mass, *np.zeros(noise.torque_constant.size)])
        variances = [(self.settings.prior * robot_mass) ** 2, *noise.torque_constant.ravel() ** 2]
        self._P = np.diag(variances)
        self._drift = (self.settings.drift * noise.torque_constant) ** 2

    @property
    def mass(self) -> float:
        """Estimated mass of trunk and load [kg]."""
        return float(self._x[0])

    @property
    def mass_std(self) -> float:
        """Standard deviation of the mass [kg]."""
        return sqrt(self._P[0, 0])

    @property
    def offsets(self) -> Array:
        """Estimated torque offsets, (12,) [N·m], leg by leg."""
        return self._x[1:].copy()

    def check(self, moment: RestMoment) -> LoadCheck | None:
        """Tests a moment, and updates the estimate unless the load has changed. None if too soon after the last."""
        if moment.end - self._checked < self.settings.interval:
            return None
        self._checked = moment.end
        h, expected, S = self._innovation(moment)
        std = sqrt(S)
        check = LoadCheck(moment.end, moment.mass, expected, std, self.settings.deviations * std)
        if not check.changed:
            gain = self._P @ h / S
            self._x = self._x + gain * check.change
            self._P = self._P - np.outer(gain, gain) * S
        return check

    @property
    def offsets_std(self) -> Array:
        """Standard deviations of the offsets, (12,) [N·m]."""
        return np.asarray(np.sqrt(np.diag(self._P)[1:]))

    def learn_offsets(self, swing: LegOffsets) -> None:
        """Updates a leg's offsets from a measurement in swing."""
        own = slice(1 + 3 * swing.leg, 4 + 3 * swing.leg)
        self._P[own, own] += np.diag(self._drift[swing.leg])
        gain = np.linalg.solve(self._P[own, own] + np.diag(swing.variance), self._P[own]).T
        self._x = self._x + gain @ (swing.value - self._x[own])
        self._P = self._P - gain @ self._P[own]
        self._P = 0.5 * (self._P + self._P.T)

    def detectable(self, moment: RestMoment, missed: float = 1e-3) -> float:
        """The change of mass [kg] that a check of this moment misses with the given probability."""
        return (self.settings.deviations - float(ndtri(missed))) * sqrt(self._innovation(moment)[2])

    def forget_mass(self) -> None:
        """Resets the mass after a change of the load; the offsets are kept."""
        self._P[0, :] = self._P[:, 0] = 0.0
        self._P[0, 0] = self._robot_mass**2

    def _innovation(self, moment: RestMoment) -> tuple[Array, float, float]:
        h = np.array([1.0, *moment.slope])
        S = float(h @ self._P @ h) + moment.variance + self._unexplained
        return h, float(h @ self._x), S
