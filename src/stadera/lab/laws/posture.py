"""The trunk's control law, which approach (b) needs to know (`stadera.lab.laws.orientation`)."""

from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError, positive
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class PostureLaw:
    """Parameters of the trunk controller that approach (b) needs.

    Attributes:
        stiffness: (3,) [N·m/rad], K about the trunk's axes.
        reference: (3, 3), R_d, of the trunk in the world.
        frequency: ω [rad/s], and
        damping: ζ, of the trunk's response in roll and pitch.
        lag: with which a new estimate is used [s].
        gain_margin: of the loop of posture and estimate [1]; 4 is 12 dB.
        feeds_back: True if the controller uses this estimate; else it keeps the estimator's initial one.

    Raises:
        ModelError: wrong shape, values that are not positive, or a reference that is not a rotation.
    """

    stiffness: Array
    reference: Array
    frequency: float = 16.0
    damping: float = 0.8
    lag: float = 0.05
    feeds_back: bool = True
    gain_margin: float = 4.0

    def __post_init__(self) -> None:
        stiffness = np.array(self.stiffness, dtype=float)
        if stiffness.shape != (3,) or not (np.isfinite(stiffness).all() and (stiffness > 0).all()):
            raise ModelError(f"a posture's stiffness needs three positive numbers, got {self.stiffness}")
        object.__setattr__(self, "stiffness", stiffness)
        object.__setattr__(self, "reference", rotation_of(self.reference))
        for name in ("frequency", "damping", "gain_margin"):
            positive(f"a posture's {name}", getattr(self, name), error=ModelError)
        if not (np.isfinite(self.lag) and self.lag >= 0):
            raise ModelError(f"a posture's lag must not be negative, got {self.lag} s")

    def fastest_settling(self, period: float) -> float:
        """Shortest settling time [s] with the gain margin, for an update every `period` [s]."""
        if not self.feeds_back:
            return 0.0
        lag = self.lag + period  # half a period held, half a period from averaging
        spring, damper = self.frequency**2, 2.0 * self.damping * self.frequency
        a3 = 1.0 + damper * lag
        most = (a3 * (damper + spring * lag) - spring * lag) / a3**2
        return 3.0 * self.gain_margin / most


def rotation_of(matrix: Array) -> Array:
    rotation = np.array(matrix, dtype=float)
    if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
        raise ModelError("a posture's reference must be a rotation matrix (3, 3)")
    return rotation
