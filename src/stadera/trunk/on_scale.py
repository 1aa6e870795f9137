"""What a scale that the robot stood on tells about its trunk and payload.

The robot weighs M = m + Σ m_l (1 + p_l), with m of the trunk and the legs' links by their model masses m_l. The
estimate of a segment has the error n - K δ, with n the noise of its rows and δ that of p̂, so that of M̂ is

    ν = n_m + h δ,      h = (m_l) - k,      k the first row of K,      S = h Σ hᵀ + κ P_mm + σ²

The scale's M - M̂ = y corrects whatever else is asked for, of error e, by its covariance C with ν:

    x ← x + C y / S,      cov x ← cov x - C Cᵀ / S,      C = cov(n, n_m) - K Σ hᵀ

Errors that may change with the load are others at another time: they are in S, and not in C of another segment. What a
scale tells is mostly the scale that all torques have in common, which no motion shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import Segment
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class OnScale:
    """What a scale says.

    Attributes:
        carried: mass without the model's legs [kg]. std: of the scale [kg].
        links: (errors,), mass of each leg's link at its place in p, else zero [kg].
        segment: the trunk when it was weighed; None for the present load.
    """

    carried: float
    std: float
    links: Array
    segment: Segment | None = None


class Told:
    """A scale's correction of estimates with the same model errors.

    Args:
        scale: what it says. errors: p̂ and Σ. segment: the trunk that was weighed. scatter: κ.

    Attributes:
        apart: y over its standard deviation, how far scale and log are from each other [1].
    """

    def __init__(self, scale: OnScale, errors: Errors, segment: Segment, scatter: float) -> None:
        self._errors, self._segment, self._scatter = errors, segment, scatter
        h = scale.links - segment.sensitivity[0]
        self._lasting = errors.lasting @ h
        self._along = errors.covariance @ h
        noise = scatter * float(segment.inverse[0] @ segment.inverse[0])
        self._variance = float(h @ self._along) + noise + scale.std**2
        self._missing = scale.carried - float(segment.mean(errors.mean)[0] + scale.links @ errors.mean)
        self.apart = self._missing / float(np.sqrt(self._variance))

    def shared(self, segment: Segment) -> Array:
        """C of a segment's trunk, (10,)."""
        if segment is not self._segment:
            return np.asarray(-segment.sensitivity @ self._lasting)
        own = self._scatter * segment.inverse @ segment.inverse[0]
        return np.asarray(own - segment.sensitivity @ self._along)

    def corrected(self, value: Array, covariance: Array, by_scale: Array, shared: Array) -> tuple[Array, Array, Array]:
        """An estimate (10,) and its covariance (10, 10) with what the scale says.

        Args:
            by_scale: (10,), see `Errors.by_scale`. shared: C.

        Returns:
            Value, covariance, and what is left of `by_scale`.
        """
        gain = shared / self._variance
        at = self._errors.layout.places["common_gain"].start
        own, seen = self._errors.covariance[at, at], self._along[at]
        left = max(own - seen**2 / self._variance, 1e-300)
        by_scale = (by_scale * np.sqrt(own) + gain * seen) / np.sqrt(left)
        return value + gain * self._missing, covariance - np.outer(gain, shared), by_scale
