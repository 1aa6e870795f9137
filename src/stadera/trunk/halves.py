"""What the samples of a block add to rows (`stadera.trunk.rows`): sums weighted by the halves of a window."""

from __future__ import annotations

from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stadera.body import Body, Motion, State
from stadera.body.friction import direction
from stadera.body.kernel import evaluate
from stadera.compiled import load
from stadera.trunk.limbs import LIMB_SUMS, LimbRows
from stadera.trunk.noise import Variances
from stadera.trunk.samples import Samples
from stadera.trunk.swing import Lifted
from stadera.trunk.window import Window, block_sums
from stadera.trunk.wrench import SIGNALS, trunk_signals
from stadera.types import Array, Bools

_STEP = 1e-4  # rad, of the differences by joint positions
_UNIT = np.eye(3)

TERMS = ("rotor", "viscous", "coulomb", "load_friction", "offset", "gain")
"""Errors of the legs' torques by joint, in the order of the sums `by_terms`."""

SUMMED = ("signals", "target", "jerk", "joint", "alternating", "by_rate", "squared", "by_terms", "by_links", *LIMB_SUMS)
"""Sums of which a window has the rising half of one block and the falling half of the next."""

Sums = dict[str, NDArray[Any]]
"""Sums over B blocks by name, see `HalfWindows.of`."""


class HalfWindows:
    """Sums over the samples of blocks.

    Args:
        body: the robot as a tree. limbs: its rows of other joints, None without. lifted: tells legs in the air.
        unfelt: legs with a moment or force that their joints do not tell.
    """

    def __init__(self, body: Body, limbs: LimbRows | None, lifted: Lifted, unfelt: tuple[int, ...]) -> None:
        load(evaluate, block_sums)
        self._body, self._limbs, self._lifted, self._unfelt = body, limbs, lifted, list(unfelt)
        self._joints = body.in_legs
        self._order = np.concatenate([np.arange(len(leg)) for leg in body.legs])  # of each joint in its leg

    def of(
        self, samples: Samples, window: Window, motion: Motion, state: State, noise: Variances, sound: Bools
    ) -> Sums:
        """Sums over B blocks, of a robot with J joints in its legs, K links and L feet, by name:

        signals, target, jerk, joint: (B, 2, ...), weighted by the rising and by the falling half, of the trunk's
            signals (12), b (6), the derivatives of accelerations (J + 3), and seven numbers of each joint (7 J): q̈, q̇,
            s, s |τ|, 1, τ̇, h - τ.
        alternating: (B, 2, 18), of signals and target, with signs that alternate from sample to sample.
        by_rate, squared: (B, 2, 6), of E τ̇, and, with w² for w, of E σ² Eᵀ of white torque noise.
        by_terms, by_links: (B, 2, J, 6, terms) and (B, 2, K, 6, 10), of E times q̈, q̇, s, s |τ|, 1 and τ, and of
            `State.columns`.
        probes, middle: see `_slopes`. omega: (B, 3), mean. swings, air: (B, L), see `Lifted.legs`. stepping: (B,).
        end: (B,) [s]. averaged, differentiated: (B,), Σ w², and the same of differences in time [1/s²].
        limb_...: see `LimbRows.sums`. posture: (B, n + 3), joints and ground's normal at the end, of a robot with
            limbs.
        """
        J, body, halves = self._joints, self._body, window.halves
        span, E = (samples.time[2:] - samples.time[:-2])[:, None], state.to_wrench[:, J]
        tau, rate = samples.effort[1:-1, J], (samples.effort[2:, J] - samples.effort[:-2, J]) / span
        acceleration, velocity = motion.acceleration[:, J], motion.velocity[:, J]
        smooth, carried = np.split(window.line(np.hstack([velocity, tau])), 2, axis=1)
        sure, one = direction(smooth), np.ones(tau.shape)
        left = state.torque[:, J] + body.viscous[J] * velocity + body.coulomb[J] * sure + body.offset[J] - tau
        terms = acceleration, velocity, sure, sure * np.abs(carried), one
        turning = np.hstack([samples.velocity[:, J], samples.angular_velocity])
        parts = {
            "signals": trunk_signals(
                motion.specific_force.T, motion.angular_velocity.T, motion.angular_acceleration.T
            ).T,
            "target": body.target(state, contacts := body.contacts(state, left)),
            "jerk": (turning[2:] - 2.0 * turning[1:-1] + turning[:-2]) / (0.5 * span) ** 2,
            "joint": np.hstack([*terms, rate, left]),
            "by_rate": (E * rate[..., None]).sum(axis=1),
        }
        summed = window.sums(window.both, np.hstack([*parts.values()]))
        out: Sums = {}
        for name, stop in zip(parts, accumulate(part.shape[1] for part in parts.values()), strict=True):
            out[name] = summed[:, :2, stop - parts[name].shape[1] : stop]
        out["alternating"] = summed[:, 2:, : SIGNALS + 6]
        out["squared"] = window.sums(halves**2, (E * E * noise.torque[window.block][..., None]).sum(axis=1))
        out["by_terms"] = window.sums(halves, E[..., None] * np.stack([*terms, tau], axis=-1)[:, :, None])
        out["by_links"] = window.sums(halves, state.columns)
        out["probes"], out["middle"] = self._slopes(window, motion, tau, sound)
        end, begin, after = samples.time[window.edges[1:]], samples.time[window.edges[:-1] + 1], window.counts - 1
        step = np.where(after > 0, (end - begin) / np.maximum(after, 1), 0.02)
        out["omega"] = window.sums(window.mean, motion.angular_velocity)[:, 0]
        out["swings"], out["air"] = self._lifted.legs(state, motion, contacts[..., :3], sure, step, window.edges)
        out["stepping"] = self._lifted.stepping(state.pace, window.edges)
        out |= {"end": end, "averaged": window.averaged, "differentiated": window.differences / step**2}
        if self._limbs is not None:
            at, count = self._limbs.joints, samples.position.shape[1]
            torque = samples.extra[1:-1, 2 * (len(body.joints) - count) + at - count]
            out |= self._limbs.sums(window.at(samples.time), motion, state, torque)
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
        body, J, order, B = self._body, self._joints, self._order, len(window.edges) - 1
        k, first = window.edges[:-1] + window.counts // 2, 6 + body.most
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
        left = np.ascontiguousarray(h[:, :, J]).reshape(B * N, -1)
        contacts, leg = body.contacts(state, left), body.leg_of[J]
        b = (contacts - state.inertial[:, :-1]).reshape(B, N, -1, 6)
        by_trunk = body.target(state, contacts).reshape(B, N, 6)[:, :6]
        probes = np.concatenate([by_trunk, b[:, 6 + order, leg]], axis=1).swapaxes(1, 2)
        by_position = (b[:, first + 1 + order, leg] - b[:, first, leg]).swapaxes(1, 2) / _STEP
        force = contacts.reshape(B, N, -1, 6)[:, first, :, :3]
        by_contact = body.by_contact(E, axis, force).transpose(0, 2, 1, 3).reshape(B, 6, -1)
        unfelt = state.unfelt.reshape(B, N, -1, 6)[:, first, self._unfelt].transpose(0, 2, 1)
        return probes, np.concatenate([by_position, by_contact, unfelt], axis=2)
