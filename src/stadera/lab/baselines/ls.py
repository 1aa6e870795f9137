"""A baseline: plain least squares of the trunk's ten parameters over the last two seconds.

    θ = argmin Σ |A θ - b|²,

with equal weights for all rows, forces in N and moments in N·m, and no other unknowns. Rows are computed for each
sample from central differences of the velocities, and averaged over 40 ms (25 Hz), which is exact for accelerated
motion. Nothing older than two seconds is used, so a payload is the difference of two estimates two seconds apart. The
covariance is the textbook's, σ² (Σ AᵀA)⁻¹ with σ² the residuals' variance, at least that of a thousandth of the weight.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from stadera.errors import StaderaError
from stadera.lab.baselines.signals import SignalBaseline
from stadera.legs.base_wrench import LegMotions
from stadera.robot.imu import ImuMount, force_at_origin
from stadera.robot.model import Robot
from stadera.trunk.model import TrunkModel
from stadera.trunk.samples import Samples
from stadera.types import Array


class LeastSquaresTrunk(SignalBaseline):
    """Plain least squares over a sliding window [s]; an `Estimator`. Rows are averaged over `block` [s]; `hint` is the
    prior's weight as a share of the information, which affects only directions without any; `least_blocks` of six rows
    are needed.
    """

    def __init__(
        self,
        robot: Robot,
        start: TrunkModel | None = None,
        window: float = 2.0,
        block: float = 0.04,
        mount: ImuMount | None = None,
        hint: float = 1e-10,
        least_blocks: int = 5,
    ) -> None:
        super().__init__(robot, start, block, window, mount)
        self._hint, self._least = hint, least_blocks
        if not window >= least_blocks * block:
            raise StaderaError(f"a window must hold at least {least_blocks} blocks of {block} s, got {window} s")
        self._kept: deque[tuple[Array, Array]] = deque(maxlen=round(window / block))

    def _motion(self, samples: Samples) -> tuple[LegMotions, Array]:
        """The motion at every sample, n of them."""
        inside, columns = samples[1:-1], self._regressor.columns
        span = (samples.time[2:] - samples.time[:-2])[:, None]
        alpha = (samples.angular_velocity[2:] - samples.angular_velocity[:-2]) / span
        joint_rate = (samples.velocity[2:] - samples.velocity[:-2]) / span
        specific = force_at_origin(inside.specific_force, inside.angular_velocity, self._lever, alpha)
        up = specific.mean(axis=0)
        motion = LegMotions(
            inside.position[:, columns],
            inside.velocity[:, columns],
            joint_rate[:, columns],
            inside.angular_velocity.T,
            alpha.T,
            specific.T,
            np.tile(up[:, None] / np.linalg.norm(up), len(inside)),
        )
        return motion, inside.effort[:, columns]

    def _learn(self, matrix: Array, target: Array, elapsed: float) -> tuple[Array, Array]:
        self._kept.append((matrix, target))
        if len(self._kept) < self._least:
            return np.zeros(4), np.full((4, 4), np.nan)
        A, b = (np.concatenate(rows) for rows in zip(*self._kept, strict=True))
        A, b = A * self._scale, b - A @ self._prior()
        normal = A.T @ A
        inverse = np.linalg.inv(normal + self._hint * np.trace(normal) * np.eye(10))
        step = inverse @ (A.T @ b)
        theta = self._prior() + self._scale * step
        residual, scale = b - A @ step, self._scale[:4]
        variance = float(residual @ residual) / (len(b) - 10) + self._floor
        return self._centre(theta, variance * np.outer(scale, scale) * inverse[:4, :4])
