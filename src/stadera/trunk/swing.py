"""Estimates the joints' rotor inertia, friction and offset from legs that swing in the air, and finds these.

A leg in the air has no contact force, so each of its joints obeys

    h + I_r q̈ + b q̇ + (c + k |τ|) s + o = τ(t),        τ(t) = τ_measured(t) + d τ̇_measured(t)

with h of the rigid bodies, s the smoothed sign of q̇ and d the torques' lag, common to all joints. The trunk's mass
does not enter these rows, so wrong torques under load cannot affect them. A friction law errs alike over a whole swing,
so `repeated` rows count as one. A joint that sticks is held by any torque up to its friction c: once c is known, its
rows have the variance (1 - s²) c² beside that. Without it the noise of its velocity passes for sliding, and abduction
joints of a straight trot seem to have a third of their friction and an offset of the rest.

**Which legs are in the air**: their feet are off the ground and lightly loaded, while the others carry the robot.
A foot is off the ground if it is higher than the others, or moves relative to them. Feet that stand have the same
velocity -v relative to the trunk, once the trunk's rotation is taken out: ω x p + J q̇ = -v. Accelerations are
differences of noisy velocities; in averages over consecutive samples these cancel but for the first and the last, so
what a foot seems to carry depends little on the log's rate. The limit allows for the joints' uncertainty with the
accelerations of single samples, so it is somewhat higher in a noisy log at 1 kHz.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from stadera.body import Body, Motion, State
from stadera.constants import GRAVITY, MEDIAN_OF_CHI2
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.settings import SwingDetection
from stadera.types import Array, Bools

_NONE = 1e-18  # variance of an error that a user takes to be none
_ROUNDING = 1e-12  # of a variance


class SwingJoints:
    """Least squares over swing rows, around the prior.

    Args:
        errors: the prior.
        settings: of swing rows.

    Attributes:
        root: L (errors, errors) of the prior L Lᵀ. rows: number of rows so far, by their weights.
        stepped: [N·m] by joint, by how much the recorded torque departs from the law that holds at first, if an average
            over successive rows is beyond all usual ones and what is not known of that law, as after a jump of a
            torque sensor or with an offset far beyond its prior size; else zero.
        swings: (2, legs), number of blocks in which a leg swings, and of those in which it is in the air.
    """

    def __init__(self, errors: ErrorModel, settings: SwingDetection) -> None:
        layout, count = errors.layout, errors.layout.by_swing.stop
        self._limit, self._settings, self._legs = errors.limit, settings, layout.legs
        self._each, self._lag = np.arange(layout.joints), layout.places["torque_lag"].start
        laws = [layout.places[name].start for name in ("rotor", "viscous", "coulomb", "load_friction", "offset")]
        self._at = np.array(laws)[:, None] + self._each
        prior = errors.covariance[layout.by_swing, layout.by_swing]
        self.root = root_of(prior)
        self._prior = np.linalg.inv(prior + np.diag(np.where(np.diagonal(prior) > 0.0, 0.0, _NONE)))
        self._normal, self._right = np.zeros((count, count)), np.zeros(count)
        self._square, self.rows = 0.0, 0.0
        self._last, self._typical = np.zeros(count), np.inf
        self._dry, self._coulomb, self._square_held = errors.dry, layout.places["coulomb"], errors.resting**2
        self._first: list[tuple[Array, Array, Array, Array, NDArray[np.int64]]] | None = []
        self._expected, self._unknown, self._loud = np.zeros(count), np.zeros((layout.joints, 6, 6)), np.inf
        self._averaged, self._average, self.stepped = np.zeros((3, layout.joints))
        self.swings = np.zeros((2, len(layout.legs)))
        self._row = np.zeros((layout.joints, 6))
        self._found: tuple[Array, Array, float] | None = None

    def add(self, air: Bools, terms: Array, rate: Array, residual: Array, white: Array, unsure: Array) -> None:
        """Adds one block.

        Args:
            air: (legs,) bool, the legs in the air throughout the block.
            terms: (5, joints), averages of q̈, q̇, s, s |τ| and 1 by joint.
            rate: (joints,) [N·m/s], of the torques. residual: (joints,) [N·m], h - τ_measured.
            white: (joints,) [N·m], standard deviation of its white noise.
            unsure: (joints,), variance 1 - s² of the direction of friction [1].
        """
        rows = np.zeros((len(rate), len(self._right)))
        rows[self._each, self._at] = terms
        rows[:, self._lag] = -rate
        own, swinging = white**2 + (self._settings.residual * self._limit) ** 2, np.repeat(air, self._legs)
        weight = 1.0 / (own + unsure * self._square_held / self._typical)
        sizes = np.column_stack([terms.T, -rate])
        self._compare(swinging * (1.0 - unsure), residual + rows @ self._expected, weight, sizes)
        if not swinging.any():
            return
        if self._first is not None:
            joint = self._each[swinging]
            self._first.append((rows[joint], residual[joint], own[joint], unsure[joint], joint))
        self._sum(rows[swinging], residual[swinging], weight[swinging])

    def _sum(self, rows: Array, residual: Array, weight: Array) -> None:
        """Adds rows, each with the weight of Student's t at its residual."""
        share = np.ones(len(rows))
        if self._typical < np.inf:
            freedom, square = self._settings.freedom, weight * (residual + rows @ self._last) ** 2
            share = (freedom + 1.0) / (freedom + square / self._typical)
        weighted = (share * weight)[:, None] * rows
        self._normal += weighted.T @ rows
        self._right -= weighted.T @ residual
        self._square += float((share * weight) @ residual**2)
        self.rows += float(share.sum())
        self._found = None

    def _sum_anew(self) -> None:
        """Weighs the first rows, which were summed before the law was known, by what they leave of it together."""
        assert self._first is not None
        rows, residual, own, unsure, joint = (np.concatenate(part) for part in zip(*self._first, strict=True))
        self._last = self._least_squares(np.ones(len(self._right)))[0]
        self._typical, self._first = self._typical_at(self._last), None
        for _ in range(4):
            self._square, self.rows = 0.0, 0.0
            self._normal, self._right = np.zeros_like(self._normal), np.zeros_like(self._right)
            self._sum(rows, residual, 1.0 / (own + unsure * self._square_held[joint] / self._typical))
            self._learn(*self._least_squares(np.ones(len(self._right))))

    def _typical_at(self, mean: Array) -> float:
        """Usual variance of the rows at a law, share of the stated one: by the median, which no single joint moves."""
        if self._first is None:
            return self._typical
        square = np.concatenate([(residual + rows @ mean) ** 2 / own for rows, residual, own, _, _ in self._first])
        return max(float(np.median(square)) / MEDIAN_OF_CHI2, self._settings.quietest)

    def _learn(self, mean: Array, covariance: Array, loud: float) -> None:
        """Takes the law by which later rows are weighed."""
        self._last, self._typical = mean, loud / self._settings.repeated
        self._square_held = (self._dry + mean[self._coulomb]) ** 2 + np.diagonal(covariance)[self._coulomb]

    def _compare(self, swinging: Array, residual: Array, weight: Array, row: Array) -> None:
        """Averages the latest residuals and rows (joints, 6) of each joint, as far as it slides, and keeps residuals
        beyond the usual ones.
        """
        if self._loud == np.inf:
            return
        share = swinging / self._settings.recent
        self._averaged += share * (1.0 - self._averaged)
        self._average += share * (residual - self._average)
        self._row += share[:, None] * (row - self._row)
        scale = np.maximum(self._averaged, 1e-9)
        mean, row = self._average / scale, self._row / scale[:, None]
        variance = self._loud / weight + np.einsum("jk,jkl,jl->j", row, self._unknown, row)
        large = (self._averaged > 0.5) & (np.abs(mean) > self._settings.step * self._limit)
        large &= mean**2 > self._settings.wild_step**2 * variance
        self.stepped[:] = np.where(large & (np.abs(mean) > np.abs(self.stepped)), -mean, self.stepped)

    def count(self, swings: Bools, air: Bools) -> None:
        """Counts a block in which legs (legs,) swing, and are in the air."""
        self.swings[0] += swings
        self.swings[1] += air

    @property
    def heavy(self) -> Bools:
        """Legs (legs,) that carry by their torques while they swing, where the others are in the air. An offset of a
        knee's torque by a fifth of its limit carries as much as a foot may. The rougher all swings are, the more the
        legs of a sound robot differ; each has more than half the square of the usual share.
        """
        swings, air = self.swings
        share, settings = air / np.maximum(swings, 1.0), self._settings
        usual = float(np.median(share))
        return np.asarray((usual > settings.usual_air) & (share < 0.5 * usual**2) & (swings >= settings.fewest_swings))

    @property
    def information(self) -> tuple[Array, Array]:
        """Normal matrix (count, count) and right side (count,) of the rows, in units of what repeats."""
        _, _, loud = self._usual
        return self._normal / loud, self._right / loud

    def posterior(self, scale: Array | None = None, *, strides_alike: bool = False) -> tuple[Array, Array]:
        """Mean and covariance of the errors that swing rows determine, `ErrorLayout.by_swing`.

        Args:
            scale: factors (count,) on the prior's standard deviations; None for one.
            strides_alike: whether a friction law errs alike in all: more than `strides` rows of a joint tell nothing
                new.
        """
        strides = self.rows / (self._settings.strides * len(self._each)) if strides_alike else 1.0
        if scale is None and strides <= 1.0:
            return self._usual[:2]
        return self._least_squares(np.ones(len(self._right)) if scale is None else scale, max(strides, 1.0))[:2]

    @property
    def _usual(self) -> tuple[Array, Array, float]:
        """Mean, covariance and variance of what repeats, with the errors at their prior size."""
        if self._found is not None:
            return self._found
        count = len(self._right)
        known = self.rows > self._settings.enough * count
        if known and self._first is not None:
            self._sum_anew()
        mean, covariance, _ = self._found = self._least_squares(np.ones(count))
        if self.rows > 2 * count and self._loud == np.inf:  # compared with the log's beginning
            self._expected, self._loud = mean, self._typical_at(mean)
            at = np.column_stack([self._at.T, np.full(len(self._each), self._lag)])
            self._unknown = covariance[at[:, :, None], at[:, None]]
        if known:
            self._learn(*self._found)
        return self._found

    def _least_squares(self, scale: Array, strides: float = 1.0) -> tuple[Array, Array, float]:
        repeated = self._settings.repeated * strides
        loud, prior, mean = repeated, self._prior / np.multiply.outer(scale, scale), self._right
        factor = prior
        for _ in range(2):  # the second pass uses the first one's residual
            factor = lapack.dpotrf(self._normal / loud + prior)[0]
            mean = lapack.dpotrs(factor, self._right / loud)[0]
            if self.rows > len(mean):
                square = self._square - mean @ (2.0 * self._right - self._normal @ mean)
                loud = repeated * max(float(square) / self.rows, self._settings.quietest)
        root = lapack.dtrtri(factor)[0]
        return np.asarray(mean), np.asarray(root @ root.T), loud


def root_of(covariance: Array) -> Array:
    """L of a covariance L Lᵀ (n, n), which is singular where errors are known exactly."""
    size = np.sqrt(np.diagonal(covariance))
    correlation = covariance / np.outer(*2 * [np.where(size > 0.0, size, 1.0)])
    correlation.flat[:: len(size) + 1] += _ROUNDING
    return np.asarray(size[:, None] * np.linalg.cholesky(correlation))


class Lifted:
    """Finds legs in the air, block by block.

    Args:
        body: the robot. swing: the criteria. weight: of the robot [N]. length: of a leg [m].

    Attributes:
        known, known_std: (3, joints), rotor inertia, viscous and Coulomb friction of the legs' joints beyond the
            model's, and their standard deviations.
    """

    def __init__(self, body: Body, swing: SwingDetection, weight: float, length: float) -> None:
        self._joints, self._starts, self._part = body.in_legs, body.starts, swing.part
        self._lift, self._fast = swing.lift * length, swing.speed**2 * GRAVITY * length
        self._light, self._weight, self._carried = (swing.load * weight) ** 2, weight**2, swing.carried * weight
        self.known, self.known_std = np.zeros((2, 3, len(body.in_legs)))

    def legs(
        self, state: State, motion: Motion, force: Array, sure: Array, step: Array, edges: NDArray[np.int64]
    ) -> tuple[Bools, Bools]:
        """Legs that swing while the others carry the robot, and those of them that are in the air, throughout each of B
        blocks, (B, legs).

        Args:
            force: (n, legs, 3) [N], of the model as it is. sure: (n, joints), smoothed sign of the velocities.
            step: (B,), between samples [s]. edges: (B + 1,), of the blocks.
        """
        J, n = self._joints, np.diff(edges)
        parts = np.minimum(np.maximum(np.rint(n * step / self._part), 1), n).astype(np.int64)  # averages of each block
        each = zip(edges[:-1], parts, n, strict=True)
        begin = np.concatenate([edge + np.arange(count) * size // count for edge, count, size in each])
        block, counts = np.repeat(np.arange(len(n)), parts), np.diff(np.append(begin, edges[-1]))
        E, moved = state.to_wrench[:, J, :3], np.stack([motion.acceleration[:, J], motion.velocity[:, J], sure])
        torque = (self.known[:, None] * moved).sum(axis=0)
        variance = ((self.known_std[:, None] * moved) ** 2).sum(axis=0)
        felt = force + np.add.reduceat(E * torque[..., None], self._starts, axis=1)
        unsure = np.add.reduceat((E * E).sum(axis=2) * variance, self._starts, axis=1)
        parted = np.dstack([felt, state.pace, unsure, np.vecdot(state.feet, motion.normal[:, None])])
        mean = np.add.reduceat(parted, begin) / counts[:, None, None]
        felt, pace, unsure, height = mean[..., :3], mean[..., 3:6], mean[..., 6], mean[..., 7]
        along = np.vecdot(felt, motion.normal[edges[:-1]][block, None])
        press, others = np.maximum(along, 0.0), 1.0 - np.eye(along.shape[1])
        pressed = np.maximum(press @ others, 1e-9)
        raised = height - (press * height) @ others / pressed
        away = pace - others @ (press[..., None] * pace) / pressed[..., None]
        off = (raised > self._lift) | ((away * away).sum(axis=2) > self._fast)
        light = (felt * felt).sum(axis=2) < np.minimum(self._light + unsure, self._weight)
        swings, first = off & (along @ others > self._carried), np.cumsum(parts) - parts
        throughout, in_air = (np.logical_and.reduceat(each, first) for each in (swings, swings & light))
        return np.asarray(throughout), np.asarray(in_air)

    def stepping(self, pace: Array, edges: NDArray[np.int64]) -> Bools:
        """Blocks (B,) in which a foot moves relative to the others, fast enough to be lifted: those of a walk.

        Args:
            pace: (n, legs, 3) [m/s], velocities of the feet, the trunk's rotation taken out. edges: see `legs`.
        """
        mean = np.add.reduceat(pace, edges[:-1]) / np.diff(edges)[:, None, None]
        apart = mean - np.median(mean, axis=1, keepdims=True)
        return np.asarray(((apart * apart).sum(axis=2) > self._fast).any(axis=1))
