"""A baseline: recursive least squares on the trunk's ten parameters with constant forgetting.

    K = P Aᵀ (λ 1 + A P Aᵀ)⁻¹,     θ ← θ + K (b - A θ),     P ← (P - K A P) / λ

with equal weights for all rows, forces in N and moments in N·m, as in textbooks. The covariance is σ² P with σ² the
exponentially weighted mean square of the residuals, at least that of a thousandth of the weight.
"""

from __future__ import annotations

from math import exp

import numpy as np

from stadera.errors import StaderaError
from stadera.lab.baselines.signals import SignalBaseline
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.model import TrunkModel
from stadera.types import Array


class RlsTrunk(SignalBaseline):
    """Recursive least squares; an `Estimator`. λ = exp(-block / memory), both in [s]; `first` is the initial P in units
    of the robot's mass and leg's length.
    """

    def __init__(
        self,
        robot: Robot,
        start: TrunkModel | None = None,
        memory: float = 1.0,
        block: float = 0.01,
        mount: ImuMount | None = None,
        first: float = 1e3,
    ) -> None:
        if not memory > 0:
            raise StaderaError(f"a memory must be positive, got {memory} s")
        super().__init__(robot, start, block, 3.0 * memory, mount)
        self.memory = memory
        self._theta, self._P = self._prior().copy(), first * np.diag(self._scale**2)
        self._square = self._weight = 0.0

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
        return self._centre(self._theta, (self._square / self._weight + self._floor) * self._P[:4, :4])
