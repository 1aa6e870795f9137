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
    load friction              -E s |τ|               a gear's losses, a share of what its joint carries
    stiction                   ∓E √(1 - s²)                what holds a joint that rests, positive upwards
    standstill                 -E √(1 - s²)                the same of a joint that slides at other times
    encoder, contact, unfelt   +∂b/∂q, -∂b/∂p_contact, -∂b/∂m     at the block's middle, by differences and closed form
    link mass and centre       -∂b/∂(m, c)                 of `State.columns` by φ, and of φ by m and c
    IMU place, axes, bias      -K ([α]x + [ω]x[ω]x), K [a]x + L [α]x, -K
    response of the IMU        -K diag(a - ā)               ā: average over a second, turned with the trunk
    lag of the velocities      G q⃛ + L α̇
    sampling                   half the difference of A θ - b between odd and even samples, times one

G, L, K of the legs are found by feeding each acceleration alone at the block's last posture.
"""

from __future__ import annotations

from functools import cached_property
from math import exp, inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stadera.body import Body, Motion, State
from stadera.body.friction import STICTION_VELOCITY, direction
from stadera.body.kernel import evaluate
from stadera.compiled import load
from stadera.constants import GRAVITY, SINGULAR
from stadera.inertia import InertialParameters, skew, skews
from stadera.robot.imu import ImuMount
from stadera.robot.limbs import Place
from stadera.robot.model import Robot
from stadera.trunk.block_rows import BlockRows, SwingRows
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.ground import turned
from stadera.trunk.lifted import Lifted
from stadera.trunk.limbs import LIMB_SUMS, LimbRows, by_mass_and_centre
from stadera.trunk.noise import Variances, WhiteNoise, lower_quartile
from stadera.trunk.row_kernel import differences, window_sums
from stadera.trunk.samples import Samples
from stadera.trunk.settings import SwingDetection
from stadera.trunk.window import Window, block_sums, window_of
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
# times its noise: root mean square of the velocity of a joint that moves; where noise is loud, that of noise alone and
# a speed [rad/s] of which it leaves no doubt
_MOVES, _BEYOND, _SPEED = 3.0, 1.75, 0.03
_SLOW = 0.1  # rad/s, of a joint outside the legs that rests: it trembles, with no acceleration that a load would show
_LATELY = 25  # blocks, over which that is taken: a joint that turns back is not one that stands
RESOLVED = 3
"""Least number of samples in a block whose differences tell sampling errors: motion of 12 Hz enters these by 3 % with
three samples a block, by 20 % with two, and fully with one (the window's response at half the rate less 12 Hz).
"""

_TERMS = ("rotor", "viscous", "coulomb", "load_friction", "offset", "gain")
_OF_MOTION = 4  # the first of them, which a joint that moves shows
_SUMMED = ("plain", "by_rate", "squared", "by_terms", "by_links", "alternating", *LIMB_SUMS)
_UNIT = np.eye(3)
_SQUARE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # places of ω ωᵀ among its products

Ints = NDArray[np.int64]
Sums = dict[str, NDArray[Any]]
"""Halves of windows of B blocks by name, see `RowMaker._halves`."""


class RowMaker:
    """Converts blocks of samples into rows, any number of blocks at once.

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
        load(evaluate, block_sums, window_sums, differences)
        self._robot, self._lever, self._places = robot, mount.translation, places
        self._layout, length = ErrorLayout.of(robot), robot.leg_length
        self._use(Body.of(robot, others=False))
        self._columns = self.body.in_legs
        self.noise, n = WhiteNoise.prior(robot, self._layout.joints), len(robot.tree.joints)
        imu = 3 * n + np.arange(6)
        self._channels = np.concatenate([2 * n + self._columns, n + self._columns, imu])  # of the noise, among all
        self.weight, self.flat = robot.mass * GRAVITY, SINGULAR * length**3
        self.lifted = Lifted(self.body, swing, self.weight, length)
        self._half: dict[str, Array] | None = None  # of the block before, see `_halves`
        self._rough = np.zeros((0, self._layout.joints))  # mean squares of the latest blocks, see `_latest`
        self._sign = 1.0  # of alternating sums: goes on from block to block, also where these have odd numbers
        self.forget()

    def _use(self, body: Body) -> None:
        """Takes a body with or without the joints outside the legs."""
        self.body, self._by_mass = body, by_mass_and_centre(body)
        whole = self._places or len(body.joints) > len(self._robot.tree.joints)
        self._limbs = LimbRows(self._robot, body, self._places, self._layout) if whole else None
        count = self._layout.joints + (0 if self._limbs is None else len(self._limbs.joints))
        self._speeds = np.zeros((0, count))  # of the latest blocks, squared, over the noise's variance

    def restart(self) -> None:
        """Discards the unfinished window: the next samples do not continue the previous ones."""
        self._half = None

    def forget(self) -> None:
        """Also discards the history of the motion: the trunk's rotation until the next samples is unknown."""
        self.restart()
        self._average, self._averaged = np.zeros(3), 0.0  # of the specific force, and the sum of its weights

    def motion(self, samples: Samples) -> Motion:
        """Motion at all samples but the first and the last, its normal left open; with joints outside the legs where
        they are recorded.
        """
        k, q, v = samples.extra.shape[1] // 3, samples.position[1:-1], samples.velocity
        if k and len(self.body.joints) == samples.position.shape[1]:
            self._use(Body.of(self._robot))
        if k:
            q, v = np.hstack([q, samples.extra[1:-1, :k]]), np.hstack([v, samples.extra[:, k : 2 * k]])
        span = (samples.time[2:] - samples.time[:-2])[:, None]
        omega, turning = samples.angular_velocity[1:-1], samples.angular_velocity
        alpha = (turning[2:] - turning[:-2]) / span
        lever = self._lever
        specific = samples.specific_force[1:-1] - alpha @ skew(lever)  # α x r and ω x (ω x r) by rows
        specific += (omega * omega).sum(axis=1, keepdims=True) * lever - (omega @ lever)[:, None] * omega
        return Motion(q, v[1:-1], (v[2:] - v[:-2]) / span, omega, alpha, specific, np.empty(0))

    def feet(self, motion: Motion, effort: Array) -> tuple[Array, Array]:
        """Places of the feet and the forces on them, (N, legs, 3) [m, N], at N samples; no forces if a leg is
        near-singular.
        """
        state = self.body.at(motion)
        if (flat := np.abs(state.volume) < self.flat).any():
            state.to_wrench[flat.any(axis=1)] = 0.0
        return state.feet, self.body.forces(state, self.body.left(state, motion, effort))

    def blocks(
        self,
        samples: Samples,
        sizes: tuple[int, ...],
        motion: Motion,
        trunk: InertialParameters,
        squares: Array | None = None,
        used: Bools | None = None,
    ) -> tuple[list[BlockRows | None], list[int | None]]:
        """Processes B successive blocks.

        Args:
            samples: of the blocks, with one sample more before and after them. sizes: of the blocks.
            motion: see `motion`, with the ground's normal.
            trunk: parameters at which errors of the IMU are linearised.
            squares: (B, channels), `mean_third_differences_squared` of each block.
            used: (B,), False for blocks that are left out, as if there were none.

        Returns:
            By block: rows of the window that it completes, None for the first one of a stretch; and the index of a leg
            so near-singular that its foot's force is not determined, None if there is none.
        """
        window, state = window_of(sizes), self.body.at(motion, columns=True)
        singular: list[int | None] = [None] * len(sizes)
        sound = np.ones(len(sizes), dtype=bool) if used is None else used
        if (flat := np.abs(state.volume) < self.flat).any():
            by_leg = np.logical_or.reduceat(flat, window.edges[:-1], axis=0)
            singular = [int(np.argmax(legs)) if legs.any() else None for legs in by_leg]
            sound = sound & ~by_leg.any(axis=1)
            wrong = ~sound[window.block]  # sums over these samples are not used, and need to be finite
            state.to_wrench[wrong] = state.columns[wrong] = 0.0
        squares = None if squares is None else squares[:, self._channels]
        noise = self.noise.learnt(squares, sizes, sound)
        halves = self._halves(samples, window, motion, state, noise, sound)
        before = self._half or {name: np.zeros_like(value[:1]) for name, value in halves.items()}
        follows = np.concatenate([[self._half is not None], sound[:-1]]) & sound
        first = before  # of each block, the one before it
        if len(sizes) > 1:
            first = {name: np.concatenate([before[name], value[:-1]]) for name, value in halves.items()}
        rough = (
            noise.velocity
            if squares is None
            else self._latest(noise.velocity, squares[:, self._layout.joints : -6], sizes)
        )
        rows = self._rows(first, halves, noise, rough, follows, trunk)
        self._half = {name: value[-1:] for name, value in halves.items()} if sound[-1] else None
        return rows, singular

    def _halves(
        self, samples: Samples, window: Window, motion: Motion, state: State, noise: Variances, sound: Bools
    ) -> Sums:
        """Halves of windows of B blocks, of a robot with J joints in its legs, K links and L feet, by name:

        plain: (B, 2, ...), sums weighted by the rising and by the falling half, of signals (12), target (6), jerk
            (J + 3), and seven numbers of each joint: q̈, q̇, s, s |τ|, 1, τ̇, h - τ.
        by_rate, squared: (B, 2, 6), of E τ̇, and, with w² for w, of E σ² Eᵀ of white torque noise.
        by_terms, by_links: (B, 2, J, 6, terms) and (B, 2, K, 6, 10), of E times q̈, q̇, s, s |τ|, 1 and τ, and of
            `State.columns`.
        alternating: (B, 2, 18), of signals and target, with signs that alternate from sample to sample.
        probes, middle: see `_slopes`. omega: (B, 3), mean. air: (B, L), legs in the air. stepping: (B,).
        end: (B,) [s]. averaged, differentiated: (B,), Σ w², and the same of differences in time [1/s²].
        sign: (B,), of `alternating`; zero of a block with too few samples. limb_...: see `LimbRows.sums`.
        posture: (B, n + 3), joints and ground's normal at the end, of a robot with limbs.
        """
        J, own, B = self._columns, self.body, len(window.edges) - 1
        span = (samples.time[2:] - samples.time[:-2])[:, None]
        tau, rate = samples.effort[1:-1, J], (samples.effort[2:, J] - samples.effort[:-2, J]) / span
        acceleration, velocity = motion.acceleration[:, J], motion.velocity[:, J]
        sure = direction(window.line(velocity))
        one = np.ones(tau.shape)
        left = state.torque[:, J] + own.viscous[J] * velocity + own.coulomb[J] * sure + own.offset[J] - tau
        loaded = sure * np.abs(window.line(tau))
        terms = np.stack([acceleration, velocity, sure, loaded, one, tau], axis=-1)
        turning = np.hstack([samples.velocity[:, J], samples.angular_velocity])
        jerk = (turning[2:] - 2.0 * turning[1:-1] + turning[:-2]) / (0.5 * span) ** 2
        signals = trunk_signals(motion.specific_force.T, motion.angular_velocity.T, motion.angular_acceleration.T).T
        target, force = np.zeros((len(tau), 6)), np.zeros((len(tau), len(own.legs), 3))
        sizes = {"by_rate": (6,), "squared": (6,), "by_terms": (len(J), 6, len(_TERMS))}
        sizes["by_links"] = len(own.joints), 6, 10
        out: Sums = {name: np.zeros((B, 2, *size)) for name, size in sizes.items()}
        window_sums(
            window.halves,
            window.block,
            J,
            self._legs,
            state.to_wrench,
            state.inertial,
            state.columns,
            terms,
            np.ascontiguousarray(left),
            np.ascontiguousarray(rate),
            noise.torque,
            target,
            out["by_rate"],
            out["squared"],
            out["by_terms"],
            out["by_links"],
            force,
        )
        plain = np.hstack([signals, target, jerk, acceleration, velocity, sure, loaded, one, rate, left])
        counts, end, begin = np.diff(window.edges), samples.time[window.edges[1:]], samples.time[window.edges[:-1] + 1]
        step = np.where(counts > 1, (end - begin) / np.maximum(counts - 1, 1), 0.02)
        summed = window.sums(window.both, plain)
        out["plain"], out["alternating"] = summed[:, :2], summed[:, 2:, :18]
        out["probes"], out["middle"] = self._slopes(window, motion, tau, sound)
        out["omega"] = window.sums(window.mean, motion.angular_velocity)[:, 0]
        out["air"] = self.lifted.legs(state, motion, force, sure, step, window.edges)
        out["stepping"] = self.lifted.stepping(state.pace, window.edges)
        signs = self._sign * np.cumprod(np.concatenate([[1.0], np.where(sound, 1.0 - 2.0 * (counts % 2), 1.0)]))
        out["sign"], self._sign = signs[:-1] * (counts >= RESOLVED), float(signs[-1])
        out |= {"end": end, "averaged": window.averaged, "differentiated": window.differences / step**2}
        if self._limbs is not None:
            at, count = self._limbs.joints, samples.position.shape[1]
            torque = samples.extra[1:-1, 2 * (len(own.joints) - count) + at - count]
            out |= self._limbs.sums(window, motion, state, torque)
            last = window.edges[1:] - 1
            out["posture"] = np.hstack([motion.position[last], motion.normal[last]])
        return out

    def _slopes(self, window: Window, motion: Motion, tau: Array, sound: Bools) -> tuple[Array, Array]:
        """Derivatives (B, 6, 6 + J) of b by the trunk's specific force and angular acceleration and by the joints'
        accelerations, at each block's last posture; and (B, 6, J + contacts + unfelt), by each joint's position, each
        contact point's position and each moment that no joint tells, in the middle of the block.

        b is linear in accelerations where nothing moves. Joints of the same place in all legs are moved together, since
        a leg's b is its own.
        """
        body, J, legs, order, B = self.body, self._columns, self._legs, self._order, len(window.edges) - 1
        k, first = window.edges[:-1] + np.diff(window.edges) // 2, 6 + body.most
        N = first + 1 + body.most  # the middle as it is, then with joints displaced, come after the first ones
        position = np.repeat(motion.position[window.edges[1:] - 1][:, None], N, axis=1)
        velocity, acceleration, trunk = np.zeros_like(position), np.zeros_like(position), np.zeros((3, B, N, 3))
        trunk[2, :, :3] = trunk[1, :, 3:6] = _UNIT
        acceleration[:, 6 + order, J] = 1.0
        position[:, first:], velocity[:, first:] = motion.position[k, None], motion.velocity[k, None]
        position[:, first + 1 + order, J] += _STEP
        acceleration[:, first:] = window.sums(window.mean, motion.acceleration)
        for part, values in zip(trunk, motion[3:6], strict=True):
            part[:, first:] = values[k, None]
        moved = (each.reshape(B * N, -1) for each in (position, velocity, acceleration, *trunk))
        state = body.at(Motion._make((*moved, np.repeat(motion.normal[k], N, axis=0))))
        if not sound.all():
            state.to_wrench[np.repeat(~sound, N)] = 0.0
        E, axis = (each.reshape(B, N, *each.shape[1:])[:, first, J] for each in (state.to_wrench, state.axis))
        h = state.torque.reshape(B, N, -1)
        h[:, first:, J] += (body.friction(motion.velocity[k], motion.velocity[k])[:, J] - tau[k])[:, None]
        probes, by_position = np.zeros((B, 6, 6 + len(J))), np.zeros((B, 6, len(J)))
        differences(J, legs, order, state.to_wrench, h.reshape(B * N, -1), state.inertial, _STEP, probes, by_position)
        felt = np.add.reduceat(E[..., :3] * h[:, first, J, None], body.starts, axis=1)
        by_contact = body.by_contact(E, axis, felt).transpose(0, 2, 1, 3).reshape(B, 6, -1)
        unfelt = state.unfelt.reshape(B, N, -1, 6)[:, first, list(self._layout.unfelt)].transpose(0, 2, 1)
        return probes, np.concatenate([by_position, by_contact, unfelt], axis=2)

    @cached_property
    def _order(self) -> Ints:
        """Place of each joint in its leg, (J,)."""
        return np.concatenate([np.arange(len(leg)) for leg in self.body.legs])

    @cached_property
    def _legs(self) -> Ints:
        """Leg of each joint, (J,)."""
        return self.body.leg_of[self._columns]

    def _latest(self, variance: Array, squares: Array, sizes: tuple[int, ...]) -> Array:
        """Variance (B, J) of the velocities' noise, at least that of the latest blocks by their mean squares (B, J): it
        is known slowly, and noise that is louder than expected would pass for motion for a second or two.
        """
        usual = np.array([[lower_quartile(size - 1)] for size in sizes])
        known, B = np.concatenate([self._rough, squares / usual]), len(sizes)
        ends = range(len(known) - B + 1, len(known) + 1)
        lately = [np.quantile(known[max(end - _LATELY, 0) : end], 0.25, axis=0) for end in ends]
        self._rough = known[-(_LATELY - 1) :]
        return np.maximum(variance, lately)

    def _still(self, velocity: Array, least: Array, follows: Bools) -> Bools:
        """Joints (B, J + l) that have not moved lately beyond their noise: a joint that sticks, not one that turns
        back; those of the legs, then of the limbs.

        Args:
            velocity: (B, J + l), averages over windows. least: likewise, square of what is motion. follows: (B,),
                blocks with rows.
        """
        known = np.concatenate([self._speeds, (velocity**2 / least)[follows]])
        total = np.zeros((len(known) + 1, known.shape[1]))
        known.cumsum(axis=0, out=total[1:])
        end = len(self._speeds) + np.cumsum(follows)
        begin = np.maximum(end - _LATELY, 0)
        self._speeds = known[-(_LATELY - 1) :]
        return np.asarray(total[end] - total[begin] < (end - begin)[:, None])

    def _at_rest(self, posture: Array, moves: Array, force: Array) -> State:
        """The dynamics, with columns, of a trunk at rest, in postures (B, ...) of joints and the ground's normal, with
        velocities and accelerations of the limbs' joints (B, l, 2) and mean specific forces (B, 3).
        """
        assert self._limbs is not None
        q, still = posture[:, :-3], np.zeros_like(force)
        motion = np.zeros((2, *q.shape))
        motion[:, :, self._limbs.joints] = moves.transpose(2, 0, 1)
        return self.body.at(Motion(q, motion[0], motion[1], still, still, force, posture[:, -3:]), columns=True)

    def _over_a_second(self, force: Array, turn: Array, elapsed: float) -> Array:
        """Mean specific force (3,) over the last second, turned with the trunk, and one more window: gravity. Impacts
        count for half of gravity at most.
        """
        keep, struck = exp(-elapsed), 0.5 * GRAVITY
        self._averaged = keep * self._averaged + 1.0 - keep
        share, carried = (1.0 - keep) / self._averaged, turn @ self._average
        if share == 1.0:  # the first block is all that is known
            struck = inf
        self._average = carried + share * np.clip(force - carried, -struck, struck)
        return self._average

    def _rows(
        self, first: Sums, second: Sums, noise: Variances, rough: Array, follows: Bools, trunk: InertialParameters
    ) -> list[BlockRows | None]:
        """Rows of windows from neighbouring blocks; None where no block is before. `rough`: see `_latest`."""
        J, layout, places, B = self._layout.joints, self._layout, self._layout.places, len(follows)
        sums = {name: first[name][:, 0] + second[name][:, 1] for name in _SUMMED if name in first}
        plain, alternated = sums["plain"], sums["alternating"]
        signals, target, jerk, joint = plain[:, :12], plain[:, 12:18], plain[:, 18 : 21 + J], plain[:, 21 + J :]
        joint = joint.reshape(B, 7, J)
        averaged, differentiated = (first[name] + second[name] for name in ("averaged", "differentiated"))
        probes, middle = (0.5 * (first[name] + second[name]) for name in ("probes", "middle"))
        elapsed = second["end"] - first["end"]
        average, turn = np.zeros((B, 3)), turned(second["omega"], elapsed)
        for b in np.flatnonzero(follows):
            average[b] = self._over_a_second(signals[b, :3], turn[b], float(elapsed[b]))
        K = wrench_of_specific_force(trunk.mass, trunk.first_moment) - probes[:, :, :3]
        L = wrench_of_angular_acceleration(trunk.first_moment, trunk.inertia) - probes[:, :, 3:6]
        G = probes[:, :, 6:]
        columns, end, limbs = np.zeros((B, 6, 11 + layout.count + 10 * len(self._places))), 11 + layout.count, None
        # noise is not motion: a joint that moved beyond it does not stick, another shows no friction or rotor inertia
        speed, loud = joint[:, 1], averaged[:, None] * rough
        least = np.minimum(_MOVES**2 * loud, np.maximum(_BEYOND**2 * loud, loud + _SPEED**2))
        if self._limbs is not None:
            of_limbs = sums["limb_motion"][..., 0]
            speed, least = np.hstack([speed, of_limbs]), np.hstack([least, np.full_like(of_limbs, _SLOW**2)])
        held = self._still(speed, least, follows)
        still = held[:, :J]
        # and of a robot at rest it would show height and inertia, which are columns of accelerations
        shown, rests = signals.copy(), np.asarray(still.all(axis=1))
        shown[rests, :3], shown[rests, 3:6] = average[rests], 0.0
        if self._limbs is not None:
            rests, own = rests & follows, held[:, J:]
            moves = sums["limb_motion"] * ~own[..., None]
            state = self._at_rest(first["posture"][rests], moves[rests], average[rests]) if rests.any() else None
            self._limbs.quieten(sums, rests, state, own)
        columns[:, :, :10], columns[:, :, 10], C = trunk_matrix(shown), target, columns[:, :, 11:end]
        if self._limbs is not None:
            A = trunk_matrix(signals)
            columns[:, :, 10] += A @ self.body.lumped  # the trunk contains the other joints' links at their reference
            self._limbs.add(columns, A, sums["by_links"], self._by_mass)
            limbs = self._limbs.rows(sums, self._by_mass, held[:, J:]) if len(self._limbs.joints) else None
        self._by_joints(C, sums, joint, still, signals[:, :3])
        by_contact = slice(J, J + 3 * layout.contacts)
        C[:, :, places["encoder"]], C[:, :, places["contact"]] = middle[:, :, :J], -middle[:, :, by_contact]
        C[:, :, places["unfelt"]] = -middle[:, :, by_contact.stop :]
        by_links = sums["by_links"][:, : layout.links] @ self._by_mass[: layout.links]  # (B, K, 6, 4)
        C[:, :, places["link_mass"]] = -by_links[..., 0].transpose(0, 2, 1)
        C[:, :, places["link_com"]] = -by_links[..., 1:].transpose(0, 2, 3, 1).reshape(B, 6, -1)
        self._by_imu(C, K, L, signals, average)
        C[:, :, places["velocity_lag"]] = L @ jerk[:, J:, None] - G @ jerk[:, :J, None]
        unresolved = trunk_matrix(alternated[:, :12]) @ trunk.vector - alternated[:, 12:]
        C[:, :, places["sampling"].start] = second["sign"][:, None] * unresolved
        L_noise = L + K @ skew(self._lever)
        white = _OVERLAP * (sums["squared"] + (averaged * noise.accelerometer)[:, None] * (K * K).sum(axis=2))
        by_velocity = ((G * G) @ noise.velocity[:, :, None])[:, :, 0]
        by_velocity += noise.gyro[:, None] * (L_noise * L_noise).sum(axis=2)
        white += _TELESCOPED * differentiated[:, None] * by_velocity
        vague = np.sqrt(STICTION_VELOCITY**2 + averaged[:, None] * noise.velocity)
        unsure = 1.0 - np.tanh(joint[:, 1] / vague) ** 2
        stepping = (first["stepping"] | second["stepping"]).tolist()
        slides = np.stack([joint[:, 2], -joint[:, 2]], axis=1) > _SLIDES
        slides &= (speed**2 > least)[:, None, :J]
        air = first["air"] & second["air"]
        return [
            BlockRows(
                float(second["end"][b]),
                float(elapsed[b]),
                columns[b],
                white[b],
                SwingRows(air[b], joint[b, :5], joint[b, 5], joint[b, 6], noise.torque[b], slides[b], stepping[b]),
                unsure[b],
                None if limbs is None else limbs[b],
            )
            if follows[b]
            else None
            for b in range(B)
        ]

    def _by_joints(self, C: Array, sums: Sums, joint: Array, still: Bools, specific: Array) -> None:
        """Writes the columns (B, 6, errors) of rotors, friction, offsets, gains and lag of the torques.

        Args:
            joint: (B, 7, J), see `_halves`. still: (B, J), see `_still`. specific: (B, 3), the mean specific force.
        """
        places = self._layout.places
        by_terms = -sums["by_terms"].transpose(3, 0, 2, 1)  # (terms, B, 6, J)
        # signs such that positive static friction lifts the trunk, as in all joints of a robot that sags
        offset = by_terms[_TERMS.index("offset")]
        lifts = np.sign((offset[:, :3] * specific[:, :, None]).sum(axis=1))
        # by the mean direction: noise of single velocities is no motion, and a slow joint does not stick whole
        stuck = np.sqrt(np.maximum(1.0 - (joint[:, 2] / np.maximum(joint[:, 4], 1e-9)) ** 2, 0.0))
        C[:, :, places["stiction"]] = offset * (-lifts * still * stuck)[:, None]
        C[:, :, places["standstill"]] = offset * (~still * stuck)[:, None]
        by_terms[:_OF_MOTION] *= ~still[:, None]
        for name, values in zip(_TERMS, by_terms, strict=True):
            C[:, :, places[name]] = values
        C[:, :, places["torque_lag"]] = sums["by_rate"][:, :, None]
        C[:, :, places["common_gain"]] = C[:, :, places["gain"]].sum(axis=2, keepdims=True)

    def _by_imu(self, C: Array, K: Array, L: Array, signals: Array, average: Array) -> None:
        """Writes the columns (B, 6, errors) of the IMU's place, axes, offset and response.

        Args:
            K, L: (B, 6, 3), see the module's text. signals: (B, 12). average: (B, 3), see `_over_a_second`.
        """
        places = self._layout.places
        a, alpha, spin = signals_of(signals)
        C[:, :, places["imu_lever"]] = -K @ (skews(alpha) + spin)
        C[:, :, places["imu_rotation"]] = K @ skews(a) + L @ skews(alpha)
        C[:, :, places["accelerometer"]] = -K
        C[:, :, places["imu_response"]] = -K * (a - average)[:, None]


def signals_of(signals: Array) -> tuple[Array, Array, Array]:
    """Specific force and angular acceleration (..., 3), and [ω]x [ω]x (..., 3, 3) = ω ωᵀ - ω² 1, from the twelve
    signals (..., 12).
    """
    square = signals[..., 6:][..., _SQUARE]
    trace = np.trace(square, axis1=-2, axis2=-1)
    return signals[..., :3], signals[..., 3:6], np.asarray(square - trace[..., None, None] * _UNIT)
