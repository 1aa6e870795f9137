"""Tells which legs are in the air: their feet are off the ground and lightly loaded, while the others carry the robot.

A foot is off the ground if it is higher than the others, or moves relative to them. Feet that stand have the same
velocity -v relative to the trunk, once the trunk's rotation is taken out: ω x p + J q̇ = -v. Accelerations are
differences of noisy velocities; in averages over consecutive samples these cancel but for the first and the last, so
what a foot seems to carry depends little on the log's rate. The limit allows for the joints' uncertainty with the
accelerations of single samples, so it is somewhat higher in a noisy log at 1 kHz.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stadera.body import Body, Motion, State
from stadera.constants import GRAVITY
from stadera.trunk.settings import SwingDetection
from stadera.types import Array, Bools


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
    ) -> Bools:
        """Legs in the air throughout each of B blocks, (B, legs).

        Args:
            force: (n, legs, 3) [N], of the model as it is. sure: (n, joints), smoothed sign of the velocities.
            step: (B,), between samples [s]. edges: (B + 1,), of the blocks.
        """
        J, n = self._joints, np.diff(edges)
        parts = np.minimum(np.maximum(np.rint(n * step / self._part), 1), n).astype(np.int64)  # averages of each block
        each = zip(edges[:-1], parts, n, strict=True)
        begin = np.concatenate([edge + np.arange(count) * size // count for edge, count, size in each])
        block, counts = np.repeat(np.arange(len(n)), parts), np.diff(begin, append=edges[-1])[:, None]

        def mean(values: Array) -> Array:
            return np.asarray(np.add.reduceat(values, begin) / counts.reshape(-1, *[1] * (values.ndim - 1)))

        E, moved = state.to_wrench[:, J, :3], np.stack([motion.acceleration[:, J], motion.velocity[:, J], sure])
        torque = (self.known[:, None] * moved).sum(axis=0)
        variance = ((self.known_std[:, None] * moved) ** 2).sum(axis=0)
        felt = mean(force + np.add.reduceat(E * torque[..., None], self._starts, axis=1))
        unsure = mean(np.add.reduceat((E * E).sum(axis=2) * variance, self._starts, axis=1))
        height, pace = mean(np.vecdot(state.feet, motion.normal[:, None])), mean(state.pace)
        along = np.vecdot(felt, motion.normal[edges[:-1]][block, None])
        press, others = np.maximum(along, 0.0), 1.0 - np.eye(along.shape[1])
        pressed = np.maximum(press @ others, 1e-9)
        raised = height - (press * height) @ others / pressed
        away = pace - others @ (press[..., None] * pace) / pressed[..., None]
        off = (raised > self._lift) | ((away * away).sum(axis=2) > self._fast)
        light = (felt * felt).sum(axis=2) < np.minimum(self._light + unsure, self._weight)
        air = off & light & (along @ others > self._carried)
        return np.asarray(np.logical_and.reduceat(air, np.cumsum(parts) - parts))

    def stepping(self, pace: Array, edges: NDArray[np.int64]) -> Bools:
        """Blocks (B,) in which a foot moves relative to the others, fast enough to be lifted: those of a walk.

        Args:
            pace: (n, legs, 3) [m/s], velocities of the feet, the trunk's rotation taken out. edges: see `legs`.
        """
        mean = np.add.reduceat(pace, edges[:-1]) / np.diff(edges)[:, None, None]
        apart = mean - np.median(mean, axis=1, keepdims=True)
        return np.asarray(((apart * apart).sum(axis=2) > self._fast).any(axis=1))
