"""The ground: a plane, level or inclined, optionally with stones of uneven height. Gravity is along -z of the world."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stadera.errors import ModelError
from stadera.types import Array


@dataclass(frozen=True)
class Stones:
    """Stepping stones: adjacent square slabs, one centred at the origin, parallel to the plane at random heights."""

    seed: int = 0  # of the heights; the same seed gives the same stones
    height: float = 0.05  # [m], largest distance of the tops from the plane, up or down
    size: float = 0.3  # [m], edge of a stone
    # [m], (behind, ahead) of the origin along the plane's x, covered by stones
    length: tuple[float, float] = (1.5, 6.0)
    width: float = 3.0  # [m], across, half of it on either side
    level: float = 0.7  # [m], half edge of the square around the origin in which stones are in the plane

    @property
    def counts(self) -> tuple[int, int, int]:
        """Number of stones behind, ahead and on either side of the one at the origin."""
        behind, ahead = (int(np.ceil(reach / self.size - 0.5)) for reach in self.length)
        return behind, ahead, int(np.ceil(0.5 * self.width / self.size - 0.5))

    def heights(self) -> Array:
        """Heights of the tops above the plane [m], (along, across)."""
        behind, ahead, side = self.counts
        shape = (behind + ahead + 1, 2 * side + 1)
        rng = np.random.default_rng(self.seed)
        heights = rng.uniform(-self.height, self.height, shape)
        along, across = self.size * np.arange(-behind, ahead + 1), self.size * np.arange(-side, side + 1)
        near = np.maximum(np.abs(along)[:, None], np.abs(across)[None, :]) <= self.level + 0.5 * self.size
        return np.where(near, 0.0, heights)


@dataclass(frozen=True)
class Terrain:
    """A plane through the world's origin, or stones along it."""

    slope: float = 0.0  # [rad], inclination; 0 for level ground
    heading: float = 0.0  # [rad], about the world's z from x: the direction in which it rises
    friction: float = 0.8  # Coulomb friction coefficient between the feet and it
    stones: Stones | None = None  # on it; None for the bare plane. With stones there is no plane.
    softness: float = 0.0  # time constant of its contacts [s]; 0 for the hardest that the simulation's timestep allows

    def __post_init__(self) -> None:
        if not abs(self.slope) <= np.deg2rad(60.0):
            raise ModelError(f"terrain slope must lie within ±60°, got {np.rad2deg(self.slope):.1f}°")

    @property
    def rotation(self) -> Array:
        """Smallest rotation from level to this plane, (3, 3); its last column is the normal, in world axes."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        c, s = np.cos(self.slope), np.sin(self.slope)
        tilt = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])  # rises along x: the normal leans towards -x
        return np.asarray(turn @ tilt @ turn.T)

    @property
    def normal(self) -> Array:
        """Unit normal in world axes, (3,)."""
        return self.rotation[:, 2]

    def clearance(self, points: ArrayLike) -> Array:
        """Height of points (..., 3) [m] above the ground, along its normal; infinite where there is none."""
        local = np.asarray(points, dtype=float) @ self.rotation
        if self.stones is None:
            return np.asarray(local[..., 2])
        behind, _, side = self.stones.counts
        heights = np.pad(self.stones.heights(), 1, constant_values=np.nan)
        index = np.rint(local[..., :2] / self.stones.size).astype(int) + np.array([behind + 1, side + 1])
        index = np.clip(index, 0, np.array(heights.shape) - 1)
        tops = heights[index[..., 0], index[..., 1]]
        return np.where(np.isnan(tops), np.inf, local[..., 2] - tops)
