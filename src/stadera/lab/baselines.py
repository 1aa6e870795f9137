"""Estimators from the literature, for comparison; `ALL_METHODS` contains them and the library's own.

Positions, velocities, torques, angular velocity and specific force are averaged over a block, accelerations are the
differences of the velocities over it, and the exact rows A θ = b (`stadera.body.tree`) are computed from these:
the usual way, in which signals are filtered first. The ground is assumed level, at the surface of the feet's spheres.
"""

from abc import abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import exp
from types import MappingProxyType

import numpy as np

from stadera.body import Body, Motion
from stadera.constants import GRAVITY
from stadera.inertia import InertialParameters
from stadera.robot.imu import ImuMount, force_at_origin
from stadera.robot.model import Robot
from stadera.trunk.load import centre_slope
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import ImplausibleError, TrunkBounds, TrunkModel
from stadera.trunk.protocol import RUNS_AWAY, Status, StepEstimator, TrunkEstimate, unobserved
from stadera.trunk.registry import METHODS, Method
from stadera.trunk.result import ObservedLimits
from stadera.trunk.samples import SampleBuffer, Samples
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.wrench import trunk_matrix, trunk_signals
from stadera.types import Array


class SignalBaseline(StepEstimator):
    """An estimator that computes rows from averaged signals; subclasses solve them."""

    block = 0.01  # averaging time of the signals [s]
    each_sample = False  # rows of each sample, averaged over the block, instead of rows of the block's mean motion
    settled = 5.0  # time of data after which it counts as converged [s]
    least_residual = 1e-3  # least standard deviation of the residuals, as a share of the robot's weight [1]

    def __init__(self, robot: Robot, start: TrunkModel | None = None, mount: ImuMount | None = None) -> None:
        self.robot, self.bounds = robot, TrunkBounds.of(robot)
        self._start = self.bounds.check(start or TrunkModel.prior(robot))
        self._body, length = Body.of(robot, others=False), robot.leg_length
        self._lever = (mount or ImuMount.of(robot)).translation
        self._buffer = SampleBuffer(robot.tree.joints, TrunkSettings(block=self.block))
        self._first = np.nan
        self._scale = robot.mass * np.array([1.0, *[length] * 3, *[length**2] * 6])
        self._limit = ObservedLimits().centre(robot.mass, length)
        self._floor = (self.least_residual * robot.mass * GRAVITY) ** 2
        inertia = self._start.inertia_com
        if inertia is None:
            inertia = robot.inertias[robot.trunk].inertia_com
        self._prior = InertialParameters.from_com(self._start.mass, self._start.com_trunk, inertia).vector
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
            for begin, end in pairwise(stretch.edges):
                self._block(Samples.of_table(stretch.table[begin : end + 2], len(self.robot.tree.joints)))

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
            self._refuse(f"{RUNS_AWAY}: {error}")
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
        contacts = self._body.contacts(state, self._body.left(state, motion, effort))
        target = self._body.target(state, contacts).mean(axis=0)
        signals = trunk_signals(motion.specific_force.T, motion.angular_velocity.T, motion.angular_acceleration.T)
        return trunk_matrix(signals.mean(axis=-1)), target, float(samples.time[-1] - samples.time[1])

    def _motion(self, samples: Samples) -> tuple[Motion, Array]:
        """The motion used for rows, and the efforts, (n, ...) each."""
        inside, each = samples[1:-1], self.each_sample
        before, after = (samples[:-2], samples[2:]) if each else (samples[:1], samples[-1:])
        span = (after.time - before.time)[:, None]
        alpha = (after.angular_velocity - before.angular_velocity) / span
        joint_rate = (after.velocity - before.velocity) / span
        signals = (inside.position, inside.velocity, inside.angular_velocity, inside.specific_force, inside.effort)
        q, rate, omega, felt, effort = (values if each else values.mean(axis=0)[None] for values in signals)
        specific = force_at_origin(felt, omega, self._lever, alpha)
        up = specific.mean(axis=0)
        return Motion(q, rate, joint_rate, omega, alpha, specific, up / np.linalg.norm(up)), effort

    def _refuse(self, reason: str) -> None:
        now = self._now
        self._now = TrunkEstimate(now.time, now.trunk, now.covariance, Status.REFUSED, reason)


class LeastSquaresTrunk(SignalBaseline):
    """Plain least squares of the trunk's ten parameters over the last two seconds.

        θ = argmin Σ |A θ - b|²,

    with equal weights for all rows, forces in N and moments in N·m, and no other unknowns. Rows are computed for each
    sample from central differences of the velocities, and averaged over 40 ms (25 Hz), which is exact for accelerated
    motion. Nothing older is used, so a payload is the difference of two estimates two seconds apart. The covariance is
    the textbook's, σ² (Σ AᵀA)⁻¹ with σ² the residuals' variance, at least that of a thousandth of the weight.
    """

    block, settled, each_sample = 0.04, 2.0, True  # [s]; the window is as long as the time to settle
    hint = 1e-10  # weight of the prior as a share of the information, for directions without information
    least_blocks = 5  # of six rows

    def __init__(self, robot: Robot, start: TrunkModel | None = None, mount: ImuMount | None = None) -> None:
        super().__init__(robot, start, mount)
        self._kept: deque[tuple[Array, Array]] = deque(maxlen=round(self.settled / self.block))

    def _learn(self, matrix: Array, target: Array, elapsed: float) -> tuple[Array, Array]:
        self._kept.append((matrix, target))
        if len(self._kept) < self.least_blocks:
            return np.zeros(4), np.full((4, 4), np.nan)
        A, b = (np.concatenate(rows) for rows in zip(*self._kept, strict=True))
        A, b = A * self._scale, b - A @ self._prior
        normal = A.T @ A
        inverse = np.linalg.inv(normal + self.hint * np.trace(normal) * np.eye(10))
        step = inverse @ (A.T @ b)
        theta = self._prior + self._scale * step
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
        self._theta, self._P = self._prior.copy(), self.first * np.diag(self._scale**2)
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
        self._theta = self._prior.copy()
        self._P = np.diag((self.first * self._scale[:3]) ** 2)

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


def _baseline(summary: str, kind: type[SignalBaseline]) -> Method:
    return Method(f"baseline: {summary}", lambda s: kind(s.robot, s.start, s.mount))


ALL_METHODS: Mapping[str, Method] = MappingProxyType(
    {
        **METHODS,
        "ls": _baseline("plain least squares over two seconds", LeastSquaresTrunk),
        "rls": _baseline("recursive least squares with constant forgetting", RlsTrunk),
        "kalman": _baseline("a Kalman filter on m, m cx, m cy", KalmanTrunk),
    }
)
"""By name."""
