"""The ground: a plane, level or a ramp. Gravity stays along -z of the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.errors import ModelError

Array = NDArray[np.float64]

_STEEPEST = np.deg2rad(60.0)


@dataclass(frozen=True)
class Terrain:
    """A plane through the world's origin.

    Attributes:
        slope: [rad], how steeply it rises; 0 for level ground.
        heading: [rad], about the world's z from x: the direction in which it rises.
        friction: Coulomb friction coefficient between the feet and it.
    """

    slope: float = 0.0
    heading: float = 0.0
    friction: float = 0.8

    def __post_init__(self) -> None:
        if not abs(self.slope) <= _STEEPEST:
            raise ModelError(f"terrain slope must lie within ±60°, got {np.rad2deg(self.slope):.1f}°")
        if not np.isfinite(self.heading):
            raise ModelError(f"terrain heading is not finite: {self.heading}")
        if not (np.isfinite(self.friction) and self.friction > 0):
            raise ModelError(f"terrain friction must be positive, got {self.friction}")

    @property
    def rotation(self) -> Array:
        """The least rotation from level to this plane, (3, 3); its last column is the normal, in world axes."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        c, s = np.cos(self.slope), np.sin(self.slope)
        tilt = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])  # rises along x: the normal leans towards -x
        return np.asarray(turn @ tilt @ turn.T)

    @property
    def normal(self) -> Array:
        """Unit normal in world axes, (3,)."""
        return self.rotation[:, 2]
