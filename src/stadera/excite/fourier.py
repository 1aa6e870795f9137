"""Periodic joint motion as a Fourier series of few harmonics, linear in its coefficients, faded in and out.

    c_j(t) = o_j + Σ_k a_jk sin(2π k f t) + b_jk cos(2π k f t),    k = 1..K        (Swevers et al. 1997)
    q(t) = q_0 + w(t) (c(t) - q_0)

with q_0 the rest pose and w the window of `sinusoids`. The motion, including the fades, is linear in (o - q_0, a, b),
so many motions are evaluated at once by one matrix product for each derivative.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stadera.errors import IdentificationError
from stadera.excite.bounds import LegBounds
from stadera.excite.sinusoids import Sinusoids, window
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class FourierSeries:
    """Motions of a leg parametrised by x (n (2K + 1),): o, then a, then b, each joint by joint.

    x is in units of half the width of the position bounds, with o measured from their middle: |o| ≤ 1 is within them.
    """

    bounds: LegBounds  # of the leg
    harmonics: int  # K
    period: float  # 1/f [s]
    duration: float  # from rest to rest [s]
    longest_fade: float = 2.0  # longest fade at each end [s]; a third of a short motion

    @property
    def unknowns(self) -> int:
        """Length of x."""
        return len(self.bounds.joints) * (2 * self.harmonics + 1)

    @property
    def fade(self) -> float:
        """Length of each of the two fades [s]."""
        return min(self.longest_fade, self.duration / 3.0)

    @property
    def swing(self) -> float:
        """Time after the first fade during which the motion does not repeat [s]."""
        return min(self.period, self.duration - 2.0 * self.fade)

    @cached_property
    def half(self) -> Array:
        """Half the width of the position bounds, (n,) [rad]."""
        half = 0.5 * (self.bounds.upper - self.bounds.lower)
        if not (half > 1e-3).all():
            raise IdentificationError(f"leg {self.bounds.leg}: a joint has no room to move within its bounds")
        return half

    def basis(self, time: Array) -> tuple[Array, Array, Array]:
        """Matrices that map coefficients to q - q_0 and its two derivatives, (samples, 1 + 2K) each."""
        omega = 2.0 * np.pi / self.period * np.arange(1, self.harmonics + 1)
        angle, zero = time[:, None] * omega, np.zeros((len(time), 1))
        sine, cosine = np.sin(angle), np.cos(angle)
        c = np.hstack((zero + 1.0, sine, cosine))
        dc = np.hstack((zero, omega * cosine, -omega * sine))
        ddc = np.hstack((zero, -(omega**2) * sine, -(omega**2) * cosine))
        w, dw, ddw = (v[:, None] for v in window(time, 0.0, self.duration - self.fade, self.fade))
        return w * c, dw * c + w * dc, ddw * c + 2.0 * dw * dc + w * ddc

    def coefficients(self, x: Array) -> Array:
        """(o - q_0, a, b) of each row of x (batch, unknowns), (batch, 1 + 2K, n) [rad]."""
        n = len(self.bounds.joints)
        swings = x[:, n:].reshape(len(x), 2, n, self.harmonics).transpose(0, 1, 3, 2)
        out = np.empty((len(x), 1 + 2 * self.harmonics, n))
        out[:, 0] = self.half * x[:, :n] + self._middle - self.bounds.rest
        out[:, 1:] = self.half * swings.reshape(len(x), -1, n)
        return out

    def motion(self, x: Array) -> Sinusoids:
        """The same motion as sinusoids: a sin + b cos = √(a² + b²) sin(· + atan2(b, a))."""
        K, n = self.harmonics, len(self.bounds.joints)
        constant, *swings = self.coefficients(x[None])[0]
        a, b = np.array(swings).reshape(2, K, n).transpose(0, 2, 1)
        frequency = np.broadcast_to(np.arange(1, K + 1) / self.period, (1, n, K))
        return Sinusoids(
            joints=self.bounds.joints,
            rest=self.bounds.rest,
            origins=(self.bounds.rest + constant)[None],
            amplitudes=np.hypot(a, b)[None],
            frequencies=frequency,
            phases=np.arctan2(b, a)[None],
            starts=np.array([0.0, self.duration - self.fade]),
            fade=self.fade,
        )

    def instants(self, rate: float) -> Array:
        """Increasing times [s] that cover the whole motion: its start, the first period, its end."""
        rise, fall = self.fade + self.swing, self.duration - self.fade
        first = np.linspace(0.0, rise, int(np.ceil(rise * rate)), endpoint=False)
        return np.concatenate((first, np.linspace(fall, self.duration, int(np.ceil(self.fade * rate)))))

    def quadrature(self, samples: int) -> tuple[Array, Array]:
        """Times [s] and their weights in the whole duration [s]: one period, and a third as many in each fade."""
        fading = (np.arange(samples // 3) + 0.5) / (samples // 3)
        swinging = self.fade + (np.arange(samples) + 0.5) / samples * self.swing
        times = np.concatenate((self.fade * fading, swinging, self.duration - self.fade + self.fade * fading))
        ends = np.full(len(fading), self.fade / len(fading))
        return times, np.concatenate((ends, np.full(samples, (self.duration - 2.0 * self.fade) / samples), ends))

    @property
    def _middle(self) -> Array:
        return 0.5 * (self.bounds.upper + self.bounds.lower)
