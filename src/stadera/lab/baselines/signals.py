"""Base of the baselines that weigh a moving robot: rows from signals averaged over ten milliseconds.

Positions, velocities, torques, angular velocity and specific force are averaged over a block, accelerations are the
differences of the velocities over it, and the exact rows A θ = b (`stadera.body.tree`) are computed from these:
the usual way, in which signals are filtered first. The ground is assumed level, at the surface of the feet's spheres.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from stadera.body import Body, Motion
from stadera.constants import GRAVITY
from stadera.inertia import InertialParameters
from stadera.robot.imu import ImuMount, force_at_origin
from stadera.robot.model import Robot
from stadera.trunk.load import centre_slope
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import ImplausibleError, TrunkBounds, TrunkModel
from stadera.trunk.protocol import Status, StepEstimator, TrunkEstimate, unobserved
from stadera.trunk.result import ObservedLimits
from stadera.trunk.samples import SampleBuffer, Samples
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.wrench import trunk_matrix, trunk_signals
from stadera.types import Array


class SignalBaseline(StepEstimator):
    """An estimator that computes rows from averaged signals; subclasses solve them."""

    block = 0.01  # averaging time of the signals [s]
    settled = 5.0  # time of data after which it counts as converged [s]
    least_residual = 1e-3  # least standard deviation of the residuals, as a share of the robot's weight [1]

    def __init__(self, robot: Robot, start: TrunkModel | None = None, mount: ImuMount | None = None) -> None:
        self.robot, self.bounds = robot, TrunkBounds.of(robot)
        self._start = self.bounds.check(start or TrunkModel.prior(robot))
        self._body, self._length = Body.of(robot, others=False), robot.leg_length
        length = self._length
        self._lever = (mount or ImuMount.of(robot)).translation
        self._buffer = SampleBuffer(robot.tree.joints, TrunkSettings(block=self.block))
        self._first = np.nan
        self._scale = robot.mass * np.array([1.0, *[length] * 3, *[length**2] * 6])
        self._limit = ObservedLimits().centre(robot.mass, length)
        self._floor = (self.least_residual * robot.mass * GRAVITY) ** 2
        self._now = TrunkEstimate(np.nan, self._start, unobserved(), Status.WAITING)

    def update(self, measurement: Measurement) -> None:
        """Processes one measurement; the estimate changes when a block is full."""
        table = self._buffer.gather(measurement)
        if table is not None:
            self._take(table)

    def add(self, samples: Samples | Sequence[Measurement]) -> None:
        """Processes any number of samples, equivalent to as many calls of `update`."""
        self._take((samples if isinstance(samples, Samples) else Samples.of(samples)).table)

    def _take(self, table: Array) -> None:
        for stretch in self._buffer.take(table):
            if stretch.reason:
                self._refuse(stretch.reason)
            for block in stretch.blocks:
                self._block(Samples.of_table(block, len(self.robot.tree.joints)))

    def estimate(self) -> TrunkEstimate:
        """The latest estimate; after a refusal the last good one, with the reason."""
        return self._now

    @abstractmethod
    def _learn(self, matrix: Array, target: Array, elapsed: float) -> tuple[Array, Array]:
        """Processes a block's rows (6, 10), (6,); returns mass and centre of mass (4,), and their covariance (4, 4)."""

    def _centre(self, theta: Array, covariance: Array) -> tuple[Array, Array]:
        """Mass, centre of mass (4,) and covariance (4, 4), NaN where not observed, from mass and first moment."""
        if not theta[0] > 0:
            return np.array([theta[0], 0.0, 0.0, 0.0]), np.zeros((4, 4))
        slope = centre_slope(theta[:4])
        covariance = slope @ covariance @ slope.T
        unknown = ~(np.sqrt(np.diag(covariance)) < self._limit)
        covariance[unknown, :] = covariance[:, unknown] = np.nan
        return np.array([theta[0], *theta[1:4] / theta[0]]), covariance

    def _block(self, samples: Samples) -> None:
        matrix, target, elapsed = self._rows(samples)
        if not np.isfinite(target).all():
            self._refuse("a leg is so stretched that its foot's force is not felt")
            return
        value, covariance = self._learn(matrix, target, elapsed)
        seen = np.isfinite(np.diag(covariance))
        value = np.where(seen, value, [self._start.mass, *self._start.com_trunk])
        try:
            trunk = self.bounds.check(TrunkModel(float(value[0]), value[1:], self._start.inertia_com))
        except ImplausibleError as error:
            self._refuse(f"the estimate runs away: {error}")
            return
        time = float(samples.time[-2])
        if np.isnan(self._first):
            self._first = time
        status = Status.CONVERGED if time - self._first >= self.settled else Status.MOVING
        self._now = TrunkEstimate(time, trunk, covariance, status)

    def _rows(self, samples: Samples) -> tuple[Array, Array, float]:
        """A (6, 10) and b (6,) of a block, and its duration [s]."""
        motion, effort = self._motion(samples)
        state = self._body.at(motion)
        target = self._body.target(state, self._body.left(state, motion, effort)).mean(axis=0)
        signals = trunk_signals(motion.specific_force.T, motion.angular_velocity.T, motion.angular_acceleration.T)
        return trunk_matrix(signals.mean(axis=-1)), target, float(samples.time[-1] - samples.time[1])

    def _motion(self, samples: Samples) -> tuple[Motion, Array]:
        """The motion used for rows, and the efforts (n, joints): here the block's mean motion, n = 1."""
        inside = samples[1:-1]
        span = float(samples.time[-1] - samples.time[0])
        alpha = (samples.angular_velocity[-1] - samples.angular_velocity[0]) / span
        joint_rate = (samples.velocity[-1] - samples.velocity[0]) / span
        omega = inside.angular_velocity.mean(axis=0)
        specific = force_at_origin(inside.specific_force.mean(axis=0), omega, self._lever, alpha)
        motion = Motion(
            inside.position.mean(axis=0)[None],
            inside.velocity.mean(axis=0)[None],
            joint_rate[None],
            omega[None],
            alpha[None],
            specific[None],
            specific / np.linalg.norm(specific),
        )
        return motion, inside.effort.mean(axis=0)[None]

    def _refuse(self, reason: str) -> None:
        now = self._now
        self._now = TrunkEstimate(now.time, now.trunk, now.covariance, Status.REFUSED, reason)

    def _prior(self) -> Array:
        """The ten parameters of the start, (10,)."""
        inertia = self._start.inertia_com
        if inertia is None:
            inertia = self.robot.inertias[self.robot.trunk].inertia_com
        return InertialParameters.from_com(self._start.mass, self._start.com_trunk, inertia).vector
