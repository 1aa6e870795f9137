"""The baselines: least squares over a window, recursive least squares, and a published Kalman filter."""

from __future__ import annotations

from collections import deque
from math import exp

import numpy as np

from stadera.body import Motion
from stadera.lab.baselines.signals import SignalBaseline
from stadera.robot.imu import ImuMount, force_at_origin
from stadera.robot.model import Robot
from stadera.trunk.load import centre_slope
from stadera.trunk.model import TrunkModel
from stadera.trunk.samples import Samples
from stadera.types import Array


class LeastSquaresTrunk(SignalBaseline):
    """Plain least squares of the trunk's ten parameters over the last two seconds.

        θ = argmin Σ |A θ - b|²,

    with equal weights for all rows, forces in N and moments in N·m, and no other unknowns. Rows are computed for each
    sample from central differences of the velocities, and averaged over 40 ms (25 Hz), which is exact for accelerated
    motion. Nothing older is used, so a payload is the difference of two estimates two seconds apart. The covariance is
    the textbook's, σ² (Σ AᵀA)⁻¹ with σ² the residuals' variance, at least that of a thousandth of the weight.
    """

    block, settled = 0.04, 2.0  # [s]; the window is as long as the latter
    hint = 1e-10  # weight of the prior as a share of the information, for directions without information
    least_blocks = 5  # of six rows

    def __init__(self, robot: Robot, start: TrunkModel | None = None, mount: ImuMount | None = None) -> None:
        super().__init__(robot, start, mount)
        self._kept: deque[tuple[Array, Array]] = deque(maxlen=round(self.settled / self.block))

    def _motion(self, samples: Samples) -> tuple[Motion, Array]:
        """The motion at every sample, n of them."""
        inside = samples[1:-1]
        span = (samples.time[2:] - samples.time[:-2])[:, None]
        alpha = (samples.angular_velocity[2:] - samples.angular_velocity[:-2]) / span
        joint_rate = (samples.velocity[2:] - samples.velocity[:-2]) / span
        specific = force_at_origin(inside.specific_force, inside.angular_velocity, self._lever, alpha)
        up = specific.mean(axis=0)
        motion = Motion(
            inside.position,
            inside.velocity,
            joint_rate,
            inside.angular_velocity,
            alpha,
            specific,
            up / np.linalg.norm(up),
        )
        return motion, inside.effort

    def _learn(self, matrix: Array, target: Array, elapsed: float) -> tuple[Array, Array]:
        self._kept.append((matrix, target))
        if len(self._kept) < self.least_blocks:
            return np.zeros(4), np.full((4, 4), np.nan)
        A, b = (np.concatenate(rows) for rows in zip(*self._kept, strict=True))
        A, b = A * self._scale, b - A @ self._prior()
        normal = A.T @ A
        inverse = np.linalg.inv(normal + self.hint * np.trace(normal) * np.eye(10))
        step = inverse @ (A.T @ b)
        theta = self._prior() + self._scale * step
        residual, scale = b - A @ step, self._scale[:4]
        variance = float(residual @ residual) / (len(b) - 10) + self._floor
        return self._centre(theta, variance * np.outer(scale, scale) * inverse[:4, :4])


class RlsTrunk(SignalBaseline):
    """Recursive least squares on the trunk's ten parameters with constant forgetting.

        K = P Aᵀ (λ 1 + A P Aᵀ)⁻¹,     θ ← θ + K (b - A θ),     P ← (P - K A P) / λ,     λ = exp(-block / memory)

    with equal weights for all rows, forces in N and moments in N·m, as in textbooks. The covariance is σ² P with σ² the
    exponentially weighted mean square of the residuals, at least that of a thousandth of the weight.
    """

    memory = 1.0  # [s]
    settled = 3.0 * memory
    first = 1e3  # initial P, in units of the robot's mass and leg's length [1]

    def __init__(self, robot: Robot, start: TrunkModel | None = None, mount: ImuMount | None = None) -> None:
        super().__init__(robot, start, mount)
        self._theta, self._P = self._prior().copy(), self.first * np.diag(self._scale**2)
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


class KalmanTrunk(SignalBaseline):
    """A Kalman filter on [m, m cx, m cy] of the trunk from contact forces, a random walk at 100 Hz.

    After Haack et al., Adaptive Model-Based Control of Quadrupeds via Online System Identification using Kalman Filter
    (2025, arXiv 2506.13432), whose noise is kept, R of force and moment and Q a step. The other seven parameters are
    the model's:

        x = (m, m cx, m cy),   y = b - A_rest θ_rest,   H = A[:, :3];   P ← P + Q,   K = P Hᵀ (H P Hᵀ + R)⁻¹, ...

    The published filter treats the robot as one body; here the legs' inertia is included, which can only help it. The
    height of the centre of mass is not estimated.
    """

    measurement_noise: Array = np.diag([1e3, 1e3, 1e4, 1e4, 1e4, 1e3])  # R [N², N²m²]
    process_noise: Array = np.diag([5e-3, 5e-4, 5e-4])  # Q [kg², kg²m²]
    first = 0.3  # initial standard deviation, in units of the robot's mass and leg's length; not published [1]

    def __init__(self, robot: Robot, start: TrunkModel | None = None, mount: ImuMount | None = None) -> None:
        super().__init__(robot, start, mount)
        self._theta = self._prior().copy()
        length = self._length
        self._P = np.diag((self.first * robot.mass * np.array([1.0, length, length])) ** 2)

    def _learn(self, matrix: Array, target: Array, elapsed: float) -> tuple[Array, Array]:
        self._P = self._P + elapsed / self.block * self.process_noise
        H = matrix[:, :3]
        PH = self._P @ H.T
        gain = np.linalg.solve(H @ PH + self.measurement_noise, PH.T).T
        self._theta[:3] += gain @ (target - matrix @ self._theta)
        self._P = (np.eye(3) - gain @ H) @ self._P
        if not self._theta[0] > 0:
            return np.array([self._theta[0], 0.0, 0.0, 0.0]), np.zeros((4, 4))
        slope = centre_slope(self._theta[:4])[:, :3]
        covariance = slope @ self._P @ slope.T
        covariance[3, :] = covariance[:, 3] = np.nan
        return np.array([self._theta[0], *self._theta[1:4] / self._theta[0]]), covariance
