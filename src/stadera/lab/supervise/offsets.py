"""Estimates constant torque offsets from legs in the air, which carry no load.

For a swinging leg, with n the offsets of its torques (measured minus true), h the torque against gravity and due to its
own motion, M its inertia (`stadera.robot.dynamics`) and known friction,

    n = τ_measured - h - friction - M q̈

Joint accelerations are not measured, but over the swing's time T, with Ṁ q̇ = d/dt (M q̇) - M q̈,

    n = 1/T [ ∫ (τ - h - friction) dt - (M q̇)|end + (M q̇)|begin + ∫ Ṁ q̇ dt ]

Both ends of the swing, where the foot may touch the ground, are excluded. The trunk's angular acceleration is not in h;
over a swing its effect is negligible. The uncertainty combines the white noise of the torques, that of the velocities
at both ends, and a share of the offsets' usual size for unmodelled effects.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stadera.body.friction import JointFriction
from stadera.trunk.measurement import Measurement
from stadera.trunk.standing.legs import MeasuredLegs
from stadera.trunk.standing.noise import ForceNoise
from stadera.types import Array


@dataclass(frozen=True)
class OffsetSettings:
    """Settings for measuring torque offsets on a swinging leg."""

    left_out: float = 0.05  # time excluded at both ends of a swing, where the foot may touch the ground [s]
    shortest: float = 0.1  # remaining time needed [s]
    unmodelled: float = 0.25  # unmodelled part as a share of the offsets' usual size
    ends: int = 3  # samples over which velocities at the ends are averaged
    velocity: float = 0.02  # white noise of a joint's velocity [rad/s]


@dataclass(frozen=True, eq=False)
class LegOffsets:
    """A leg's torque offsets from one swing."""

    leg: int  # index of the leg
    time: float  # [s], of the swing's end
    value: Array  # (3,) [N·m]
    variance: Array  # (3,) [(N·m)²]


@dataclass
class _Swing:
    time: list[float] = field(default_factory=list)
    torque: list[Array] = field(default_factory=list)
    inertia: list[Array] = field(default_factory=list)
    rate: list[Array] = field(default_factory=list)


class SwingOffsets:
    """Collects swings, sample by sample, from measurements that state which legs are in stance."""

    def __init__(self, legs: MeasuredLegs, noise: ForceNoise, settings: OffsetSettings | None = None) -> None:
        self.legs, self._noise, self._settings = legs, noise, settings or OffsetSettings()
        self._friction = JointFriction.of(legs.robot)
        self._swings: dict[int, _Swing] = {}

    def update(self, m: Measurement) -> list[LegOffsets]:
        """Processes one measurement; returns the offsets from the swings that ended with it."""
        if m.stance is None:
            return []
        found = []
        for leg in [leg for leg in self._swings if m.stance[leg]]:
            offsets = self._offsets(leg, self._swings.pop(leg))
            found += [] if offsets is None else [offsets]
        swinging = np.flatnonzero(~m.stance).tolist()
        if swinging:
            state, motion = self.legs.at(m), self.legs.motion_at(m)
            rate, effort = m.joint_velocity[self.legs.columns], m.effort[self.legs.columns]
            torque = effort - state.bias - self._friction.torque(rate)
            for leg in swinging:
                swing = self._swings.setdefault(leg, _Swing())
                swing.time.append(m.time)
                swing.torque.append(torque[leg])
                swing.inertia.append(motion.inertia[leg])
                swing.rate.append(rate[leg])
        return found

    def _offsets(self, leg: int, swing: _Swing) -> LegOffsets | None:
        how, time = self._settings, np.array(swing.time)
        ends = how.ends
        inside = np.flatnonzero((time >= time[0] + how.left_out) & (time <= time[-1] - how.left_out))
        if len(inside) <= 2 * ends or time[inside[-1]] - time[inside[0]] < how.shortest:
            return None
        time, torque, M, rate = (
            np.array(values)[inside] for values in (swing.time, swing.torque, swing.inertia, swing.rate)
        )
        # the integrals run between the midpoints of the two groups of samples averaged at the ends
        first, last = ends // 2, len(time) - 1 - ends // 2
        momentum = (M @ rate[:, :, None])[:, :, 0]
        begin, end = momentum[:ends].mean(axis=0), momentum[-ends:].mean(axis=0)
        part = slice(first, last + 1)
        turning = (np.diff(M[part], axis=0) @ (0.5 * (rate[part][1:] + rate[part][:-1]))[:, :, None])[:, :, 0]
        whole = time[last] - time[first]
        value = (np.trapezoid(torque[part], time[part], axis=0) - (end - begin) + turning.sum(axis=0)) / whole
        white = self._noise.torque_white[leg] ** 2 / (last - first)
        at_ends = ((M[first] ** 2 + M[last] ** 2) @ np.ones(3)) * how.velocity**2 / ends / whole**2
        unmodelled = (how.unmodelled * self._noise.torque_constant[leg]) ** 2
        return LegOffsets(leg, float(swing.time[-1]), value, white + at_ends + unmodelled)
