"""A baseline: a Kalman filter on [m, m cx, m cy] of the trunk from contact forces, a random walk at 100 Hz.

After Haack et al., Adaptive Model-Based Control of Quadrupeds via Online System Identification using Kalman Filter
(2025, arXiv 2506.13432), whose noise is kept: measurement noise R = diag(1e3, 1e3, 1e4, 1e4, 1e4, 1e3) [N², N²m²] of
force and moment, process noise Q = diag(0.005, 0.0005, 0.0005) a step. The other seven parameters are the model's:

    x = (m, m cx, m cy),   y = b - A_rest θ_rest,   H = A[:, :3];   P ← P + Q,   K = P Hᵀ (H P Hᵀ + R)⁻¹, ...

The published filter treats the robot as one body; here the legs' inertia is included, which can only help it.
"""

from __future__ import annotations

import numpy as np

from stadera.lab.baselines.signals import SignalBaseline
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.load import centre_slope
from stadera.trunk.model import TrunkModel
from stadera.types import Array

MEASUREMENT_NOISE: Array = np.diag([1e3, 1e3, 1e4, 1e4, 1e4, 1e3])
PROCESS_NOISE: Array = np.diag([5e-3, 5e-4, 5e-4])


class KalmanTrunk(SignalBaseline):
    """The published Kalman filter, as an `Estimator` without an estimate of the centre of mass' height. `step`:
    averaging time of the signals, to which the published process noise refers [s]; `settled`: time after which the
    initial state has no influence [s]; `first`: initial standard deviation in units of the robot's mass and leg's
    length, not published.
    """

    def __init__(
        self,
        robot: Robot,
        start: TrunkModel | None = None,
        mount: ImuMount | None = None,
        step: float = 0.01,
        settled: float = 5.0,
        first: float = 0.3,
    ) -> None:
        super().__init__(robot, start, step, settled, mount)
        self._step = step
        self._theta = self._prior().copy()
        length = self._regressor.length
        self._P = np.diag((first * robot.mass * np.array([1.0, length, length])) ** 2)

    def _learn(self, matrix: Array, target: Array, elapsed: float) -> tuple[Array, Array]:
        self._P = self._P + elapsed / self._step * PROCESS_NOISE
        H = matrix[:, :3]
        PH = self._P @ H.T
        gain = np.linalg.solve(H @ PH + MEASUREMENT_NOISE, PH.T).T
        self._theta[:3] += gain @ (target - matrix @ self._theta)
        self._P = (np.eye(3) - gain @ H) @ self._P
        if not self._theta[0] > 0:
            return np.array([self._theta[0], 0.0, 0.0, 0.0]), np.zeros((4, 4))
        slope = centre_slope(self._theta[:4])[:, :3]
        covariance = slope @ self._P @ slope.T
        covariance[3, :] = covariance[:, 3] = np.nan
        return np.array([self._theta[0], *self._theta[1:4] / self._theta[0]]), covariance
