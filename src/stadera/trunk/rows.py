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
    stiction                   ∓E √(1 - s²)                what holds a joint that stands, positive upwards
    standstill                 -E √(1 - s²)                the same of a joint that slides at other times
    encoder, contact, unfelt   +∂b/∂q, -∂b/∂p_contact, -∂b/∂m     at the block's middle, by differences and closed form
    link mass and centre       -∂b/∂(m, c)                 of `State.columns` by φ, and of φ by m and c
    IMU place, axes, bias      -K ([α]x + [ω]x[ω]x), K [a]x + L [α]x, -K
    response of the IMU        -K diag(a - ā)               ā: average over a second, turned with the trunk
    lag of the velocities      G q⃛ + L α̇
    sampling                   half the difference of A θ - b between odd and even samples, times one

Each block's sums are those of `stadera.trunk.halves`. G, L, K of the legs are found by feeding each acceleration alone
at the block's last posture.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stadera.body import Body, Motion, State
from stadera.body.friction import STICTION_VELOCITY
from stadera.constants import GRAVITY, SINGULAR
from stadera.inertia import InertialParameters, skew, skews
from stadera.robot.imu import ImuMount
from stadera.robot.limbs import Place
from stadera.robot.model import Robot
from stadera.trunk.block_rows import BlockRows, SwingRows
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.ground import turned
from stadera.trunk.halves import SUMMED, TERMS, HalfWindows, Sums
from stadera.trunk.limbs import LimbRows, by_mass_and_centre
from stadera.trunk.noise import AtRest, Lately, Variances, WhiteNoise
from stadera.trunk.samples import Samples
from stadera.trunk.settings import SwingDetection
from stadera.trunk.swing import Lifted
from stadera.trunk.window import Ints, Window, window_of
from stadera.trunk.wrench import (
    SIGNALS,
    trunk_matrix,
    wrench_of_angular_acceleration,
    wrench_of_specific_force,
)
from stadera.types import Array, Bools

_OVERLAP = 4.0 / 3.0  # 1 + 2 ρ: neighbouring windows share samples, ρ = 1/6 for what is averaged
_TELESCOPED = 0.5  # ρ = -1/2 for what is differentiated: between the least of one block and the nothing of a long sum
_SLIDES = 0.9  # mean of the direction of sliding, between -1 and 1, of a joint that neither stops nor turns back
# times its noise: root mean square of the velocity of a joint that moves; where noise is loud, that of noise alone and
# a speed [rad/s] of which it leaves no doubt
_MOVES, _BEYOND, _SPEED = 3.0, 1.75, 0.03
_SLOW = 0.1  # rad/s, of a joint outside the legs that rests: it trembles, with no acceleration that a load would show
RESOLVED = 3
"""Least number of samples in a block whose differences tell sampling errors: motion of 12 Hz enters these by 3 % with
three samples a block, by 20 % with two, and fully with one (the window's response at half the rate less 12 Hz).
"""

_OF_MOTION = 4  # the first of `TERMS`, which a joint that moves shows
_UNIT, _SIGNS = np.eye(3), np.array([[1.0], [-1.0]])
_SQUARE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # places of ω ωᵀ among its products


class Responses(NamedTuple):
    """How the rows of B blocks answer: K, L (B, 6, 3) and G (B, 6, J) of the module's text."""

    force: Array
    turning: Array
    joints: Array

    @classmethod
    def of(cls, trunk: InertialParameters, probes: Array) -> Responses:
        """Of a trunk, and of the legs by `probes` (B, 6, 6 + J)."""
        force = wrench_of_specific_force(trunk.mass, trunk.first_moment) - probes[:, :, :3]
        turning = wrench_of_angular_acceleration(trunk.first_moment, trunk.inertia) - probes[:, :, 3:6]
        return cls(force, turning, probes[:, :, 6:])


class RowMaker:
    """Converts blocks of samples into rows, any number of blocks at once.

    Args:
        robot: the model.
        mount: of the IMU, for its lever; the samples are in trunk axes.
        swing: criteria for a swinging leg.
        places: links on which a load may be, besides the trunk.

    Attributes:
        body: the robot as a tree. noise: white noise of all channels, estimated from the log.
        lifted: tells legs in the air. at_rest: specific force while all joints of the legs stand.
        weight: of the robot [N]. flat: least det J [m³].
    """

    def __init__(self, robot: Robot, mount: ImuMount, swing: SwingDetection, places: tuple[Place, ...] = ()) -> None:
        self._robot, self._lever, self._places = robot, mount.translation, places
        self._layout, length, n = ErrorLayout.of(robot), robot.leg_length, len(robot.tree.joints)
        self.weight, self.flat = robot.mass * GRAVITY, SINGULAR * length**3
        body = Body.of(robot, others=False)
        self.lifted = Lifted(body, swing, self.weight, length)
        self._use(body)
        self.noise = WhiteNoise.prior(robot, self._layout.joints)
        J = body.in_legs
        self._channels = np.concatenate([2 * n + J, n + J, 3 * n + np.arange(6)])  # of the noise, among all
        self._half: Sums | None = None  # of the block before
        self._sign = 1.0  # of alternating sums: goes on from block to block, also where these have odd numbers
        self._lately, self.at_rest = Lately(), AtRest()

    def _use(self, body: Body) -> None:
        """Takes a body with or without the joints outside the legs."""
        self.body, self._by_mass = body, by_mass_and_centre(body)
        whole = self._places or len(body.joints) > len(self._robot.tree.joints)
        self._limbs = LimbRows(self._robot, body, self._places, self._layout) if whole else None
        self._halves = HalfWindows(body, self._limbs, self.lifted, self._layout.unfelt)

    def restart(self) -> None:
        """Discards the unfinished window: the next samples do not continue the previous ones."""
        self._half = None

    def forget(self) -> None:
        """Also discards the history of the motion: the trunk's rotation until the next samples is unknown."""
        self.restart()
        self._lately.forget()

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
        return state.feet, self.body.contacts(state, self.body.left(state, motion, effort))[..., :3]

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
        sound, singular = self._sound(window, state, np.ones(len(sizes), dtype=bool) if used is None else used)
        squares = None if squares is None else squares[:, self._channels]
        noise = self.noise.learnt(squares, sizes, sound)
        loud = noise.velocity
        if squares is not None:
            loud = self._lately.noise(loud, squares[:, self._layout.joints : -6], sizes)
        halves = self._halves.of(samples, window, motion, state, noise, sound)
        halves["sign"] = self._signs(window.counts, sound)
        before = self._half or {name: np.zeros_like(value[:1]) for name, value in halves.items()}
        first = {name: np.concatenate([before[name], value[:-1]]) for name, value in halves.items()}
        follows = np.concatenate([[self._half is not None], sound[:-1]]) & sound
        rows = self._rows(first, halves, noise, loud, follows, trunk)
        self._half = {name: value[-1:] for name, value in halves.items()} if sound[-1] else None
        return rows, singular

    def _sound(self, window: Window, state: State, used: Bools) -> tuple[Bools, list[int | None]]:
        """The `used` blocks (B,) without a near-singular leg, and that of each block. Sums over the samples of others
        are not used, and are made finite.
        """
        by_leg = np.logical_or.reduceat(np.abs(state.volume) < self.flat, window.edges[:-1], axis=0)
        sound = used & ~by_leg.any(axis=1)
        if by_leg.any():
            wrong = ~sound[window.block]
            state.to_wrench[wrong] = state.columns[wrong] = 0.0
        return sound, [int(np.argmax(legs)) if legs.any() else None for legs in by_leg]

    def _signs(self, counts: Ints, sound: Bools) -> Array:
        """Of alternating sums of blocks (B,) of so many samples, as these begin; zero of one with too few samples."""
        signs = self._sign * np.cumprod(np.concatenate([[1.0], np.where(sound, 1.0 - 2.0 * (counts % 2), 1.0)]))
        self._sign = float(signs[-1])
        return np.asarray(signs[:-1] * (counts >= RESOLVED))

    def _rows(
        self, first: Sums, second: Sums, noise: Variances, loud: Array, follows: Bools, trunk: InertialParameters
    ) -> list[BlockRows | None]:
        """Rows of windows from neighbouring blocks; None where no block is before. `loud`: see `Lately.noise`."""
        sums = {name: first[name][:, 0] + second[name][:, 1] for name in SUMMED if name in first}
        sums |= {name: first[name] + second[name] for name in ("averaged", "differentiated")}
        sums |= {name: 0.5 * (first[name] + second[name]) for name in ("probes", "middle")}
        sums["joint"] = joint = sums["joint"].reshape(len(follows), 7, -1)
        J, elapsed = self._layout.joints, second["end"] - first["end"]
        # noise is not motion: a joint that moved beyond it does not stick, another shows no friction or rotor inertia
        speed, loud = joint[:, 1], sums["averaged"][:, None] * loud
        least = np.minimum(_MOVES**2 * loud, np.maximum(_BEYOND**2 * loud, loud + _SPEED**2))
        slides = (joint[:, 2, None] * _SIGNS > _SLIDES) & (speed**2 > least)[:, None]
        if self._limbs is not None:
            of_limbs = sums["limb_motion"][..., 0]
            speed, least = np.hstack([speed, of_limbs]), np.hstack([least, np.full_like(of_limbs, _SLOW**2)])
        still = self._lately.still(speed, least, follows)
        stepping = first["stepping"] | second["stepping"]
        pauses = self._lately.pauses(speed, least, follows)[:, :J] & ~still[:, :J] & stepping[:, None]
        gravity = self._lately.gravity(sums["signals"][:, :3], turned(second["omega"], elapsed), elapsed, follows)
        rests = still[:, :J].all(axis=1) & follows
        self.at_rest.add(sums["signals"][rests, :3], elapsed[rests])
        if self._limbs is not None:
            self._quieten_limbs(sums, first["posture"], still, gravity, follows)
        responses = Responses.of(trunk, sums["probes"])
        columns = self._columns(sums, responses, still[:, :J], gravity)
        C, unresolved = columns[:, :, 11:], sums["alternating"]
        unresolved = trunk_matrix(unresolved[:, :SIGNALS]) @ trunk.vector - unresolved[:, SIGNALS:]
        C[:, :, self._layout.places["sampling"].start] = second["sign"][:, None] * unresolved
        limbs = None
        if self._limbs is not None and len(self._limbs.joints):
            limbs = self._limbs.rows(sums, self._by_mass, still[:, J:])
        white = self._white(sums, responses, noise)
        vague = np.sqrt(STICTION_VELOCITY**2 + sums["averaged"][:, None] * noise.velocity)
        unsure = 1.0 - np.tanh(joint[:, 1] / vague) ** 2
        air, swings = (first[name] & second[name] for name in ("air", "swings"))
        rows: list[BlockRows | None] = [None] * len(follows)
        for b in np.flatnonzero(follows):
            of_joints = air[b], joint[b, :5], joint[b, 5], joint[b, 6], noise.torque[b], slides[b], unsure[b]
            time, own = (float(second["end"][b]), float(elapsed[b])), None if limbs is None else limbs[b]
            swing = SwingRows(*of_joints, bool(stepping[b]), pauses[b], swings[b])
            rows[b] = BlockRows(*time, columns[b], white[b], swing, own)
        return rows

    def _quieten_limbs(self, sums: Sums, posture: Array, still: Bools, gravity: Array, follows: Bools) -> None:
        """Puts what acts on the links of a robot that stands in place of noise, see `LimbRows.quieten`."""
        assert self._limbs is not None
        J, state = self._layout.joints, None
        rests, own = still[:, :J].all(axis=1) & follows, still[:, J:]
        if rests.any():
            q, none, force = posture[rests, :-3], np.zeros((np.count_nonzero(rests), 3)), gravity[rests]
            v, acceleration = moves = np.zeros((2, *q.shape))
            moves[:, :, self._limbs.joints] = (sums["limb_motion"] * ~own[..., None])[rests].transpose(2, 0, 1)
            state = self.body.at(Motion(q, v, acceleration, none, none, force, posture[rests, -3:]), columns=True)
        self._limbs.quieten(sums, rests, state, own)

    def _columns(self, sums: Sums, responses: Responses, still: Bools, gravity: Array) -> Array:
        """Columns (B, 6, 10 + 1 + errors + loads) of A, b, C and loads, see the module's text.

        Args:
            still: (B, J), joints that stand. gravity: (B, 3), see `Lately.gravity`.
        """
        layout, places, signals = self._layout, self._layout.places, sums["signals"]
        B, J, end = len(signals), layout.joints, 11 + layout.count
        columns = np.zeros((B, 6, end + 10 * len(self._places)))
        C, shown, rests = columns[:, :, 11:end], signals.copy(), still.all(axis=1)
        # a robot at rest would show height and inertia, which are columns of accelerations, by their noise
        shown[rests, :3], shown[rests, 3:6] = gravity[rests], 0.0
        columns[:, :, :10], columns[:, :, 10] = trunk_matrix(shown), sums["target"]
        if self._limbs is not None:
            A = trunk_matrix(signals)
            columns[:, :, 10] += A @ self.body.lumped  # the trunk contains the other joints' links at their reference
            self._limbs.add(columns, A, sums["by_links"], self._by_mass)
        self._by_joints(C, sums, sums["joint"], still, signals[:, :3])
        middle, points = sums["middle"], J + 3 * layout.contacts
        C[:, :, places["encoder"]], C[:, :, places["contact"]] = middle[:, :, :J], -middle[:, :, J:points]
        C[:, :, places["unfelt"]] = -middle[:, :, points:]
        by_links = sums["by_links"][:, : layout.links] @ self._by_mass[: layout.links]  # (B, K, 6, 4)
        C[:, :, places["link_mass"]] = -by_links[..., 0].transpose(0, 2, 1)
        C[:, :, places["link_com"]] = -by_links[..., 1:].transpose(0, 2, 3, 1).reshape(B, 6, -1)
        self._by_imu(C, responses.force, responses.turning, signals, gravity)
        jerk = sums["jerk"][..., None]
        C[:, :, places["velocity_lag"]] = responses.turning @ jerk[:, J:] - responses.joints @ jerk[:, :J]
        return columns

    def _white(self, sums: Sums, responses: Responses, noise: Variances) -> Array:
        """Variances (B, 6) of the rows' white noise."""
        K, L, G = responses
        L = L + K @ skew(self._lever)
        white = sums["squared"] + (sums["averaged"] * noise.accelerometer)[:, None] * (K * K).sum(axis=2)
        by_velocity = ((G * G) @ noise.velocity[:, :, None])[:, :, 0] + noise.gyro[:, None] * (L * L).sum(axis=2)
        return np.asarray(_OVERLAP * white + _TELESCOPED * sums["differentiated"][:, None] * by_velocity)

    def _by_joints(self, C: Array, sums: Sums, joint: Array, still: Bools, specific: Array) -> None:
        """Writes the columns (B, 6, errors) of rotors, friction, offsets, gains and lag of the torques.

        Args:
            joint: (B, 7, J), see `HalfWindows.of`. still: (B, J), joints that stand. specific: (B, 3), the mean
                specific force.
        """
        places = self._layout.places
        by_terms = -sums["by_terms"].transpose(3, 0, 2, 1)  # (terms, B, 6, J)
        # signs such that positive static friction lifts the trunk, as in all joints of a robot that sags
        offset = by_terms[TERMS.index("offset")]
        lifts = np.sign((offset[:, :3] * specific[:, :, None]).sum(axis=1))
        # by the mean direction: noise of single velocities is no motion, and a slow joint does not stick whole
        stuck = np.sqrt(np.maximum(1.0 - (joint[:, 2] / np.maximum(joint[:, 4], 1e-9)) ** 2, 0.0))
        C[:, :, places["stiction"]] = offset * (-lifts * still * stuck)[:, None]
        C[:, :, places["standstill"]] = offset * (~still * stuck)[:, None]
        by_terms[:_OF_MOTION] *= ~still[:, None]
        for name, values in zip(TERMS, by_terms, strict=True):
            C[:, :, places[name]] = values
        C[:, :, places["torque_lag"]] = sums["by_rate"][:, :, None]
        C[:, :, places["common_gain"]] = C[:, :, places["gain"]].sum(axis=2, keepdims=True)

    def _by_imu(self, C: Array, K: Array, L: Array, signals: Array, average: Array) -> None:
        """Writes the columns (B, 6, errors) of the IMU's place, axes, offset and response.

        Args:
            K, L: (B, 6, 3), see the module's text. signals: (B, 12). average: (B, 3), see `Lately.gravity`.
        """
        places = self._layout.places
        a, alpha, spin = signals_of(signals)
        turning = skews(alpha)
        C[:, :, places["imu_lever"]] = -K @ (turning + spin)
        C[:, :, places["imu_rotation"]] = K @ skews(a) + L @ turning
        C[:, :, places["accelerometer"]] = -K
        C[:, :, places["imu_response"]] = -K * (a - average)[:, None]


def signals_of(signals: Array) -> tuple[Array, Array, Array]:
    """Specific force and angular acceleration (..., 3), and [ω]x [ω]x (..., 3, 3) = ω ωᵀ - ω² 1, from the twelve
    signals (..., 12).
    """
    square = signals[..., 6:][..., _SQUARE]
    trace = np.trace(square, axis1=-2, axis2=-1)
    return signals[..., :3], signals[..., 3:6], np.asarray(square - trace[..., None, None] * _UNIT)
