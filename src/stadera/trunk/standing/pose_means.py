"""Groups samples at rest into poses, each stored as the mean of similar samples."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import ModelError
from stadera.trunk.measurement import Measurement
from stadera.types import Array


@dataclass(frozen=True)
class Alike:
    """Largest difference between a sample and the mean of its pose.

    Attributes:
        joint: of any joint [rad].
        tilt: of the vertical [rad]; ignored if the vertical comes from the feet's forces, whose noise exceeds the tilt
            between poses.
    """

    joint: float = 0.02
    tilt: float = 0.01

    def __post_init__(self) -> None:
        if not (self.joint > 0 and self.tilt > 0):
            raise ModelError(f"samples of a pose need positive tolerances, got {self.joint} rad, {self.tilt} rad")


class PoseMean:
    """Running mean of similar samples.

    Args:
        first: the first sample.

    Attributes:
        count: number of samples.
    """

    def __init__(self, first: Measurement) -> None:
        self._first = first
        self._q, self._effort = first.joint_position.copy(), first.effort.copy()
        self._up, self._extra = first.up.copy(), first.extra.copy()
        self._feet = None if first.foot_position is None else first.foot_position.copy()
        self._foot_squares, self._effort_squares = 0.0, np.zeros((len(self._effort), len(self._effort)))
        self.count = 1

    def takes(self, m: Measurement, alike: Alike) -> bool:
        """Adds a sample if it is similar and the same legs are in stance; returns whether it was added."""
        if _meant(m) != _meant(self._first) or (m.foot_position is None) != (self._feet is None):
            return False
        if float(np.abs(m.joint_position - self._q).max()) > alike.joint:
            return False
        k = len(self._extra) // 2
        if k and float(np.abs(m.extra[:k] - self._extra[:k]).max()) > alike.joint:
            return False
        up = m.up
        if not m.vertical_by_forces and float(np.abs(up - self._up).max()) > alike.tilt:
            return False
        self.count += 1
        share = 1.0 / self.count
        self._q += share * (m.joint_position - self._q)
        self._extra += share * (m.extra - self._extra)
        scatter = m.effort - self._effort
        self._effort += share * scatter
        self._effort_squares += (1.0 - share) * np.outer(scatter, scatter)
        self._up += share * (up - self._up)
        if self._feet is not None and m.foot_position is not None:
            away = m.foot_position - self._feet
            self._feet += share * away
            self._foot_squares += (1.0 - share) * float((away * away).sum())
        return True

    @property
    def effort_covariance(self) -> Array:
        """Covariance (n, n) of the mean efforts [N²·m²] from their scatter; 0 for a single sample."""
        return np.asarray(self._effort_squares / (max(self.count - 1, 1) * self.count))

    @property
    def foot_variance(self) -> float:
        """Variance of each component of the feet's mean positions [m²] from their scatter; 0 if they are not
        measured.
        """
        return self._foot_squares / (12 * max(self.count - 1, 1) * self.count)

    @property
    def measurement(self) -> Measurement:
        """The mean, as a measurement at rest."""
        return replace(
            self._first,
            joint_position=self._q.copy(),
            joint_velocity=np.zeros_like(self._q),
            effort=self._effort.copy(),
            angular_velocity=np.zeros(3),
            specific_force=GRAVITY * self._up / np.linalg.norm(self._up),
            rotation=None,
            extra=self._extra.copy(),
            foot_position=None if self._feet is None else self._feet.copy(),
        )


def _meant(m: Measurement) -> list[bool]:
    """Legs meant to be in stance."""
    return [True] * 4 if m.stance is None else m.stance.tolist()
