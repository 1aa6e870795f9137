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
from stadera.compiled import compiled, load
from stadera.constants import GRAVITY
from stadera.trunk.settings import SwingDetection
from stadera.types import Array, Bools

Ints = NDArray[np.int64]


class Lifted:
    """Finds legs in the air, block by block.

    Args:
        body: the robot. swing: the criteria. weight: of the robot [N]. length: of a leg [m].

    Attributes:
        known, known_std: (3, joints), rotor inertia, viscous and Coulomb friction of the legs' joints beyond the
            model's, and their standard deviations.
    """

    def __init__(self, body: Body, swing: SwingDetection, weight: float, length: float) -> None:
        load(_lifted)
        self._joints, self._legs, self._part = body.in_legs, body.leg_of[body.in_legs], swing.part
        light, fast = swing.load * weight, swing.speed**2 * GRAVITY * length
        limits = [swing.lift * length, fast, light**2, weight**2, swing.carried * weight]
        self._limits = np.array(limits)
        self.known, self.known_std = np.zeros((2, 3, len(body.in_legs)))

    def legs(self, state: State, motion: Motion, force: Array, sure: Array, step: Array, edges: Ints) -> Bools:
        """Legs in the air throughout each of B blocks, (B, legs).

        Args:
            force: (n, legs, 3) [N], of the model as it is. sure: (n, joints), smoothed sign of the velocities.
            step: (B,), between samples [s]. edges: (B + 1,), of the blocks.
        """
        J, n = self._joints, np.diff(edges)
        moved = np.ascontiguousarray(np.stack([motion.acceleration[:, J], motion.velocity[:, J], sure], axis=1))
        parts = np.minimum(np.maximum(np.rint(n * step / self._part), 1), n).astype(np.int64)
        air = np.empty((len(n), force.shape[1]), dtype=bool)
        known = np.ascontiguousarray(self.known), np.ascontiguousarray(self.known_std)
        places = state.feet, state.pace, motion.normal
        _lifted(J, self._legs, state.to_wrench, force, moved, *known, *places, edges, parts, self._limits, air)
        return air

    def stepping(self, pace: Array, edges: Ints) -> Bools:
        """Blocks (B,) in which a foot moves relative to the others, fast enough to be lifted: those of a walk.

        Args:
            pace: (n, legs, 3) [m/s], velocities of the feet, the trunk's rotation taken out. edges: see `legs`.
        """
        mean = np.add.reduceat(pace, edges[:-1]) / np.diff(edges)[:, None, None]
        apart = mean - np.median(mean, axis=1, keepdims=True)
        return np.asarray(((apart * apart).sum(axis=2) > self._limits[1]).any(axis=1))


@compiled(
    "void(int64[::1], int64[::1], float64[:,:,::1], float64[:,:,::1], float64[:,:,::1], float64[:,::1], "
    "float64[:,::1], float64[:,:,::1], float64[:,:,::1], float64[:,::1], int64[::1], int64[::1], float64[::1], "
    "boolean[:,::1])"
)
def _lifted(
    joints: Ints,
    legs: Ints,
    E: Array,
    force: Array,
    moved: Array,
    known: Array,
    known_std: Array,
    feet: Array,
    pace: Array,
    normal: Array,
    edges: Ints,
    parts: Ints,
    limits: Array,
    air: Bools,
) -> None:
    """Legs in the air throughout each of B blocks of n samples in all, see the module.

    Args:
        joints, legs: (J,), of the joints in the legs, their place among all and their leg. E: of a `State`.
        force, feet, pace: (n, legs, 3).
        moved: (n, 3, J), q̈, q̇ and s of the joints. known, known_std: (3, J).
        normal: (n, 3), of the ground. edges: (B + 1,), of the blocks. parts: (B,), numbers of averages over each.
        limits: height of a lifted foot [m]; squared speed of one that moves [m²/s²]; squared force of a light one, the
            robot's weight squared [N²]; load of the others [N].
        air: (B, legs), written.
    """
    count = force.shape[1]
    for b in range(len(parts)):
        first, n = edges[b], edges[b + 1] - edges[b]
        for leg in range(count):
            air[b, leg] = True
        for p in range(parts[b]):
            begin, end = first + p * n // parts[b], first + (p + 1) * n // parts[b]
            felt, speed = np.zeros((count, 3)), np.zeros((count, 3))
            height, unsure, along = np.zeros(count), np.zeros(count), np.zeros(count)
            for k in range(begin, end):
                for j in range(len(joints)):
                    torque = variance = square = 0.0
                    for t in range(3):
                        torque += known[t, j] * moved[k, t, j]
                        variance += (known_std[t, j] * moved[k, t, j]) ** 2
                    for c in range(3):
                        felt[legs[j], c] += E[k, joints[j], c] * torque / (end - begin)
                        square += E[k, joints[j], c] ** 2
                    unsure[legs[j]] += square * variance / (end - begin)
                for leg in range(count):
                    for c in range(3):
                        felt[leg, c] += force[k, leg, c] / (end - begin)
                        speed[leg, c] += pace[k, leg, c] / (end - begin)
                        height[leg] += feet[k, leg, c] * normal[k, c] / (end - begin)
            for leg in range(count):
                for c in range(3):
                    along[leg] += felt[leg, c] * normal[first, c]
            for leg in range(count):
                carried = pressed = level = x = y = z = 0.0
                for other in range(count):
                    if other != leg:
                        press = max(along[other], 0.0)
                        carried += along[other]
                        pressed += press
                        level += press * height[other]
                        x, y, z = x + press * speed[other, 0], y + press * speed[other, 1], z + press * speed[other, 2]
                pressed = max(pressed, 1e-9)
                raised, square = height[leg] - level / pressed, 0.0
                x, y, z = speed[leg, 0] - x / pressed, speed[leg, 1] - y / pressed, speed[leg, 2] - z / pressed
                fast = x * x + y * y + z * z
                for c in range(3):
                    square += felt[leg, c] ** 2
                light = square < min(limits[2] + unsure[leg], limits[3])
                air[b, leg] &= (raised > limits[0] or fast > limits[1]) and light and carried > limits[4]
