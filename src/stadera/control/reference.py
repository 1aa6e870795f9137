"""Where the trunk is to be: a pose, and smooth moves from one to the next."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stadera.errors import ModelError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TrunkPose:
    """A pose of the trunk in the odometry frame, and how fast it is passed.

    Attributes:
        position: (3,) [m], of the trunk's origin.
        rotation: (3, 3), of the trunk in the world.
        velocity: (3,) [m/s].
        angular_velocity: (3,) [rad/s], in the pose's own axes.
    """

    position: Array
    rotation: Array
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    angular_velocity: Array = field(default_factory=lambda: np.zeros(3))

    @cached_property
    def at_rest(self) -> bool:
        """Whether it is not moving."""
        return not (self.velocity.any() or self.angular_velocity.any())

    def moved(self, shift: Array, turn: Array) -> TrunkPose:
        """At rest, shifted by (3,) [m] in the odometry frame and turned by the rotation vector (3,) [rad] in its own
        axes.
        """
        return TrunkPose(self.position + shift, self.rotation @ Rotation.from_rotvec(turn).as_matrix())


@dataclass(frozen=True, eq=False)
class Move:
    """A straight move between two poses at rest, about one axis, along a quintic s(t) with s, ṡ, s̈ continuous.

    Attributes:
        start, goal: the poses.
        begin: [s]. duration: [s], positive.

    Raises:
        ModelError: a duration that is not positive, a goal that is not at rest.
    """

    start: TrunkPose
    goal: TrunkPose
    begin: float
    duration: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise ModelError(f"a move's duration must be positive, got {self.duration} s")
        if not self.goal.at_rest:
            raise ModelError("a move's goal must be a pose at rest")
        turn = Rotation.from_matrix(self.start.rotation.T @ self.goal.rotation).as_rotvec()
        object.__setattr__(self, "_turn", turn)

    def at(self, time: float) -> TrunkPose:
        """Where to be at a time [s]."""
        x = (time - self.begin) / self.duration
        if x >= 1.0:
            return self.goal
        x = max(x, 0.0)
        s = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        rate = 30.0 * x * x * (1.0 - x) ** 2 / self.duration
        way = self.goal.position - self.start.position
        turn: Array = self._turn  # type: ignore[attr-defined]
        return TrunkPose(
            self.start.position + s * way,
            self.start.rotation @ Rotation.from_rotvec(s * turn).as_matrix(),
            rate * way,
            rate * turn,
        )
