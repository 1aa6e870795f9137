"""Constant torque offsets from legs in the air: a scale is zeroed while nothing lies on it.

A swinging leg carries nothing, so with n the offsets of its torques (measured minus true), h what holds it against
gravity and its own motion, M its inertia (`stadera.robot.dynamics`) and friction as known

    n = τ_measured - h - friction - M q̈

No joint acceleration is measured, but over the swing's time T, with Ṁ q̇ = d/dt (M q̇) - M q̈,

    n = 1/T [ ∫ (τ - h - friction) dt - (M q̇)|end + (M q̇)|begin + ∫ Ṁ q̇ dt ]

Both ends of the swing, where the foot may touch, are left out. An acceleration of the trunk's rotation is not in h;
over a swing it comes to next to nothing. The uncertainty is that of the torques' white noise, of the velocities at both
ends, and a share of what offsets usually are for what is left unmodelled.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.legs import MeasuredLegs
from stadera.estimate.measurement import Measurement
from stadera.estimate.noise import ForceNoise

Array = NDArray[np.float64]

_LEFT_OUT = 0.05  # s, at both ends of a swing
_SHORTEST = 0.1  # s, of what is left
_UNMODELLED = 0.25  # share of the offsets' usual size
_ENDS = 3  # samples, over which velocities at the ends are averaged
_VELOCITY = 0.02  # rad/s, white noise of a joint's velocity
_STICTION = 0.1  # rad/s, over which friction's sign is smoothed


@dataclass(frozen=True, eq=False)
class LegOffsets:
    """What one swing says of its leg's torque offsets.

    Attributes:
        leg: its index.
        time: [s], of the swing's end.
        value: (3,) [N·m]. variance: (3,) [(N·m)²].
    """

    leg: int
    time: float
    value: Array
    variance: Array


@dataclass
class _Swing:
    time: list[float] = field(default_factory=list)
    torque: list[Array] = field(default_factory=list)
    inertia: list[Array] = field(default_factory=list)
    rate: list[Array] = field(default_factory=list)


class SwingOffsets:
    """Gathers swings, sample by sample, from measurements that say which legs are meant to carry.

    Args:
        legs: of the robot.
        noise: of the torques.
    """

    def __init__(self, legs: MeasuredLegs, noise: ForceNoise) -> None:
        self.legs, self._noise = legs, noise
        joints = [legs.robot.dynamics[joint] for joint in legs.robot.tree.joints]
        self._viscous = np.array([d.viscous for d in joints])[legs.columns]
        self._coulomb = np.array([d.coulomb for d in joints])[legs.columns]
        self._known = np.array([d.offset for d in joints])[legs.columns]
        self._swings: dict[int, _Swing] = {}

    def update(self, m: Measurement) -> list[LegOffsets]:
        """One more measurement; what the swings say that ended with it."""
        if m.stance is None:
            return []
        found = []
        for leg in [leg for leg in self._swings if m.stance[leg]]:
            offsets = self._judged(leg, self._swings.pop(leg))
            found += [] if offsets is None else [offsets]
        swinging = np.flatnonzero(~m.stance).tolist()
        if swinging:
            state, motion = self.legs.at(m), self.legs.motion_at(m)
            rate, effort = m.joint_velocity[self.legs.columns], m.effort[self.legs.columns]
            friction = self._viscous * rate + self._coulomb * np.tanh(rate / _STICTION) + self._known
            torque = effort - state.bias - friction
            for leg in swinging:
                swing = self._swings.setdefault(leg, _Swing())
                swing.time.append(m.time)
                swing.torque.append(torque[leg])
                swing.inertia.append(motion.inertia[leg])
                swing.rate.append(rate[leg])
        return found

    def _judged(self, leg: int, swing: _Swing) -> LegOffsets | None:
        time = np.array(swing.time)
        inside = np.flatnonzero((time >= time[0] + _LEFT_OUT) & (time <= time[-1] - _LEFT_OUT))
        if len(inside) <= 2 * _ENDS or time[inside[-1]] - time[inside[0]] < _SHORTEST:
            return None
        time, torque, M, rate = (
            np.array(values)[inside] for values in (swing.time, swing.torque, swing.inertia, swing.rate)
        )
        # the integrals run between the middles of the two groups that the ends are averaged over
        first, last = _ENDS // 2, len(time) - 1 - _ENDS // 2
        momentum = (M @ rate[:, :, None])[:, :, 0]
        begin, end = momentum[:_ENDS].mean(axis=0), momentum[-_ENDS:].mean(axis=0)
        part = slice(first, last + 1)
        turning = (np.diff(M[part], axis=0) @ (0.5 * (rate[part][1:] + rate[part][:-1]))[:, :, None])[:, :, 0]
        whole = time[last] - time[first]
        value = (np.trapezoid(torque[part], time[part], axis=0) - (end - begin) + turning.sum(axis=0)) / whole
        white = self._noise.torque_white[leg] ** 2 / (last - first)
        ends = ((M[first] ** 2 + M[last] ** 2) @ np.ones(3)) * _VELOCITY**2 / _ENDS / whole**2
        unmodelled = (_UNMODELLED * self._noise.torque_constant[leg]) ** 2
        return LegOffsets(leg, float(swing.time[-1]), value, white + ends + unmodelled)
