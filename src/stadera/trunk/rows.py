"""Rows of a moving robot: six equations every 20 ms, filtered over short blocks, and the effect of model errors on
them.

Each sample gives six rows that hold exactly (`stadera.legs.base_wrench`). Their mean over two blocks, weighted by

    w_k ∝ 1 - cos(2π k / n),

is the output of one block. The window is zero at both ends, so accelerations can be filtered by parts. One block's
falling half is the next one's rising half, so each is summed once.

With E the wrench of a unit of h - τ, K = ∂(inertial wrench)/∂a and L = ∂(inertial wrench)/∂α of the whole robot with
the feet held, G = ∂b/∂q̈, an error p of the model (`stadera.trunk.error_model`) adds C p to the left side of A θ = b::

    rotor, friction, offset    -E q̈, -E q̇, -E s, -E       s: smoothed sign of q̇, of velocities averaged over a block
    gain, lag of the torques   -E τ, +E τ̇                  true torque: (1 - g) τ + d τ̇
    stiction                   ∓E √(1 - s²)                what holds a joint at standstill, positive upwards
    encoder, contact           +∂b/∂q, -∂b/∂p_contact      at the block's middle, by differences and in closed form
    link mass and centre       -∂b/∂(m, c)                 `BaseWrenchRegressor.by_links`
    IMU place, axes, bias      -K ([α]x + [ω]x[ω]x), K [a]x + L [α]x, -K
    response of the IMU        -K diag(a - ā)               ā: average over a second, turned with the trunk
    lag of the velocities      G q⃛ + L α̇
    sampling                   half the difference of A θ - b between odd and even samples, times one

G, L, K of the legs are found by feeding each acceleration alone at the block's last posture.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from stadera.constants import GRAVITY, SINGULAR
from stadera.inertia import InertialParameters, skew
from stadera.legs.base_wrench import BaseWrenchRegressor, LegMotions, LegWrenches
from stadera.legs.extra_wrench import extra_wrench
from stadera.legs.friction import direction
from stadera.legs.model import cross
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.trunk.calibration import SignalCalibration
from stadera.trunk.equations import Equations
from stadera.trunk.error_model import ERRORS, PLACES
from stadera.trunk.ground import turned
from stadera.trunk.noise import WhiteNoise
from stadera.trunk.samples import Samples
from stadera.trunk.settings import SwingDetection
from stadera.trunk.wrench import (
    trunk_matrix,
    trunk_signals,
    wrench_of_angular_acceleration,
    wrench_of_specific_force,
)
from stadera.types import Array, Bools

_OTHERS = np.ones((4, 4)) - np.eye(4)
_STANDING = 0.05  # smoothing factor of each foot's usual height, for blocks in which it is loaded
_STEP = 1e-4  # rad, of the differences by joint positions
_PROBES = 10  # 3 specific forces, 3 angular accelerations, 3 joint accelerations, and all zero
_MIDDLES = 4  # the block's middle sample as it is, and with each joint of all legs moved by a step
_OVERLAP = 4.0 / 3.0  # 1 + 2 ρ: neighbouring windows share samples, ρ = 1/6 for what is averaged
_TELESCOPED = 0.5  # ρ = -1/2 for what is differentiated: between the least of one block and the nothing of a long sum
_MOVES = 3.0  # times its noise: root mean square of the velocity of a joint that moves
RESOLVED = 3
"""Least number of samples in a block whose differences tell sampling errors: motion of 12 Hz enters these by 3 % with
three samples a block, by 20 % with two, and fully with one (the window's response at half the rate less 12 Hz).
"""
LATELY = 25  # blocks, over which that is taken: a joint that turns back is not one that stands

_TERMS = ("rotor", "viscous", "coulomb", "offset", "gain", "stiction")
_UNIT = np.eye(3)


@dataclass(frozen=True, eq=False)
class SwingRows:
    """A window's rows in joint space, for legs in the air: see `stadera.trunk.swing.SwingJoints.add`."""

    air: Bools
    terms: Array
    rate: Array
    residual: Array


@dataclass(frozen=True, eq=False)
class BlockRows(Equations):
    """Six rows A θ + C p = b from two neighbouring blocks.

    Attributes:
        time: of the last sample [s]. elapsed: since the previous block [s].
        columns: (6, 10 + 1 + ERRORS), of A, b [N, N·m] and C.
        white: (6,), variances of the white noise.
        swing: rows in joint space.
    """

    time: float
    elapsed: float
    columns: Array
    white: Array
    swing: SwingRows


class BlockResult(NamedTuple):
    """Result of processing one block.

    Attributes:
        rows: of the window that the block completes; None for the first block of a stretch.
        feet, force: (3, 4) [m, N], at its end, trunk axes.
        singular: index of a leg so near-singular that its foot's force is not determined.
    """

    rows: BlockRows | None
    feet: Array
    force: Array
    singular: int | None = None


@dataclass(frozen=True, eq=False)
class _Half:
    """Half a window, from one block: sums weighted by its rising and falling halves, and constants."""

    time: Array
    rising: _Sums
    falling: _Sums
    probes: Array  # (6, 9, legs)
    middle: Array  # (6, encoder 12 + contact 12), their errors' effect at its middle
    angular_velocity: Array
    air: Bools
    averaged: float  # Σ w²
    differentiated: float  # see `half_differences` [1/s²]


@dataclass(frozen=True, eq=False)
class _Sums:
    """Weighted sums over a block."""

    signals: Array  # (12,)
    target: Array  # (6,)
    by_terms: Array  # (6, 12, terms): E times q̈, q̇, s, 1, τ and √(1 - s²)
    by_rate: Array  # (6,): E τ̇
    by_links: Array  # (6, 48)
    jerk: Array  # (15,)
    joint: Array  # (6, 12): q̈, q̇, s, 1, τ̇, h - τ
    squared: Array  # (6, 6), Σ w² E σ² Eᵀ of white torque noise
    alternating: Array  # (18,): signals and target, with signs that alternate from sample to sample

    def __add__(self, other: _Sums) -> _Sums:
        return _Sums(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))


class RowMaker:
    """Converts blocks of samples into rows.

    Args:
        robot: the model.
        mount: of the IMU, for its lever; the samples are in trunk axes.
        swing: criteria for a swinging leg.

    Attributes:
        regressor: regressor of the legs.
        noise: white noise of all channels, estimated from the log.
        weight: of the robot [N]. flat: least det J [m³]. extra: joints outside the legs; None for none.
    """

    def __init__(self, robot: Robot, mount: ImuMount, swing: SwingDetection) -> None:
        self.regressor, self._lever, self._swing = BaseWrenchRegressor(robot), mount.translation, swing
        self.noise = WhiteNoise.prior(robot, self.regressor.columns)
        self.weight, self.extra = robot.mass * GRAVITY, robot.extra
        self.flat = SINGULAR * self.regressor.length**3
        self._half: _Half | None = None
        self._sign = 1.0  # of alternating sums: goes on from block to block, also where these have odd numbers
        self.known, self.known_std = np.zeros((3, 4, 3)), np.zeros((3, 4, 3))  # see `Front.know_joints`
        self._standing = np.zeros(4)  # m, by how much each foot's centre lies higher than the others' when it carries
        self._calibration = SignalCalibration()
        self._speeds: deque[Array] = deque(maxlen=LATELY)  # squared, over the noise's variance

    def restart(self) -> None:
        """Discards the unfinished window: the next samples do not continue the previous ones."""
        self._half = None

    def forget(self) -> None:
        """Also discards the history of the motion: the trunk's rotation until the next samples is unknown."""
        self.restart()
        self._calibration = SignalCalibration()

    def block(self, samples: Samples, normal: Array, trunk: InertialParameters) -> BlockResult:
        """Processes one block.

        Args:
            samples: of the block, with one sample more before and after it.
            normal: (3,), of the ground, trunk axes.
            trunk: parameters at which errors of the IMU are linearised.
        """
        n = len(samples) - 2
        motion, torque_rate, jerk = self._motion(samples, normal)
        wrenches = self.regressor.at(motion)
        flat = np.abs(wrenches.volume) < self.flat
        if flat.any():
            self.restart()
            return BlockResult(None, wrenches.feet[:, n - 1], np.zeros((3, 4)), int(np.argmax(flat.any(axis=0))))
        self.noise.learn(samples, self.regressor.columns)
        effort = np.zeros((n + _PROBES + _MIDDLES, 4, 3))
        effort[:n] = samples.effort[1:-1][:, self.regressor.columns]
        effort[n + _PROBES :] = effort[n // 2]
        by_leg, force = wrenches.target(effort), wrenches.forces(effort)
        half = self._summed(samples, motion, wrenches, effort, by_leg, force, torque_rate, jerk)
        if self.extra is not None and samples.extra.size:
            self._take_out(half, self.extra_wrench(samples))
        rows = None if self._half is None else self._rows(self._half, half, trunk)
        self._half = half
        self._sign *= 1.0 - 2.0 * (n % 2)
        return BlockResult(rows, wrenches.feet[:, n - 1], force[:, n - 1])

    def extra_wrench(self, samples: Samples) -> Array:
        """What the joints outside the legs add by moving, (6, n), see `stadera.legs.extra_wrench`."""
        extra = self.extra
        assert extra is not None
        k = len(extra.joints)
        position, velocity = samples.extra[1:-1, :k], samples.extra[1:-1, k:]
        span = (samples.time[2:] - samples.time[:-2])[:, None]
        acceleration = (samples.extra[2:, k:] - samples.extra[:-2, k:]) / span
        return extra_wrench(extra, position, velocity, acceleration, *self._trunk_motion(samples))

    def _take_out(self, half: _Half, wrench: Array) -> None:
        """Subtracts a wrench (6, n) from the target of both halves."""
        rising = half_window(wrench.shape[1])
        half.rising.target[:] -= wrench @ rising
        half.falling.target[:] -= wrench @ rising[::-1]

    def _trunk_motion(self, samples: Samples) -> tuple[Array, Array, Array]:
        """Angular velocity, angular acceleration and specific force of the trunk's origin, each (3, n)."""
        span = (samples.time[2:] - samples.time[:-2])[:, None]
        omega = samples.angular_velocity[1:-1].T
        alpha = ((samples.angular_velocity[2:] - samples.angular_velocity[:-2]) / span).T
        lever = self._lever[:, None]
        specific = samples.specific_force[1:-1].T - cross(alpha, lever) - cross(omega, cross(omega, lever))
        return omega, alpha, specific

    def _motion(self, samples: Samples, normal: Array) -> tuple[LegMotions, Array, Array]:
        """Motion of a block: the motion itself with the probes at its last posture and the middles; the rates of the
        torques (n, 4, 3); and the rates of the joints' and the trunk's accelerations (n, 15).
        """
        n, columns = len(samples) - 2, self.regressor.columns
        more = _PROBES + _MIDDLES
        span = (samples.time[2:] - samples.time[:-2])[:, None]
        rates = [(v[2:] - v[:-2]) / span for v in (samples.velocity, samples.effort)]
        inside = slice(1, -1)
        omega, alpha, specific = self._trunk_motion(samples)
        position, velocity, acceleration = (np.zeros((n + more, 4, 3)) for _ in range(3))
        position[:n], velocity[:n] = samples.position[inside][:, columns], samples.velocity[inside][:, columns]
        acceleration[:n] = rates[0][:, columns]
        position[n : n + _PROBES] = position[n - 1]
        trunk = np.zeros((3, 3, n + more))
        trunk[0, :, :n], trunk[1, :, :n], trunk[2, :, :n] = omega, alpha, specific
        trunk[2, :, n : n + 3] = trunk[1, :, n + 3 : n + 6] = _UNIT
        acceleration[n + 6 : n + 9] = _UNIT[:, None, :]
        k, at = n // 2, n + _PROBES
        position[at:], velocity[at:], acceleration[at:] = position[k], velocity[k], acceleration[:n].mean(axis=0)
        position[at + 1 :] += _STEP * _UNIT[:, None, :]
        trunk[:, :, at:] = trunk[:, :, k : k + 1]
        normals = np.broadcast_to(normal[:, None], (3, n + more))
        motion = LegMotions(
            position, velocity, acceleration, trunk[0], trunk[1], trunk[2], normals, _fitted(velocity, n)
        )
        turning = np.hstack([samples.velocity[:, columns.ravel()], samples.angular_velocity])
        jerk = (turning[2:] - 2.0 * turning[1:-1] + turning[:-2]) / (0.5 * span) ** 2
        return motion, rates[1][:, columns], jerk

    def _summed(
        self,
        samples: Samples,
        motion: LegMotions,
        wrenches: LegWrenches,
        effort: Array,
        by_leg: Array,
        force: Array,
        torque_rate: Array,
        jerk: Array,
    ) -> _Half:
        n = len(samples) - 2
        E = wrenches.to_wrench[:, :n].reshape(6, n, 12)
        assert motion.sliding is not None
        sure = direction(motion.sliding[:n]).reshape(n, 12)
        acceleration, velocity = motion.acceleration[:n].reshape(n, 12), motion.velocity[:n].reshape(n, 12)
        one, tau, rate = np.ones((n, 12)), effort[:n].reshape(n, 12), torque_rate.reshape(n, 12)
        stuck = np.sqrt(np.maximum(1.0 - sure * sure, 0.0))
        terms = np.stack([acceleration, velocity, sure, one, tau, stuck], axis=-1)  # (n, 12, terms)
        left = wrenches.torque[:n].reshape(n, 12) - tau
        joint = np.stack([acceleration, velocity, sure, one, rate, left], axis=1)  # (n, 6, 12)
        signals = trunk_signals(
            motion.specific_force[:, :n], motion.angular_velocity[:, :n], motion.angular_acceleration[:, :n]
        )
        target, by_rate = by_leg[:, :n].sum(axis=2), (E * rate).sum(axis=2)
        rising = half_window(n)
        # both halves at once: rising weights first
        weights = np.stack([rising, rising[::-1]])
        signs = 1.0 - 2.0 * (np.arange(n) % 2)
        alternating = weights * np.stack([signs[::-1], -signs])  # + at a block's end, - where the next one begins
        links = self.regressor.by_links(wrenches, weights)
        weighted = E * weights[:, None, :, None]
        noisy = (weighted * self.noise.torque).reshape(2, 6, -1)
        by_terms = weighted.transpose(0, 3, 1, 2) @ terms.transpose(1, 0, 2)  # (2, 12, 6, terms)
        halves = (
            weights @ signals.T,
            weights @ target.T,
            by_terms.transpose(0, 2, 1, 3),
            weights @ by_rate.T,
            links,
            weights @ jerk,
            (weights @ joint.reshape(n, -1)).reshape(2, 6, 12),
            noisy @ noisy.transpose(0, 2, 1),
            alternating @ np.vstack([signals, target]).T,
        )
        sums = [_Sums(*(part[k] for part in halves)) for k in range(2)]
        step = (samples.time[-2] - samples.time[1]) / (n - 1) if n > 1 else 0.02
        probes = by_leg[:, n : n + 9] - by_leg[:, n + 9 : n + 10]
        return _Half(
            time=samples.time[1:-1],
            rising=sums[0],
            falling=sums[1],
            probes=probes,
            middle=self._middle(wrenches, by_leg, force, n),
            angular_velocity=samples.angular_velocity[1:-1].mean(axis=0),
            air=self._in_the_air(wrenches, force, motion, n, step),
            averaged=float(rising @ rising),
            differentiated=half_differences(n) / step**2,
        )

    def _middle(self, wrenches: LegWrenches, by_leg: Array, force: Array, n: int) -> Array:
        """Derivatives (6, 24) of b by each joint's position and each contact point's position, at the middle of the
        block.

        Moving the point of application of f by δ changes joint torque k by s_k · (δ x f) = (f x s_k) · δ and the moment
        on the trunk by δ x f.
        """
        at = n + _PROBES
        by_position = (by_leg[:, at + 1 :] - by_leg[:, at : at + 1]) / _STEP  # (6, joint, leg)
        f, s, E = force[:, at], wrenches.axis[:, at], wrenches.to_wrench[:, at]  # (3, leg), (3, leg, joint), (6, ...)
        turning = cross(f[:, :, None], s).transpose(1, 2, 0)  # (leg, joint, 3)
        by_contact = -(E.transpose(1, 0, 2) @ turning).transpose(1, 0, 2)
        by_contact[3:] -= cross(f[:, :, None], _UNIT[:, None])
        return np.hstack([by_position.transpose(0, 2, 1).reshape(6, 12), by_contact.reshape(6, 12)])

    def _in_the_air(self, wrenches: LegWrenches, force: Array, motion: LegMotions, n: int, step: float) -> Bools:
        """Legs (4,) whose foot is off the ground and lightly loaded throughout the block, while the others carry the
        robot; see `SwingDetection`.

        A foot is off the ground if it is higher than the others, or moves relative to them. Feet that stand have the
        same velocity -v relative to the trunk, once the trunk's rotation is taken out: ω x p + J q̇ = -v. Accelerations
        are differences of noisy velocities; in averages over consecutive samples these cancel but for the first and
        the last, so what a foot seems to carry depends little on the log's rate. The limit allows for the joints'
        uncertainty with the accelerations of single samples, so it is somewhat higher in a noisy log at 1 kHz.
        """
        assert motion.sliding is not None
        swing = self._swing
        E, feet, omega = wrenches.to_wrench[:3, :n], wrenches.feet[:, :n], motion.angular_velocity[:, :n]
        moved = np.array([motion.acceleration[:n], motion.velocity[:n], direction(motion.sliding[:n])])
        force = force[:, :n] + (E * (self.known[:, None] * moved).sum(axis=0)).sum(axis=-1)
        torque = np.square(self.known_std[:, None] * moved).sum(axis=0)
        unsure = (np.square(E) * torque).sum(axis=(0, -1))  # (n, 4), of the force squared
        arm = feet[..., None] - wrenches.links.joints[:, :n]
        pace = cross(omega[..., None], feet) + (cross(wrenches.axis[:, :n], arm) * motion.velocity[:n]).sum(axis=-1)
        normal = motion.normal[:, :n, None]
        parts = min(max(round(n * step / swing.part), 1), n)
        seen = np.concatenate([force, pace, (feet * normal).sum(axis=0)[None], unsure[None]])
        begin = np.arange(parts) * n // parts
        seen = np.add.reduceat(seen, begin, axis=1) / np.diff(np.append(begin, n))[:, None]
        force, pace, height, unsure = seen[:3], seen[3:6], seen[6] - self._standing, seen[7]
        limit = np.minimum((swing.load * self.weight) ** 2 + unsure, self.weight**2)
        light = np.square(force).sum(axis=0) < limit
        along = np.einsum("cnl,c->nl", force, motion.normal[:, 0])
        pressed = np.maximum(along, 0.0)
        share = np.maximum(pressed @ _OTHERS, 1e-9)
        carried, lifted = along @ _OTHERS, height - (pressed * height) @ _OTHERS / share
        pace = pace - (pressed * pace) @ _OTHERS / share
        up = lifted > swing.lift * self.regressor.length
        moves = np.square(pace).sum(axis=0) > swing.speed**2 * GRAVITY * self.regressor.length
        stands = ((along > swing.load * self.weight) & ~up).all(axis=0)
        self._standing += _STANDING * np.where(stands, lifted.mean(axis=0), 0.0)
        return np.asarray(((up | moves) & light & (carried > swing.carried * self.weight)).all(axis=0))

    def _rows(self, first: _Half, second: _Half, trunk: InertialParameters) -> BlockRows:
        total = first.rising + second.falling
        averaged, differentiated = first.averaged + second.averaged, first.differentiated + second.differentiated
        probes, noise = 0.5 * (first.probes + second.probes), self.noise
        elapsed = float(second.time[-1] - first.time[-1])
        imu = np.repeat([averaged * noise.accelerometer**2, differentiated * noise.gyro**2], 3)
        imu[:3] += imu[3] * (self._lever @ self._lever)
        turn = turned(second.angular_velocity, elapsed)
        signals, removed = self._calibration.calibrated(total.signals, imu, turn, elapsed)
        own_a = wrench_of_specific_force(trunk.mass, trunk.first_moment)
        own_alpha = wrench_of_angular_acceleration(trunk.first_moment, trunk.inertia)
        K = own_a - probes[:, :3].sum(axis=2)
        L = own_alpha - probes[:, 3:6].sum(axis=2)
        G = probes[:, 6:9].transpose(0, 2, 1).reshape(6, 12)  # by leg and joint
        columns = np.zeros((6, 11 + ERRORS))
        columns[:, :10], columns[:, 10], C = trunk_matrix(signals), total.target, columns[:, 11:]
        for term, name in enumerate(_TERMS):
            C[:, PLACES[name]] = -total.by_terms[:, :, term]
        # signs such that positive static friction lifts the trunk, as in all joints of a robot that sags
        C[:, PLACES["stiction"]] *= np.sign(total.signals[:3] @ total.by_terms[:3, :, _TERMS.index("offset")])
        # noise is not motion: a joint that moved beyond it does not stick, another shows no friction or rotor inertia
        self._speeds.append(total.joint[1] ** 2 / (averaged * noise.velocity**2))
        still = np.mean(self._speeds, axis=0) < _MOVES**2
        for name in ("rotor", "viscous", "coulomb"):
            C[:, PLACES[name]] *= ~still
        C[:, PLACES["stiction"]] *= still
        C[:, PLACES["torque_lag"]] = total.by_rate[:, None]
        C[:, PLACES["common_gain"]] = C[:, PLACES["gain"]].sum(axis=1, keepdims=True)
        middle = 0.5 * (first.middle + second.middle)
        C[:, PLACES["encoder"]], C[:, PLACES["contact"]] = middle[:, :12], -middle[:, 12:]
        C[:, PLACES["link_mass"]], C[:, PLACES["link_com"]] = -total.by_links[:, :12], -total.by_links[:, 12:]
        a, alpha, spin = total.signals[:3], total.signals[3:6], _squared(total.signals[6:])
        C[:, PLACES["imu_lever"]] = -K @ (skew(alpha) + spin)
        C[:, PLACES["imu_rotation"]] = K @ skew(a) + L @ skew(alpha)
        C[:, PLACES["accelerometer"]] = -K
        C[:, PLACES["imu_response"]] = -K * (signals[:3] - self._calibration.average)
        C[:, PLACES["velocity_lag"]] = (L @ total.jerk[12:] - G @ total.jerk[:12])[:, None]
        C[:, PLACES["regression"]] = own_alpha * removed
        alternating = trunk_matrix(total.alternating[:12]) @ trunk.vector - total.alternating[12:]
        C[:, PLACES["sampling"].start] = self._sign * alternating * (len(second.time) >= RESOLVED)
        L_noise = L + K @ skew(self._lever)
        white = _OVERLAP * (total.squared + averaged * noise.accelerometer**2 * (K @ K.T))
        white += _TELESCOPED * differentiated * (noise.gyro**2 * (L_noise @ L_noise.T))
        white += _TELESCOPED * differentiated * ((G * noise.velocity) @ (G * noise.velocity).T)
        return BlockRows(
            time=float(second.time[-1]),
            elapsed=elapsed,
            columns=columns,
            white=np.diagonal(white),
            swing=SwingRows(first.air & second.air, total.joint[:4], total.joint[4], total.joint[5]),
        )


def _squared(products: Array) -> Array:
    """[ω]x [ω]x (3, 3) = ω ωᵀ - ω² 1, from the six products of ω."""
    xx, xy, xz, yy, yz, zz = products
    outer = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.asarray(outer - (xx + yy + zz) * np.eye(3))


def _fitted(velocity: Array, n: int) -> Array:
    """Replaces the first n velocities (samples, 4, 3) by a fitted line each; the rest are unchanged."""
    out = velocity.copy()
    along = np.arange(n) - 0.5 * (n - 1)
    slope = np.tensordot(along, velocity[:n], 1) / max(along @ along, 1.0)
    out[:n] = velocity[:n].mean(axis=0) + along[:, None, None] * slope
    return out


@lru_cache(maxsize=64)
def half_window(n: int) -> Array:
    """The rising half of a raised cosine over 2 n samples, its sum one half."""
    window: Array = (1.0 - np.cos(np.pi * (np.arange(n) + 0.5) / n)) / (2.0 * n)
    return window


@lru_cache(maxsize=64)
def half_differences(n: int) -> float:
    """Half the variance of Σ w_k (x_k+1 - x_k-1) / 2 over 2 n samples for white noise x of unit variance: the sum of
    squares of (w_k-1 - w_k+1) / 2 over the rising half, w zero outside.
    """
    w = np.concatenate([np.zeros(2), half_window(n), half_window(n)[-1:]])
    return float((0.25 * (w[2:] - w[:-2]) ** 2).sum())
