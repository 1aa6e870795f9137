"""Joint references composed of sinusoids: smooth, exactly differentiable, at rest at both ends.

A motion is a sequence of segments. In segment s each joint j oscillates about its own origin (section IV of the
paper)::

    c_sj(t) = O_sj + Σ_k A_sjk sin(2π f_sjk (t - T_s) + φ_sjk)

and the segments are faded into one another, and at both ends into the rest pose q_0, by windows w_s::

    q(t) = q_0 + Σ_s w_s(t) (c_s(t) - q_0),     w_s(t) = b((t - T_s) / h) - b((t - T_{s+1}) / h)
    b(x) = 10 x³ - 15 x⁴ + 6 x⁵ on 0..1, 0 before, 1 after

If the fade length h does not exceed any segment, all w_s are ≥ 0 and sum to at most 1: q(t) is a convex combination of
the segments' curves and the rest pose, so bounds on positions that hold for those hold throughout. b has two continuous
derivatives that are zero at both ends, so velocity and acceleration are continuous, and zero at the start and the end.
One segment whose frequencies are multiples of a base frequency is the usual Fourier series (Swevers et al. 1997).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from stadera.body.torques import JointMotion
from stadera.errors import IdentificationError, positive
from stadera.types import Array

FREQUENCIES = (0.3, 0.9)
"""The paper's band [Hz]: faster motion excites structural vibrations, which are not modelled."""


@dataclass(frozen=True, eq=False)
class Reference(JointMotion):
    """A motion for a controller to track, evenly sampled."""

    joints: tuple[str, ...]  # names of the n joints
    time: Array  # (samples,) [s], from zero


@dataclass(frozen=True, eq=False)
class Sinusoids:
    """Segments of sinusoids about shifted origins; see the module's equations. IdentificationError for inconsistent
    shapes, values that are not finite, times that do not increase, or segments shorter than the fade.
    """

    joints: tuple[str, ...]  # names of the n joints
    rest: Array  # (n,) [rad], the pose at the start and the end
    origins: Array  # (segments, n) [rad]
    amplitudes: Array  # (segments, n, harmonics) [rad]
    frequencies: Array  # likewise [Hz]
    phases: Array  # likewise [rad]
    starts: Array  # (segments + 1,) [s], increasing: start of each segment's fade-in, and of the final fade-out
    fade: float  # h [s], no longer than any segment

    def __post_init__(self) -> None:
        n, segments = len(self.joints), len(self.origins)
        harmonics = self.amplitudes.shape[-1] if self.amplitudes.ndim == 3 else 0
        shapes = {"rest": (n,), "origins": (segments, n), "starts": (segments + 1,)}
        shapes |= dict.fromkeys(("amplitudes", "frequencies", "phases"), (segments, n, harmonics))
        for name, shape in shapes.items():
            values = getattr(self, name)
            if values.shape != shape or not np.isfinite(values).all():
                raise IdentificationError(f"sinusoids need finite {name} of shape {shape}, got shape {values.shape}")
        if not 0 < self.fade <= np.diff(self.starts).min(initial=np.inf) + 1e-9:
            raise IdentificationError(
                f"every segment must last at least one fade, {self.fade} s; they start at {self.starts.tolist()} s"
            )

    @property
    def duration(self) -> float:
        """Time at which the motion is at rest again [s]."""
        return float(self.starts[-1] + self.fade)

    def at(self, time: ArrayLike) -> JointMotion:
        """Position, velocity and acceleration at increasing times (samples,) [s]; exact, and at rest outside the
        motion.
        """
        t = np.asarray(time, dtype=float)
        q = np.tile(self.rest, (len(t), 1))
        dq, ddq = np.zeros_like(q), np.zeros_like(q)
        for s in range(len(self.origins)):
            part = slice(*np.searchsorted(t, (self.starts[s], self.starts[s + 1] + self.fade)))
            c, dc, ddc = self._curve(s, t[part])
            faded = window(t[part], self.starts[s], self.starts[s + 1], self.fade)
            w, dw, ddw = (values[:, None] for values in faded)
            q[part] += w * c
            dq[part] += dw * c + w * dc
            ddq[part] += ddw * c + 2.0 * dw * dc + w * ddc
        return JointMotion(q, dq, ddq)

    def sample(self, rate: float) -> Reference:
        """Samples the whole motion at `rate` [Hz], from zero to the end; IdentificationError unless it is positive."""
        positive("a sampling rate", rate, "Hz", IdentificationError)
        time = np.arange(int(np.ceil(self.duration * rate - 1e-6)) + 1) / rate
        return Reference(**vars(self.at(time)), joints=self.joints, time=time)

    def drawn_in(self, factor: float) -> Sinusoids:
        """The motion scaled towards the rest pose: q_0 + factor (q(t) - q_0)."""
        origins = self.rest + factor * (self.origins - self.rest)
        return replace(self, origins=origins, amplitudes=factor * self.amplitudes)

    def _curve(self, s: int, t: Array) -> tuple[Array, Array, Array]:
        """c_s - q_0 with its two derivatives, (samples, n) each."""
        omega = 2.0 * np.pi * self.frequencies[s]
        angle = omega * (t - self.starts[s])[:, None, None] + self.phases[s]
        swing = self.amplitudes[s] * np.sin(angle)
        speed = self.amplitudes[s] * omega * np.cos(angle)
        return self.origins[s] - self.rest + swing.sum(axis=2), speed.sum(axis=2), -(omega**2 * swing).sum(axis=2)


def window(t: Array, start: float, end: float, fade: float) -> tuple[Array, Array, Array]:
    """w with its two derivatives, (samples,) each; it rises over `fade` from `start`, falls over `fade` from `end`."""
    rise, fall = smooth_step((t - start) / fade), smooth_step((t - end) / fade)
    return rise[0] - fall[0], (rise[1] - fall[1]) / fade, (rise[2] - fall[2]) / fade**2


def smooth_step(x: Array) -> tuple[Array, Array, Array]:
    """b(x), b'(x), b''(x): from zero to one, at rest at both ends."""
    x = np.clip(x, 0.0, 1.0)
    value = x**3 * (10.0 + x * (6.0 * x - 15.0))
    return value, 30.0 * x**2 * (1.0 - x) ** 2, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)


def check_duration(duration: float, shortest: float = 2.0) -> None:
    """Raises IdentificationError if the duration is too short for any motion: less than `shortest` [s]."""
    if not (np.isfinite(duration) and duration >= shortest):
        raise IdentificationError(f"an excitation lasts at least {shortest:g} s, got {duration} s")
