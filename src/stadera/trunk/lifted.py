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
from stadera.trunk.settings import SwingDetection
from stadera.types import Array, Bools

_STANDING = 0.05  # smoothing factor of each foot's usual height, for blocks in which it is loaded


class Lifted:
    """Finds legs in the air, block by block.

    Args:
        body: the robot. swing: the criteria. weight: of the robot [N]. length: of a leg [m].

    Attributes:
        known, known_std: (3, joints), rotor inertia, viscous and Coulomb friction of the legs' joints beyond the
            model's, and their standard deviations.
    """

    def __init__(self, body: Body, swing: SwingDetection, weight: float, length: float) -> None:
        self._legs, self._starts, self._swing = body.in_legs, body.starts, swing
        self._weight, self._length = weight, length
        self.known, self.known_std = np.zeros((2, 3, len(body.in_legs)))
        self._standing = np.zeros(
            len(body.legs)
        )  # m, by how much each foot lies higher than the others when it carries
        self._others = np.ones((len(body.legs),) * 2) - np.eye(len(body.legs))

    def legs(self, state: State, motion: Motion, force: Array, sure: Array, step: float) -> Bools:
        """Legs in the air throughout a block, (legs,).

        Args:
            force: (n, legs, 3) [N], of the model as it is. sure: (n, joints), smoothed sign of the velocities.
            step: between samples [s].
        """
        swing, n, J = self._swing, len(force), self._legs
        E = state.to_wrench[:, J, :3]
        moved = np.stack([motion.acceleration[:, J], motion.velocity[:, J], sure], axis=1)  # (n, 3, joints)
        torque = (self.known * moved).sum(axis=1)
        unsure = ((E * E).sum(axis=2)) * ((self.known_std * moved) ** 2).sum(
            axis=1
        )  # (n, joints), of the force squared
        felt = np.concatenate([E * torque[..., None], unsure[..., None]], axis=2)
        seen = np.empty((n, force.shape[1], 8))
        seen[..., :4] = np.add.reduceat(felt, self._starts, axis=1)
        seen[..., :3] += force
        seen[..., 4:7], seen[..., 7] = state.pace, state.feet @ motion.normal
        parts = min(max(round(n * step / swing.part), 1), n)
        begin = np.arange(parts) * n // parts
        seen = np.add.reduceat(seen, begin, axis=0) / np.diff(np.append(begin, n))[:, None, None]
        force, pace, height = seen[..., :3], seen[..., 4:7], seen[..., 7] - self._standing
        limit = np.minimum((swing.load * self._weight) ** 2 + seen[..., 3], self._weight**2)
        light, along = (force * force).sum(axis=2) < limit, force @ motion.normal
        pressed = np.maximum(along, 0.0)
        share, carried = np.maximum(pressed @ self._others, 1e-9), along @ self._others
        lifted = height - (pressed * height) @ self._others / share
        pace = pace - np.einsum("pl,plc,lm->pmc", pressed, pace, self._others) / share[..., None]
        up = lifted > swing.lift * self._length
        moves = (pace * pace).sum(axis=2) > swing.speed**2 * GRAVITY * self._length
        stands = ((along > swing.load * self._weight) & ~up).all(axis=0)
        self._standing += _STANDING * np.where(stands, lifted.mean(axis=0), 0.0)
        return np.asarray(((up | moves) & light & (carried > swing.carried * self._weight)).all(axis=0))
