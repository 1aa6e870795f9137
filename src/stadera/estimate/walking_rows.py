"""Rows of a walking robot, filtered over short blocks: six equations every 20 ms, and the noise that is left in them.

Each sample gives six rows that hold exactly (`stadera.regressors.base_wrench`). Their mean over two blocks, weighted by

    w_k ∝ 1 - cos(2π k / n),

is what one block gives: it begins and ends with zero, so that accelerations are filtered by parts, and one block's
falling half is the next one's rising half, so that each is summed once. The half-way point lies one block back.

Beside the ten parameters a row has columns for what is constant and unknown:

    A θ - E o + E τ̇ d - K β - B r + (L α̇ - G q⃛) e = b

o: torque offsets, τ measured = τ + o. d: lag of the torques, τ measured(t) = τ(t - d). β: accelerometer bias,
a measured = a + β, with K = ∂(inertial wrench of the whole robot, feet held)/∂a. r: how much further down than the
model's soles the ground touches, with B = ∂b/∂r. e: lag of the velocities' differences behind all else, half a step
where torques are those that acted up to the sample, more where drives smooth their velocities.

The white noise of what is averaged (Σ w² of a sample's) and of what is differentiated (Σ ẇ²)::

    E Στ Eᵀ Σw² + K Σa Kᵀ Σw² + (G Σq̇ Gᵀ + L Σω Lᵀ) Σẇ² + (lever of the feet's forces) Σq Σw²

with G = ∂b/∂q̈ and L = -∂(b - A θ)/∂α, found by feeding each acceleration alone at the block's last posture.

**Friction.** Its direction is that of the joints' velocities fitted by a line over the block, which are less noisy than
a sample's. Where a joint sticks, friction is whatever holds it: with t = tanh(v / v_s), c² (1 - t²) is added to the
variance of its torque, the same for as long as a joint may stick, so not less in many blocks than in a few.

What the torques' gains, the legs' masses, their centres and friction are off by is not sought; its effect B on the rows
is handed on (`stadera.regressors.base_wrench`), by columns of one standard deviation each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.walking_excitation import Excitation
from stadera.estimate.walking_ground import turned
from stadera.estimate.walking_noise import WalkingNoise
from stadera.estimate.walking_samples import Samples
from stadera.estimate.walking_unknowns import BIAS, LAG, OFFSETS, RATES, SOLE, THETA, UNKNOWNS
from stadera.estimate.walking_window import Half, fitted, spread
from stadera.inertia import InertialParameters, skew
from stadera.regressors.base_wrench import STICTION_VELOCITY, BaseWrenchRegressor, LegMotions, LegWrenches, cross
from stadera.regressors.trunk_wrench import (
    trunk_matrix,
    trunk_signals,
    wrench_of_angular_acceleration,
    wrench_of_specific_force,
)
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot

Array = NDArray[np.float64]

_STUCK = 0.1  # s, over which friction that holds a joint counts as the same
_PROBES = 10  # 3 specific forces, 3 angular accelerations, 3 joint accelerations, and nothing at all
_OVERLAP = 4.0 / 3.0  # 1 + 2 ρ: neighbouring windows share samples, ρ = 1/6 for what is averaged
_TELESCOPED = 0.5  # ρ = -1/2 for what is differentiated: between the least of one block and the nothing of a long sum
_SINGULAR = 0.01  # of det J, as a share of the cubed length of the leg


@dataclass(frozen=True, eq=False)
class BlockRows:
    """What two neighbouring blocks say together, six rows.

    Attributes:
        time: [s], of the last sample in it. elapsed: [s], since the block before.
        matrix: (6, 28), see `UNKNOWNS`; the columns of bias and velocities' lag are the legs' part alone.
        target: (6,) [N, N·m].
        noise: (6, 6), white, without the trunk's own part in what IMU noise does.
        averaged, differentiated: Σ w² and Σ ẇ² [1/s²].
        by_angular_acceleration: (6, 3), the legs' part of L.
        jerk: (3,) [rad/s³], α̇.
        considered: (6, 12), or (6, 72) where the model is doubted: see `ALWAYS`; more by `about`.
        doubtful: (3,) [rad/s²], what of the angular acceleration may be noise or more motion than it was taken for.
        sliding: (12,) of each joint, -1 to 1: how surely it slides, and which way; zero without dry friction.
        lever: (3,) [m], of the IMU: noise in α moves what is taken for the trunk's specific force, by lever x α.
    """

    time: float
    elapsed: float
    matrix: Array
    target: Array
    noise: Array
    averaged: float
    differentiated: float
    by_angular_acceleration: Array
    jerk: Array
    considered: Array
    doubtful: Array
    sliding: Array
    lever: Array

    def about(self, trunk: InertialParameters, noise: WalkingNoise) -> tuple[Array, Array, Array]:
        """Matrix (6, 28), covariance (6, 6), and what is considered (6, q), for a trunk about as believed."""
        K = wrench_of_specific_force(trunk.mass, trunk.first_moment) - self.matrix[:, BIAS]
        own = wrench_of_angular_acceleration(trunk.first_moment, trunk.inertia)
        L = own + self.by_angular_acceleration + K @ skew(self.lever)
        matrix = self.matrix.copy()
        matrix[:, BIAS] = -K
        matrix[:, RATES] += L @ self.jerk
        covariance = self.noise + (_OVERLAP * self.averaged * noise.accelerometer**2) * (K @ K.T)
        covariance += (_TELESCOPED * self.differentiated * noise.gyro**2) * (L @ L.T)
        return matrix, covariance, np.hstack([own * self.doubtful, self.considered])


class BlockResult(NamedTuple):
    """What a block came to.

    Attributes:
        rows: of the window that it completes; None for the first block of a stretch.
        feet, force: (3, 4) [m, N], at its end, trunk axes.
        singular: index of a leg that is so stretched that its foot's force is not felt.
    """

    rows: BlockRows | None
    feet: Array
    force: Array
    singular: int | None = None


class RowMaker:
    """Turns blocks of samples into rows.

    Args:
        robot: whose legs are believed in.
        noise: of the sensors.
        mount: of the IMU; the samples' specific force lacks α x its lever.
    """

    def __init__(self, robot: Robot, noise: WalkingNoise, mount: ImuMount) -> None:
        self.regressor, self.noise, self._lever = BaseWrenchRegressor(robot), noise, mount.translation
        self._flat = _SINGULAR * self.regressor.length**3
        self._links = np.repeat([noise.link_mass, noise.link_com], [12, 36])
        self._doubts, self._dry = noise.doubts_model, bool(self.regressor.coulomb.any())
        self._rising: Half | None = None
        self._excitation = Excitation()

    def restart(self) -> None:
        """Forgets the half-finished window: what comes next does not follow on."""
        self._rising = None

    def forget(self) -> None:
        """Forgets how the trunk has moved as well: nobody saw how it turned until what comes next."""
        self.restart()
        self._excitation = Excitation()

    def block(self, samples: Samples, normal: Array) -> BlockResult:
        """Takes in one block.

        Args:
            samples: of the block, with one sample more before and after it.
            normal: (3,), of the ground, trunk axes.
        """
        n = len(samples) - 2
        motion, torque_rate, jerk = self._motion(samples, normal)
        wrenches = self.regressor.at(motion)
        flat = np.abs(wrenches.volume) < self._flat
        if flat.any():
            self.restart()
            return BlockResult(None, wrenches.feet[:, n - 1], np.zeros((3, 4)), int(np.argmax(flat.any(axis=0))))
        inside = slice(1, -1)
        effort = np.zeros((n + _PROBES, 4, 3))
        effort[:n] = samples.effort[inside][:, self.regressor.columns]
        by_leg = wrenches.target(effort)
        probes = by_leg[:, n:-1] - by_leg[:, -1:]
        E = wrenches.to_wrench
        columns = np.empty((n, 12 + 6 + 72 + 6 + 6 + 15 + 12 + 12))
        columns[:, :12] = trunk_signals(motion[5][:, :n], motion[3][:, :n], motion[4][:, :n]).T
        columns[:, 12:18] = by_leg[:, :n].sum(axis=2).T
        columns[:, 18:90] = E[:, :n].transpose(1, 0, 2, 3).reshape(n, 72)
        columns[:, 90:96] = (E[:, :n] * torque_rate).sum(axis=(2, 3)).T
        force = wrenches.forces(effort)
        columns[:, 96:102] = wrenches.by_contact(force, -motion.normal)[:, :n].T
        columns[:, 102:117], columns[:, 117:129] = jerk, self._slides(motion, n)
        columns[:, 129:] = effort[:n].reshape(n, 12)
        force = force[:, :n]
        omega = samples.angular_velocity[inside].mean(axis=0)
        noise = self._noise(probes, force, wrenches, n)
        by_links = self.regressor.by_links(wrenches, n).reshape(n, -1) if self._doubts else None
        half = Half.of(samples.time[inside], columns, E[:, :n], noise, probes, omega, by_links)
        rows = None if self._rising is None else self._rows(self._rising, half)
        self._rising = half
        return BlockResult(rows, wrenches.feet[:, n - 1], force[:, -1])

    def _motion(self, samples: Samples, normal: Array) -> tuple[LegMotions, Array, Array]:
        """The block's motion, followed by the probes at its last posture; the torques' rates (n, 4, 3), and the rates
        of the joints' and the trunk's accelerations (n, 15).
        """
        n, columns = len(samples) - 2, self.regressor.columns
        span = (samples.time[2:] - samples.time[:-2])[:, None]
        rates = [(v[2:] - v[:-2]) / span for v in (samples.velocity, samples.angular_velocity, samples.effort)]
        inside = slice(1, -1)
        omega, alpha = samples.angular_velocity[inside].T, rates[1].T
        specific = samples.specific_force[inside].T - cross(alpha, self._lever)
        position, velocity, acceleration = (np.zeros((n + _PROBES, 4, 3)) for _ in range(3))
        position[:n], velocity[:n] = samples.position[inside][:, columns], samples.velocity[inside][:, columns]
        position[n:], acceleration[:n] = position[n - 1], rates[0][:, columns]
        trunk = np.zeros((3, 3, n + _PROBES))
        trunk[0, :, :n], trunk[1, :, :n], trunk[2, :, :n] = omega, alpha, specific
        trunk[2, :, n : n + 3] = trunk[1, :, n + 3 : n + 6] = np.eye(3)
        acceleration[n + 6 : n + 9] = np.eye(3)[:, None, :]
        normals = np.broadcast_to(normal[:, None], (3, n + _PROBES))
        sliding = fitted(velocity, n) if self._dry else None
        motion = LegMotions(position, velocity, acceleration, trunk[0], trunk[1], trunk[2], normals, sliding)
        turning = np.hstack([samples.velocity[:, columns.ravel()], samples.angular_velocity])
        jerk = (turning[2:] - 2.0 * turning[1:-1] + turning[:-2]) / (0.5 * span) ** 2
        return motion, rates[2][:, columns], jerk

    def _slides(self, motion: LegMotions, n: int) -> Array | float:
        """(n, 12): how surely each joint slides, and which way, -1 to 1."""
        if motion.sliding is None:
            return 0.0
        return np.tanh(motion.sliding[:n] / STICTION_VELOCITY).reshape(n, 12)

    def _noise(self, probes: Array, force: Array, wrenches: LegWrenches, n: int) -> tuple[Array, Array]:
        """(6, 6) each, of one sample: from the joints' velocities per Σẇ², from positions per Σw²."""
        G = probes[:, 6:9].reshape(6, -1)
        moved = wrenches.to_wrench[:, n - 1]  # a lever's error turns and shifts the force: f x (p' - p), as J δq
        foot = np.linalg.norm(wrenches.feet[:, n - 1], axis=0) * np.linalg.norm(force[:, -1], axis=0)
        P = (moved * foot[:, None]).reshape(6, -1)
        return G @ G.T, P @ P.T

    def _rows(self, rising: Half, falling: Half) -> BlockRows:
        noise, up, down = self.noise, rising.rising, falling.falling
        columns = up @ rising.columns + down @ falling.columns
        matrix = np.empty((6, UNKNOWNS))
        E = columns[18:90].reshape(6, 12)
        matrix[:, OFFSETS], matrix[:, LAG], matrix[:, SOLE] = -E, columns[90:96], -columns[96:102]
        probes = 0.5 * (rising.probes + falling.probes)  # (6, probes, leg)
        matrix[:, RATES] = -np.einsum("ijl,lj->i", probes[:, 6:9], columns[102:114].reshape(4, 3))
        matrix[:, BIAS] = probes[:, :3].sum(axis=2)
        averaged = float(up @ up + down @ down)
        differentiated = rising.differentiated + falling.differentiated
        imu = np.repeat([averaged * noise.accelerometer**2, differentiated * noise.gyro**2], 3)
        imu[:3] += imu[3] * (self._lever @ self._lever)
        elapsed = float(falling.time[-1] - rising.time[-1])
        turn = turned(falling.angular_velocity, elapsed)
        signals, doubtful = self._excitation.calibrated(columns[:12], imu, turn, elapsed)
        matrix[:, THETA] = trunk_matrix(signals)
        torque = spread(rising.to_wrench, up, noise.torque) + spread(falling.to_wrench, down, noise.torque)
        sure, c = columns[117:129], self.regressor.coulomb.ravel()
        if self._dry:
            stuck = E * (c * np.sqrt(np.maximum(1.0 - sure * sure, 0.0)))
            torque = torque + (_STUCK / max(elapsed, 1e-3)) * (stuck @ stuck.T)
        velocity, position = (0.5 * (a + b) for a, b in zip(rising.noise, falling.noise, strict=True))
        covariance = _OVERLAP * (torque + averaged * noise.joint_position**2 * position)
        covariance += _TELESCOPED * differentiated * noise.joint_velocity**2 * velocity
        return BlockRows(
            time=float(falling.time[-1]),
            elapsed=elapsed,
            matrix=matrix,
            target=columns[12:18],
            noise=covariance,
            averaged=averaged,
            differentiated=differentiated,
            by_angular_acceleration=-probes[:, 3:6].sum(axis=2),
            jerk=columns[114:117],
            considered=self._considered(rising, falling, E * columns[129:], E * (c * sure)),
            doubtful=doubtful,
            sliding=sure,
            lever=self._lever,
        )

    def _considered(self, rising: Half, falling: Half, torque: Array, friction: Array) -> Array:
        gains = self.noise.torque_gain * torque
        if rising.by_links is None or falling.by_links is None:
            return gains
        by_links = (rising.rising @ rising.by_links + falling.falling @ falling.by_links).reshape(6, 48)
        return np.hstack([gains, self._links * by_links, self.noise.friction * friction])
