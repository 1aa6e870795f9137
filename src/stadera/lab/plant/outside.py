"""External forces on the trunk other than a load: a person who pushes or lifts, a rope, a wall.

With n the direction of the force, p the point of the trunk where it acts and p_0 its position when the force began,

    f = s n max(0, F - k n · (p - p_0))        s = 1 between begin and end, with ramps

k = 0 is a constant force: a person, or a weight on a rope over a pulley. k > 0 with n out of a wall models leaning on
the wall, with n towards the other end a rope. Both yield on one side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError
from stadera.types import Array


@dataclass(frozen=True)
class OutsideForce:
    """An external force on the trunk.

    Attributes:
        size: F [N], not negative.
        direction: n, world axes; any nonzero length.
        at: point of application [m], trunk frame.
        begin, end: times [s].
        stiffness: k [N/m], not negative.
        ramp: time to rise and to fall [s].

    Raises:
        ModelError: a value is not finite or out of its range.
    """

    size: float
    direction: tuple[float, float, float]
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    begin: float = 0.0
    end: float = float("inf")
    stiffness: float = 0.0
    ramp: float = 0.1

    def __post_init__(self) -> None:
        numbers = (self.size, *self.direction, *self.at, self.begin, self.stiffness, self.ramp)
        positive = min(self.size, self.stiffness) >= 0 and self.ramp > 0 and self.end > self.begin
        if not (np.isfinite(numbers).all() and positive and np.any(self.direction)):
            raise ModelError(f"an outside force needs finite sizes, a direction and a time, got {self}")

    def force(self, time: float, moved: Array) -> Array:
        """Force (3,) [N], world axes.

        Args:
            time: [s].
            moved: (3,) p - p_0 [m], world axes.
        """
        share = max(0.0, min((time - self.begin) / self.ramp, (self.end - time) / self.ramp, 1.0))
        n = np.asarray(self.direction) / np.linalg.norm(self.direction)
        return np.asarray(n * share * max(0.0, self.size - self.stiffness * float(n @ moved)))
