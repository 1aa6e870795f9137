"""A baseline: recursive least squares on the trunk's ten parameters with constant forgetting.

    K = P Aᵀ (λ 1 + A P Aᵀ)⁻¹,     θ ← θ + K (b - A θ),     P ← (P - K A P) / λ

all rows alike, forces in N and moments in N·m, as the textbook has it. Its covariance is σ² P with σ² the residuals'
forgetting mean square, and a thousandth of the weight at least.
"""

from __future__ import annotations

from math import exp

import numpy as np
from numpy.typing import NDArray

from stadera.errors import StaderaError
from stadera.estimate.baseline import SignalBaseline
from stadera.estimate.trunk import TrunkModel
from stadera.estimate.walking_result import centre_slope, known_to
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot

Array = NDArray[np.float64]

_LEAST_RESIDUAL = 1e-3  # of the robot's weight
_FIRST = 1e3  # the first P, in units of the robot's mass and leg's length


class RlsTrunk(SignalBaseline):
    """Recursive least squares; an `Estimator`.

    Args:
        robot, start, mount: as for `SignalBaseline`.
        memory: time constant of forgetting [s]: λ = exp(-block / memory).
        block: [s].

    Raises:
        StaderaError: a memory that is not positive; and what `SignalBaseline` raises.
    """

    def __init__(
        self,
        robot: Robot,
        start: TrunkModel | None = None,
        memory: float = 1.0,
        block: float = 0.01,
        mount: ImuMount | None = None,
    ) -> None:
        if not memory > 0:
            raise StaderaError(f"a memory must be positive, got {memory} s")
        super().__init__(robot, start, block, 3.0 * memory, mount)
        self.memory = memory
        length = self._regressor.length
        self._limit = known_to(robot.mass, length)[:4]
        scale = robot.mass * np.array([1.0, *[length] * 3, *[length**2] * 6])
        self._theta, self._P = self._prior().copy(), _FIRST * np.diag(scale**2)
        self._square = self._weight = 0.0
        self._floor = (_LEAST_RESIDUAL * robot.mass * 9.81) ** 2

    def _learn(self, matrix: Array, target: Array, elapsed: float) -> tuple[Array, Array]:
        keep = exp(-elapsed / self.memory)
        PA = self._P @ matrix.T
        gain = np.linalg.solve(keep * np.eye(6) + matrix @ PA, PA.T).T
        self._theta = self._theta + gain @ (target - matrix @ self._theta)
        P = (self._P - gain @ PA.T) / keep
        self._P = 0.5 * (P + P.T)
        residual = target - matrix @ self._theta
        self._square = keep * self._square + float(residual @ residual)
        self._weight = keep * self._weight + 6.0
        if not self._theta[0] > 0:
            return np.array([self._theta[0], 0.0, 0.0, 0.0]), np.zeros((4, 4))
        slope = centre_slope(self._theta[:4])
        covariance = (self._square / self._weight + self._floor) * (slope @ self._P[:4, :4] @ slope.T)
        unknown = ~(np.sqrt(np.diag(covariance)) < self._limit)
        covariance[unknown, :] = covariance[:, unknown] = np.nan
        return np.array([self._theta[0], *self._theta[1:4] / self._theta[0]]), covariance
