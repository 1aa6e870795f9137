"""Legs in the air: where their feet are to go, the torques that take them there, and how they notice the ground.

A foot is to move from a to b within a time T. With x = (t - t_0) / T and the smooth step s(x) = x³ (10 - 15 x + 6 x²)::

    p(t) = a + s(x) (b - a) + c 64 x³ (1 - x)³ n,       c = clearance + ½ |n·(b - a)|

so it is at rest at both ends, with no acceleration there, and passes the higher end by about the clearance. After T it
goes on down against n, up to a steady speed, until somebody says that it has landed.

Torques are those of inverse dynamics for the acceleration that a critically damped spring asks for::

    p̈ = p̈_ref + ω² (p_ref - p) + 2 ω (ṗ_ref - ṗ),       q̈ = J⁻¹ (Rᵀ (p̈ - g) - p̈_free),       τ = h + M q̈ + friction

with p̈_free the foot's acceleration less gravity while the joints do not accelerate: all from gyro, accelerometer and
joints. One rule for every robot, as a leg's own inertia is in it. The trunk feels the reaction; `SwingTorques.wrench`
is what the ground has to add.

A touch-down is felt in the torques: f = -J⁻ᵀ (τ - h - M q̈). No joint acceleration is measured, but with ⟨·⟩ a
first-order low-pass of time constant T, ⟨q̈⟩ = (q̇ - ⟨q̇⟩) / T, so with M changing slowly::

    ⟨f⟩ = -J⁻ᵀ (⟨τ - h⟩ - M (q̇ - ⟨q̇⟩) / T)
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stadera.errors import ModelError
from stadera.estimate.measurement import Measurement
from stadera.robot.dynamics import LegMotion, LegState
from stadera.robot.model import Robot

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_UP = np.array([0.0, 0.0, 1.0])
_EASE = 0.05  # s, in which the descent after the end reaches its speed
_FREQUENCY = 60.0  # rad/s, of the spring between foot and trajectory
_FILTER = 0.005  # s, T of the touch-down's low-pass
_TOUCH = 0.06  # share of the robot's weight, along the ground's normal, that tells the ground
_SINGULAR = 0.02  # of the largest singular value of J: below it a direction is damped


@dataclass(frozen=True, eq=False)
class SwingTrajectory:
    """A foot's way through the air, in the odometry frame; of the foot's centre.

    Attributes:
        start, target: (3,) [m].
        begin: [s]. duration: [s], positive.
        clearance: [m], over the higher end; not negative.
        normal: (3,) unit vector, up.
        descent: [m/s], steady speed at which the foot feels for the ground after the end; 0 for none.

    Raises:
        ModelError: a duration that is not positive, a clearance or descent that is negative, values not finite.
    """

    start: Array
    target: Array
    begin: float
    duration: float
    clearance: float
    normal: Array = field(default_factory=_UP.copy)
    descent: float = 0.2

    def __post_init__(self) -> None:
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise ModelError(f"a swing's duration must be positive, got {self.duration} s")
        if not (np.isfinite([self.clearance, self.descent]).all() and min(self.clearance, self.descent) >= 0):
            raise ModelError(
                f"a swing's clearance and descent must not be negative, got {self.clearance} m, {self.descent} m/s"
            )
        if not np.isfinite([self.start, self.target]).all():
            raise ModelError(f"a swing's ends must be finite, got {self.start} and {self.target}")

    @property
    def end(self) -> float:
        """[s]."""
        return self.begin + self.duration

    def progress(self, time: float) -> float:
        """Share of the time that has passed, 0 to 1."""
        return min(max((time - self.begin) / self.duration, 0.0), 1.0)

    def at(self, time: float) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration (3,) at a time [s]."""
        x, way, normal = self.progress(time), self.target - self.start, self.normal
        if x >= 1.0:
            return self._descending(time - self.end)
        rate, back = 1.0 / self.duration, 1.0 - x
        step = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        step_rate = 30.0 * (x * back) ** 2 * rate
        step_rate_2 = 60.0 * x * back * (1.0 - 2.0 * x) * rate**2
        height = 64.0 * (self.clearance + 0.5 * abs(float(way @ normal)))
        bump = height * (x * back) ** 3
        bump_rate = height * 3.0 * (x * back) ** 2 * (1.0 - 2.0 * x) * rate
        bump_rate_2 = height * 6.0 * x * back * ((1.0 - 2.0 * x) ** 2 - x * back) * rate**2
        return (
            self.start + step * way + bump * normal,
            step_rate * way + bump_rate * normal,
            step_rate_2 * way + bump_rate_2 * normal,
        )

    def _descending(self, late: float) -> tuple[Array, Array, Array]:
        ease = late + _EASE
        depth, speed = self.descent * late**2 / ease, self.descent * (1.0 - (_EASE / ease) ** 2)
        slowing = 2.0 * self.descent * _EASE**2 / ease**3
        return self.target - depth * self.normal, -speed * self.normal, -slowing * self.normal


@dataclass(frozen=True, eq=False)
class SwingTorques:
    """What swinging legs need.

    Attributes:
        torque: (4, 3) [N·m]; zero for legs that do not swing.
        wrench: (6,) force [N] and moment [N·m] at the trunk's origin, trunk axes, that their acceleration takes.
    """

    torque: Array
    wrench: Array


class SwingLegs:
    """The legs that swing now, and their trajectories.

    Args:
        robot: whose legs are believed in.
        columns: (4, 3) int, where each leg's joints are in the tree's order.
        frequency: ω [rad/s].
        touch: the ground is felt when a foot's normal force is above this share of the robot's weight.

    Attributes:
        trajectories: of each leg; None for one that does not swing.
        force: (4, 3) [N], ⟨f⟩ in the world's axes; zero for legs that do not swing.
        touched: (4,) bool, swinging legs that feel the ground.
        error: (4,) [m], how far each swinging foot is from its trajectory.
    """

    def __init__(
        self, robot: Robot, columns: NDArray[np.int_], frequency: float = _FREQUENCY, touch: float = _TOUCH
    ) -> None:
        joints = [robot.dynamics[joint] for joint in robot.tree.joints]
        self._viscous = np.array([d.viscous for d in joints])[columns]
        self._coulomb = np.array([d.coulomb for d in joints])[columns]
        self._offset = np.array([d.offset for d in joints])[columns]
        self._columns, self._frequency = columns, frequency
        self._least = touch * robot.mass * 9.81
        self.trajectories: list[SwingTrajectory | None] = [None] * 4
        self.force, self.touched, self.error = np.zeros((4, 3)), np.zeros(4, dtype=bool), np.zeros(4)
        self._smooth_rate, self._smooth_torque = np.zeros((4, 3)), np.zeros((4, 3))
        self._fresh = np.ones(4, dtype=bool)

    @property
    def any(self) -> bool:
        """Whether a leg swings."""
        return any(trajectory is not None for trajectory in self.trajectories)

    def begin(self, leg: int, trajectory: SwingTrajectory) -> None:
        """Lets a leg swing, or changes the trajectory of one that does."""
        if self.trajectories[leg] is None:
            self._fresh[leg] = True
        self.trajectories[leg] = trajectory

    def end(self, leg: int) -> None:
        """The leg swings no more."""
        self.trajectories[leg] = None
        self.force[leg], self.touched[leg], self.error[leg] = 0.0, False, 0.0

    def update(
        self,
        measurement: Measurement,
        state: LegState,
        motion: LegMotion,
        trunk: tuple[Array, Array, Array],
        normal: Array,
        dt: float,
    ) -> SwingTorques:
        """Torques of the swinging legs, and what they feel.

        Args:
            measurement: of this instant, with orientation.
            state, motion: of the legs at it.
            trunk: position [m], velocity [m/s] and rotation of the trunk's origin in the odometry frame.
            normal: (3,) of the ground, world axes.
            dt: [s], since the last update.
        """
        torque, wrench = np.zeros((4, 3)), np.zeros(6)
        position, speed, rotation = trunk
        rate = measurement.joint_velocity[self._columns]
        effort = measurement.effort[self._columns]
        jacobians = state.jacobians(state.feet)
        for leg, trajectory in enumerate(self.trajectories):
            if trajectory is None:
                continue
            wanted, wanted_rate, wanted_rate_2 = trajectory.at(measurement.time)
            off = wanted - position - rotation @ state.feet[leg]
            off_rate = wanted_rate - speed - rotation @ motion.velocity[leg]
            w = self._frequency
            pull = wanted_rate_2 + w * w * off + 2.0 * w * off_rate
            pull[2] += 9.81
            inverse = _inverse(jacobians[leg])
            joint = inverse @ (pull @ rotation - motion.free_acceleration[leg])
            friction = self._viscous[leg] * rate[leg] + self._coulomb[leg] * np.tanh(rate[leg] / 0.1)
            held = state.bias[leg] + friction + self._offset[leg]
            torque[leg] = held + motion.inertia[leg] @ joint
            wrench += motion.coupling[leg] @ joint
            felt = self._felt(leg, effort[leg] - held, rate[leg], motion.inertia[leg], dt)
            self.force[leg] = rotation @ (felt @ -inverse)
            self.touched[leg] = self.force[leg] @ normal > self._least
            self.error[leg] = np.sqrt(off @ off)
        return SwingTorques(torque, wrench)

    def _felt(self, leg: int, torque: Array, rate: Array, inertia: Array, dt: float) -> Array:
        """⟨τ - h - M q̈⟩ (3,) [N·m]."""
        if self._fresh[leg]:
            self._fresh[leg] = False
            self._smooth_rate[leg], self._smooth_torque[leg] = rate, 0.0
        share = dt / (_FILTER + dt)
        slow_torque, slow_rate = self._smooth_torque[leg], self._smooth_rate[leg]
        slow_torque += share * (torque - slow_torque)
        slow_rate += share * (rate - slow_rate)
        return np.asarray(slow_torque - inertia @ (rate - slow_rate) / _FILTER)


def _inverse(jacobian: Array) -> Array:
    """J⁻¹ (3, 3), damped where the leg is nearly stretched."""
    u, s, vt = np.linalg.svd(jacobian)
    least = _SINGULAR * s[0]
    return np.asarray((vt.T * (s / (s * s + np.where(s < least, least**2, 0.0)))) @ u.T)
