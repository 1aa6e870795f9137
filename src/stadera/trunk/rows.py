"""Rows of a moving robot: six equations every 20 ms, filtered over short blocks, and the effect of model errors on
them.

Each sample gives six rows that hold exactly (`stadera.body.tree`). Their mean over two blocks, weighted by

    w_k ∝ 1 - cos(2π k / n),

is the output of one block. The window is zero at both ends, so accelerations can be filtered by parts. One block's
falling half is the next one's rising half, so each is summed once.

With E the wrench of a unit of h - τ, K = ∂(inertial wrench)/∂a and L = ∂(inertial wrench)/∂α of the whole robot with
the feet held, G = ∂b/∂q̈, an error p of the model (`stadera.trunk.error_model`) adds C p to the left side of A θ = b::

    rotor, friction, offset    -E q̈, -E q̇, -E s, -E       s: smoothed sign of q̇, of velocities averaged over a block
    gain, lag of the torques   -E τ, +E τ̇                  true torque: (1 - g) τ + d τ̇
    stiction                   ∓E √(1 - s²)                what holds a joint at standstill, positive upwards
    encoder, contact           +∂b/∂q, -∂b/∂p_contact      at the block's middle, by differences and in closed form
    link mass and centre       -∂b/∂(m, c)                 of `State.columns` by φ, and of φ by m and c
    IMU place, axes, bias      -K ([α]x + [ω]x[ω]x), K [a]x + L [α]x, -K
    response of the IMU        -K diag(a - ā)               ā: average over a second, turned with the trunk
    lag of the velocities      G q⃛ + L α̇
    sampling                   half the difference of A θ - b between odd and even samples, times one

G, L, K of the legs are found by feeding each acceleration alone at the block's last posture.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stadera.body import Body, Motion, State
from stadera.body.friction import direction
from stadera.constants import GRAVITY, SINGULAR
from stadera.inertia import InertialParameters, skew
from stadera.robot.imu import ImuMount
from stadera.robot.limbs import Place
from stadera.robot.model import Robot
from stadera.trunk.calibration import SignalCalibration
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.ground import turned
from stadera.trunk.lifted import Lifted
from stadera.trunk.limbs import LimbRows, LimbSums, by_mass_and_centre
from stadera.trunk.noise import WhiteNoise
from stadera.trunk.row_kernel import window_sums
from stadera.trunk.samples import Samples
from stadera.trunk.settings import SwingDetection
from stadera.trunk.wrench import (
    trunk_matrix,
    trunk_signals,
    wrench_of_angular_acceleration,
    wrench_of_specific_force,
)
from stadera.types import Array, Bools

_STEP = 1e-4  # rad, of the differences by joint positions
_OVERLAP = 4.0 / 3.0  # 1 + 2 ρ: neighbouring windows share samples, ρ = 1/6 for what is averaged
_TELESCOPED = 0.5  # ρ = -1/2 for what is differentiated: between the least of one block and the nothing of a long sum
_SLIDES = 0.9  # mean of the direction of sliding, between -1 and 1, of a joint that neither stops nor turns back
_MOVES = 3.0  # times its noise: root mean square of the velocity of a joint that moves
_LATELY = 25  # blocks, over which that is taken: a joint that turns back is not one that stands
RESOLVED = 3
"""Least number of samples in a block whose differences tell sampling errors: motion of 12 Hz enters these by 3 % with
three samples a block, by 20 % with two, and fully with one (the window's response at half the rate less 12 Hz).
"""

_TERMS = ("rotor", "viscous", "coulomb", "offset", "gain", "stiction")
_UNIT = np.eye(3)


class Equations:
    """Six rows A θ + C p = b, and those of the limbs.

    Attributes:
        columns: (6, 10 + 1 + errors + 10 loads), of A, b, C and of what a load elsewhere does (`stadera.trunk.limbs`).
        limbs: (joints, the same), of the limbs' joints.
    """

    columns: Array
    limbs: Array | None

    @property
    def matrix(self) -> Array:
        """A (6, 10)."""
        return self.columns[:, :10]

    @property
    def target(self) -> Array:
        """b (6,)."""
        return self.columns[:, 10]

    @property
    def errors(self) -> Array:
        """C (6, errors), then what loads do."""
        return self.columns[:, 11:]


@dataclass(frozen=True, eq=False)
class SwingRows:
    """A window's rows in joint space, for legs in the air: see `stadera.trunk.swing.SwingJoints.add`."""

    air: Bools
    terms: Array
    rate: Array
    residual: Array

    @property
    def sliding(self) -> float:
        """Share of the joints that slide throughout the window [1]."""
        return float((np.abs(self.terms[_TERMS.index("coulomb")]) > _SLIDES).mean())


@dataclass(frozen=True, eq=False)
class BlockRows(Equations):
    """Six rows A θ + C p = b from two neighbouring blocks.

    Attributes:
        time: of the last sample [s]. elapsed: since the previous block [s].
        columns: (6, ...), of A, b [N, N·m], C and loads. limbs: (joints, ...), None if there are none.
        white: (6,), variances of the white noise.
        swing: rows in joint space.
    """

    time: float
    elapsed: float
    columns: Array
    white: Array
    swing: SwingRows
    limbs: Array | None = None


class BlockResult(NamedTuple):
    """Result of processing one block.

    Attributes:
        rows: of the window that the block completes; None for the first block of a stretch.
        feet, force: (legs, 3) [m, N], at its end, trunk axes.
        singular: index of a leg so near-singular that its foot's force is not determined.
    """

    rows: BlockRows | None
    feet: Array
    force: Array
    singular: int | None = None


class _Sums:
    """Weighted sums over a window, by name, of a robot with J joints in its legs and K links:

    plain: of signals (12), target (6), jerk (J + 3), and six numbers of each joint: q̈, q̇, s, 1, τ̇, h - τ.
    by_rate, squared: (6,), of E τ̇, and, with w² for w, of E σ² Eᵀ of white torque noise.
    by_terms, by_links: (J, 6, terms) and (K, 6, 10), of E times q̈, q̇, s, 1, τ and √(1 - s²), and of `State.columns`.
    """

    def __init__(self, layout: ErrorLayout, links: int) -> None:
        J, K = layout.joints, links
        self._shapes: dict[str, tuple[int, ...]] = {"plain": (21 + 7 * J,), "by_rate": (6,), "squared": (6,)}
        self._shapes |= {"by_terms": (J, 6, len(_TERMS)), "by_links": (K, 6, 10)}
        self._joints = 21 + J + J * np.arange(7)

    def zeros(self, halves: int) -> dict[str, Array]:
        """Room for sums over some halves of windows."""
        return {name: np.zeros((halves, *shape)) for name, shape in self._shapes.items()}

    def of(self, first: Mapping[str, Array], second: Mapping[str, Array]) -> dict[str, Array]:
        """The sums over a window, of the rising half of the first block and the falling half of the second."""
        sums = {name: first[name][0] + second[name][1] for name in self._shapes}
        plain, at = sums.pop("plain"), self._joints
        return sums | {
            "signals": plain[:12],
            "target": plain[12:18],
            "jerk": plain[18 : at[0]],
            "joint": plain[at[0] :].reshape(6, -1),
        }


@dataclass(frozen=True, eq=False)
class _Half:
    """Half a window, from one block: sums weighted by its rising and falling halves, and constants."""

    end: float
    samples: int
    sums: Mapping[str, Array]  # (2, ...), see `_Sums`
    alternating: Array  # (2, 18): signals and target, with signs that alternate from sample to sample
    probes: Array  # (6, 6 + J), ∂b/∂(a, α, q̈) of the legs
    middle: Array  # (6, J + contacts), ∂b/∂(q, p_contact)
    angular_velocity: Array
    air: Bools
    limbs: LimbSums | None
    averaged: float  # Σ w²
    differentiated: float  # see `half_differences` [1/s²]


class RowMaker:
    """Converts blocks of samples into rows.

    Args:
        robot: the model.
        mount: of the IMU, for its lever; the samples are in trunk axes.
        swing: criteria for a swinging leg.
        places: links on which a load may be, besides the trunk.

    Attributes:
        body: the robot as a tree. noise: white noise of all channels, estimated from the log.
        lifted: tells legs in the air.
        weight: of the robot [N]. flat: least det J [m³].
    """

    def __init__(self, robot: Robot, mount: ImuMount, swing: SwingDetection, places: tuple[Place, ...] = ()) -> None:
        self._robot, self._lever, self._places = robot, mount.translation, places
        self._layout, length = ErrorLayout.of(robot), robot.leg_length
        self._use(Body.of(robot, others=False))
        self._columns = self.body.in_legs
        self.noise, n = WhiteNoise.prior(robot, self._layout.joints), len(robot.tree.joints)
        imu = 3 * n + np.arange(6)
        self._channels = np.concatenate([2 * n + self._columns, n + self._columns, imu])  # of the noise, among all
        self.weight, self.flat = robot.mass * GRAVITY, SINGULAR * length**3
        self.lifted = Lifted(self.body, swing, self.weight, length)
        self._half: _Half | None = None
        self._sign = 1.0  # of alternating sums: goes on from block to block, also where these have odd numbers
        self._calibration = SignalCalibration()
        self._speeds: deque[Array] = deque(maxlen=_LATELY)  # squared, over the noise's variance

    def _use(self, body: Body) -> None:
        """Takes a body with or without the joints outside the legs."""
        self.body, self._sums = body, _Sums(self._layout, len(body.joints))
        self._by_mass = by_mass_and_centre(body)
        whole = self._places or len(body.joints) > len(self._robot.tree.joints)
        self._limbs = LimbRows(self._robot, body, self._places, self._layout) if whole else None

    def restart(self) -> None:
        """Discards the unfinished window: the next samples do not continue the previous ones."""
        self._half = None

    def forget(self) -> None:
        """Also discards the history of the motion: the trunk's rotation until the next samples is unknown."""
        self.restart()
        self._calibration = SignalCalibration()

    def block(
        self, samples: Samples, normal: Array, trunk: InertialParameters, squares: Array | None = None
    ) -> BlockResult:
        """Processes one block.

        Args:
            samples: of the block, with one sample more before and after it.
            normal: (3,), of the ground, trunk axes.
            trunk: parameters at which errors of the IMU are linearised.
            squares: `SpikeFilter.squares` of the block.
        """
        if samples.extra.shape[1] and len(self.body.joints) == samples.position.shape[1]:
            self._use(Body.of(self._robot))
        motion = self._motion(samples, normal)
        state, n = self.body.at(motion, columns=True), len(samples) - 2
        flat = np.abs(state.volume) < self.flat
        if flat.any():
            self.restart()
            return BlockResult(None, state.feet[-1], np.zeros_like(state.feet[-1]), int(np.argmax(flat.any(axis=0))))
        if squares is not None:
            self.noise.learn(squares[self._channels], len(samples))
        half, force = self._summed(samples, motion, state)
        rows = None if self._half is None else self._rows(self._half, half, trunk)
        self._half = half
        self._sign *= 1.0 - 2.0 * (n % 2)
        return BlockResult(rows, state.feet[-1], force)

    def _motion(self, samples: Samples, normal: Array) -> Motion:
        """Motion of a block, with joints outside the legs where they are recorded."""
        k, q, v = samples.extra.shape[1] // 3, samples.position[1:-1], samples.velocity
        if k:
            q, v = np.hstack([q, samples.extra[1:-1, :k]]), np.hstack([v, samples.extra[:, k : 2 * k]])
        span = (samples.time[2:] - samples.time[:-2])[:, None]
        omega, turning = samples.angular_velocity[1:-1], samples.angular_velocity
        alpha = (turning[2:] - turning[:-2]) / span
        lever = self._lever
        specific = samples.specific_force[1:-1] - alpha @ skew(lever)  # α x r and ω x (ω x r) by rows
        specific += (omega * omega).sum(axis=1, keepdims=True) * lever - (omega @ lever)[:, None] * omega
        return Motion(q, v[1:-1], (v[2:] - v[:-2]) / span, omega, alpha, specific, normal)

    def _summed(self, samples: Samples, motion: Motion, state: State) -> tuple[_Half, Array]:
        """The half window of a block, and the feet's forces (legs, 3) at its end."""
        n, J, own, halves = len(samples) - 2, self._columns, self.body, self._sums.zeros(2)
        span = (samples.time[2:] - samples.time[:-2])[:, None]
        tau, rate = samples.effort[1:-1, J], (samples.effort[2:, J] - samples.effort[:-2, J]) / span
        acceleration, velocity = motion.acceleration[:, J], motion.velocity[:, J]
        sure = direction(_fitted(velocity))
        stuck, one = np.sqrt(np.maximum(1.0 - sure * sure, 0.0)), np.ones(tau.shape)
        left = state.torque[:, J] + own.viscous[J] * velocity + own.coulomb[J] * sure + own.offset[J] - tau
        terms = np.stack([acceleration, velocity, sure, one, tau, stuck], axis=-1)
        turning = np.hstack([samples.velocity[:, J], samples.angular_velocity])
        jerk = (turning[2:] - 2.0 * turning[1:-1] + turning[:-2]) / (0.5 * span) ** 2
        signals = trunk_signals(motion.specific_force.T, motion.angular_velocity.T, motion.angular_acceleration.T).T
        rising, target, force = half_window(n), np.zeros((n, 6)), np.zeros((n, len(own.legs), 3))
        weights = np.stack([rising, rising[::-1]])  # both halves at once
        signs = 1.0 - 2.0 * (np.arange(n) % 2)
        alternating = weights * np.stack([signs[::-1], -signs])  # + at a block's end, - where the next one begins
        window_sums(
            weights,
            J,
            self._legs,
            state.to_wrench,
            state.inertial,
            state.columns,
            terms,
            np.ascontiguousarray(left),
            np.ascontiguousarray(rate),
            self.noise.torque**2,
            target,
            halves["by_rate"],
            halves["squared"],
            halves["by_terms"],
            halves["by_links"],
            force,
        )
        plain = np.hstack([signals, target, jerk, acceleration, velocity, sure, one, rate, left])
        halves["plain"][:] = weights @ plain
        step = (samples.time[-2] - samples.time[1]) / (n - 1) if n > 1 else 0.02
        probes, middle = self._slopes(motion, tau)
        limbs, count = None, samples.position.shape[1]
        if self._limbs is not None:
            at = self._limbs.joints
            torque = samples.extra[1:-1, 2 * (len(own.joints) - count) + at - count]
            limbs = self._limbs.sums(weights, motion, state, torque, _fitted(motion.velocity[:, at]))
        half = _Half(
            end=float(samples.time[-2]),
            samples=n,
            sums=halves,
            alternating=alternating @ plain[:, :18],
            probes=probes,
            middle=middle,
            angular_velocity=motion.angular_velocity.mean(axis=0),
            air=self.lifted.legs(state, motion, force, sure, step),
            limbs=limbs,
            averaged=float(rising @ rising),
            differentiated=half_differences(n) / step**2,
        )
        return half, force[-1]

    def _slopes(self, motion: Motion, tau: Array) -> tuple[Array, Array]:
        """Derivatives (6, 6 + J) of b by the trunk's specific force and angular acceleration and by the joints'
        accelerations, at the last posture; and (6, J + contacts), by each joint's position and each contact point's
        position, in the middle of the block.

        b is linear in accelerations where nothing moves. Joints of the same place in all legs are moved together, since
        a leg's b is its own.
        """
        body, J, order, k = self.body, self._columns, self._order, len(motion.position) // 2
        first = 6 + body.most  # the middle as it is, then with joints displaced
        N = first + 1 + body.most
        position = np.repeat(motion.position[-1:], N, axis=0)
        velocity, acceleration, trunk = np.zeros_like(position), np.zeros_like(position), np.zeros((3, N, 3))
        trunk[2, :3] = trunk[1, 3:6] = _UNIT
        acceleration[6 + order, J] = 1.0
        position[first:], velocity[first:] = motion.position[k], motion.velocity[k]
        position[first + 1 + order, J] += _STEP
        acceleration[first:] = motion.acceleration.mean(axis=0)
        for part, values in zip(trunk, motion[3:6], strict=True):
            part[first:] = values[k]
        omega, alpha, a = trunk
        state = body.at(Motion(position, velocity, acceleration, omega, alpha, a, motion.normal))
        h = state.torque[:, J]
        h[first:] += body.friction(motion.velocity[k], motion.velocity[k])[J] - tau[k]
        by_leg = body.by_leg(state, h)
        by_trunk = by_leg[:6].sum(axis=1) - state.inertial[:6, -1]
        middle, E, s = by_leg[first:], state.to_wrench[first, J], state.axis[first, J]
        by_position = (middle[1 + order, self._legs] - middle[0, self._legs]) / _STEP
        by_contact = body.by_contact(E, s, np.add.reduceat(E[:, :3] * h[first][:, None], body.starts, axis=0))
        probes = np.vstack([by_trunk, by_leg[6 + order, self._legs]]).T
        return probes, np.hstack([by_position.T, by_contact.transpose(1, 0, 2).reshape(6, -1)])

    @cached_property
    def _order(self) -> NDArray[np.int64]:
        """Place of each joint in its leg, (J,)."""
        return np.concatenate([np.arange(len(leg)) for leg in self.body.legs])

    @cached_property
    def _legs(self) -> NDArray[np.int64]:
        """Leg of each joint, (J,)."""
        return self.body.leg_of[self._columns]

    def _rows(self, first: _Half, second: _Half, trunk: InertialParameters) -> BlockRows:
        J, layout, places, noise = self._layout.joints, self._layout, self._layout.places, self.noise
        sums = self._sums.of(first.sums, second.sums)
        alternated = first.alternating[0] + second.alternating[1]
        averaged, differentiated = first.averaged + second.averaged, first.differentiated + second.differentiated
        probes, middle = 0.5 * (first.probes + second.probes), 0.5 * (first.middle + second.middle)
        elapsed, of_gyro, of_force = second.end - first.end, noise.gyro**2, noise.accelerometer**2
        imu = np.repeat([averaged * of_force, differentiated * of_gyro], 3)
        imu[:3] += imu[3] * (self._lever @ self._lever)
        turn = turned(second.angular_velocity, elapsed)
        signals, removed = self._calibration.calibrated(sums["signals"], imu, turn, elapsed)
        own_alpha = wrench_of_angular_acceleration(trunk.first_moment, trunk.inertia)
        K = wrench_of_specific_force(trunk.mass, trunk.first_moment) - probes[:, :3]
        L, G = own_alpha - probes[:, 3:6], probes[:, 6:]
        columns, end, of_links = np.zeros((6, 11 + layout.count + 10 * len(self._places))), 11 + layout.count, None
        columns[:, :10], columns[:, 10], C = trunk_matrix(signals), sums["target"], columns[:, 11:end]
        if first.limbs is not None and second.limbs is not None and self._limbs is not None:
            A = trunk_matrix(sums["signals"])
            columns[:, 10] += A @ self.body.lumped  # the trunk contains the other joints' links at their reference
            self._limbs.add(columns, A, sums["by_links"], self._by_mass)
            of_links = self._limbs.rows(first.limbs, second.limbs, self._by_mass) if len(self._limbs.joints) else None
        for term, name in enumerate(_TERMS):
            C[:, places[name]] = -sums["by_terms"][:, :, term].T
        # signs such that positive static friction lifts the trunk, as in all joints of a robot that sags
        lifts = np.sign(sums["by_terms"][:, :3, _TERMS.index("offset")] @ sums["signals"][:3])
        # noise is not motion: a joint that moved beyond it does not stick, another shows no friction or rotor inertia
        self._speeds.append(sums["joint"][1] ** 2 / (averaged * noise.velocity**2))
        still = np.array(self._speeds).mean(axis=0) < _MOVES**2
        for name in ("rotor", "viscous", "coulomb"):
            C[:, places[name]] *= ~still
        C[:, places["stiction"]] *= lifts * still
        C[:, places["torque_lag"]] = sums["by_rate"][:, None]
        C[:, places["common_gain"]] = C[:, places["gain"]].sum(axis=1, keepdims=True)
        C[:, places["encoder"]], C[:, places["contact"]] = middle[:, :J], -middle[:, J:]
        by_links = sums["by_links"][: layout.links] @ self._by_mass[: layout.links]  # (K, 6, 4)
        C[:, places["link_mass"]] = -by_links[:, :, 0].T
        C[:, places["link_com"]] = -by_links[:, :, 1:].transpose(1, 2, 0).reshape(6, -1)
        a, alpha, spin = signals_of(sums["signals"])
        C[:, places["imu_lever"]] = -K @ (skew(alpha) + spin)
        C[:, places["imu_rotation"]] = K @ skew(a) + L @ skew(alpha)
        C[:, places["accelerometer"]] = -K
        C[:, places["imu_response"]] = -K * (signals[:3] - self._calibration.average)
        C[:, places["velocity_lag"]] = (L @ sums["jerk"][J:] - G @ sums["jerk"][:J])[:, None]
        C[:, places["regression"]] = own_alpha * removed
        alternating = trunk_matrix(alternated[:12]) @ trunk.vector - alternated[12:]
        C[:, places["sampling"].start] = self._sign * alternating * (second.samples >= RESOLVED)
        L_noise = L + K @ skew(self._lever)
        white = _OVERLAP * (sums["squared"] + averaged * of_force * (K * K).sum(axis=1))
        by_velocity = (G * G) @ noise.velocity**2
        white += _TELESCOPED * differentiated * (of_gyro * (L_noise * L_noise).sum(axis=1) + by_velocity)
        joint = sums["joint"]
        swing = SwingRows(first.air & second.air, joint[:4], joint[4], joint[5])
        return BlockRows(second.end, elapsed, columns, white, swing, of_links)


def signals_of(signals: Array) -> tuple[Array, Array, Array]:
    """Specific force and angular acceleration (3,), and [ω]x [ω]x (3, 3) = ω ωᵀ - ω² 1, from the twelve signals."""
    xx, xy, xz, yy, yz, zz = signals[6:]
    outer = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return signals[:3], signals[3:6], np.asarray(outer - (xx + yy + zz) * _UNIT)


def _fitted(velocity: Array) -> Array:
    """A line fitted to each of the velocities (n, J)."""
    along = np.arange(len(velocity)) - 0.5 * (len(velocity) - 1)
    slope = along @ velocity / max(float(along @ along), 1.0)
    return np.asarray(velocity.mean(axis=0) + along[:, None] * slope)


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
