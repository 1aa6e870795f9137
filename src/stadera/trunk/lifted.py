"""Tells which legs are in the air: their feet are off the ground and lightly loaded, while the others carry the robot.

A foot is off the ground if it is higher than the others, or moves relative to them. Feet that stand have the same
velocity -v relative to the trunk, once the trunk's rotation is taken out: ω x p + J q̇ = -v. Accelerations are
differences of noisy velocities; in averages over consecutive samples these cancel but for the first and the last, so
what a foot seems to carry depends little on the log's rate. The limit allows for the joints' uncertainty with the
accelerations of single samples, so it is somewhat higher in a noisy log at 1 kHz.
"""

from __future__ import annotations

import numpy as np

from stadera.body import Body, Motion, State
from stadera.constants import GRAVITY
from stadera.trunk.row_kernel import lifted_legs
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
        self._joints, self._legs, self._part = body.in_legs, body.leg_of[body.in_legs], swing.part
        light, fast = swing.load * weight, swing.speed**2 * GRAVITY * length
        limits = [swing.lift * length, fast, light**2, weight**2, swing.carried * weight]
        self._limits = np.array(limits)
        self.known, self.known_std = np.zeros((2, 3, len(body.in_legs)))

    def legs(self, state: State, motion: Motion, force: Array, sure: Array, step: float) -> Bools:
        """Legs in the air throughout a block, (legs,).

        Args:
            force: (n, legs, 3) [N], of the model as it is. sure: (n, joints), smoothed sign of the velocities.
            step: between samples [s].
        """
        n, J, motions = len(force), self._joints, (motion.acceleration, motion.velocity)
        moved = np.stack([*(x[:, J] for x in motions), sure], axis=1)
        parts, air = min(max(round(n * step / self._part), 1), n), np.empty(force.shape[1], dtype=bool)
        known = np.ascontiguousarray(self.known), np.ascontiguousarray(self.known_std)
        places = state.feet, state.pace, motion.normal
        lifted_legs(J, self._legs, state.to_wrench, force, moved, *known, *places, parts, self._limits, air)
        return air
