"""Control of legs in the air: foot trajectories, torques, and detection of touch-down.

A foot moves from a to b within a time T. With x = (t - t_0) / T and the smooth step s(x) = x³ (10 - 15 x + 6 x²)::

    p(t) = a + s(x) (b - a) + c 64 x³ (1 - x)³ e_z,     c = clearance + ½ |e_z·(b - a)|

so it is at rest without acceleration at both ends, and passes the higher end with about the clearance. After T it
continues down, up to a steady speed, until it is stopped by a landing.

Torques follow from inverse dynamics for the acceleration of a critically damped spring::

    p̈ = p̈_ref + ω² (p_ref - p) + 2 ω (ṗ_ref - ṗ),       q̈ = J⁻¹ (Rᵀ (p̈ - g) - p̈_free),       τ = h + M q̈ + friction

with p̈_free the foot's acceleration minus gravity without joint accelerations, all from gyro, accelerometer and joints.
The rule is the same for every robot, since it includes the leg's own inertia. The reaction on the trunk is
the wrench that the ground has to add.

A touch-down is detected from the torques: f = -J⁻ᵀ (τ - h - M q̈). Joint accelerations are not measured, but with ⟨·⟩ a
first-order low-pass of time constant T, ⟨q̈⟩ = (q̇ - ⟨q̇⟩) / T, so for slowly changing M::

    ⟨f⟩ = -J⁻ᵀ (⟨τ - h⟩ - M (q̇ - ⟨q̇⟩) / T)
"""

from dataclasses import dataclass
from math import isfinite

import numpy as np

from stadera.body import Body
from stadera.constants import GRAVITY
from stadera.lab.control.legs import LegDynamics, LegMotion, LegState
from stadera.trunk.measurement import Measurement
from stadera.types import Array

_UP = np.array([0.0, 0.0, 1.0])
_GRAVITY = np.array([0.0, 0.0, -GRAVITY])


@dataclass(frozen=True)
class SwingLegSettings:
    """Settings of the control of swinging legs."""

    frequency: float = 60.0  # ω of the spring between foot and trajectory [rad/s]
    filter: float = 0.005  # T of the low-pass for touch-down [s]
    touch: float = 0.06  # force along the ground's normal that counts as touch-down, as a share of the robot's weight
    singular: float = 0.02  # share of the largest singular value of J below which a direction is damped


@dataclass(frozen=True, eq=False)
class SwingTrajectory:
    """Trajectory of a foot's centre through the air, in the odometry frame."""

    start: Array  # (3,) [m]
    target: Array  # (3,) [m]
    begin: float  # [s]
    duration: float  # [s], positive
    clearance: float  # [m], above the higher end; not negative
    descent: float = 0.2  # [m/s], steady speed at which the foot searches for the ground after the end; 0 for none
    ease: float = 0.05  # [s], in which it reaches that speed

    def __post_init__(self) -> None:
        way = self.target - self.start
        height = 64.0 * (self.clearance + 0.5 * abs(float(way[2])))
        object.__setattr__(self, "_basis", np.array([way, height * _UP]))

    @property
    def end(self) -> float:
        """[s]."""
        return self.begin + self.duration

    def progress(self, time: float) -> float:
        """Share of the time that has passed, 0 to 1."""
        return min(max((time - self.begin) / self.duration, 0.0), 1.0)

    def at(self, time: float) -> Array:
        """Position, velocity and acceleration, (3, 3), at a time [s]."""
        x, rate = (time - self.begin) / self.duration, 1.0 / self.duration
        if x >= 1.0:
            return self._descending(time - self.end)
        x = max(x, 0.0)
        y = x * (1.0 - x)
        tilt = 1.0 - 2.0 * x
        shares = np.array(
            [
                (x**3 * (10.0 - 15.0 * x + 6.0 * x * x), y**3),
                (30.0 * y * y * rate, 3.0 * y * y * tilt * rate),
                (60.0 * y * tilt * rate**2, 6.0 * y * (tilt * tilt - y) * rate**2),
            ]
        )
        rows: Array = shares.dot(self._basis)  # type: ignore[attr-defined]
        rows[0] += self.start
        return rows

    def _descending(self, late: float) -> Array:
        ease = late + self.ease
        depth, speed = self.descent * late**2 / ease, self.descent * (1.0 - (self.ease / ease) ** 2)
        slowing = 2.0 * self.descent * self.ease**2 / ease**3
        rows = np.array([[-depth], [-speed], [-slowing]]) * _UP
        rows[0] += self.target
        return np.asarray(rows)


class SwingLegs:
    """The legs that swing now.

    Attributes:
        trajectories: of each leg; None for one that does not swing.
        force: (4, 3) [N], ⟨f⟩ in the world's axes; zero for legs that do not swing.
        touched: (4,) bool, swinging legs in contact with the ground.
    """

    def __init__(self, legs: LegDynamics) -> None:
        self.settings, robot = SwingLegSettings(), legs.robot
        self._body = Body.of(robot, others=False)
        self._columns = legs.columns
        self._least = self.settings.touch * robot.mass * GRAVITY
        nominal = np.linalg.norm(legs.nominal_jacobians(), axis=(1, 2)).max()
        self._most_squared = 1.0 / (self.settings.singular * float(nominal)) ** 2
        self.trajectories: list[SwingTrajectory | None] = [None] * 4
        self.force, self.touched = np.zeros((4, 3)), np.zeros(4, dtype=bool)
        self._slow_rate, self._slow_torque = np.zeros((4, 3)), np.zeros((4, 3))
        self.legs: list[int] = []  # that swing
        self._new: list[int] = []  # legs that started since the last update

    def begin(self, leg: int, trajectory: SwingTrajectory) -> None:
        """Starts a leg's swing, or changes the trajectory of a swinging leg."""
        if self.trajectories[leg] is None:
            self._new.append(leg)
            self.legs = sorted([*self.legs, leg])
        self.trajectories[leg] = trajectory

    def end(self, leg: int) -> None:
        """Ends a leg's swing."""
        self.trajectories[leg] = None
        self.force[leg], self.touched[leg] = 0.0, False
        self._new, self.legs = ([one for one in legs if one != leg] for legs in (self._new, self.legs))

    def update(
        self,
        measurement: Measurement,
        state: LegState,
        motion: LegMotion,
        trunk: tuple[Array, Array, Array],
        normal: Array,
        dt: float,
    ) -> tuple[Array, Array]:
        """Torques (4, 3) [N·m], which for legs that do not swing are those that would hold them in the air, and the
        wrench (6,), force [N] and moment [N·m] at the trunk's origin, trunk axes, required by their acceleration.

        `trunk` is position [m], velocity [m/s] and rotation of the trunk's origin in the odometry frame, `normal` (3,)
        the ground's in world axes, `dt` [s] the time since the last update.
        """
        position, speed, rotation = trunk
        wanted, w = np.zeros((4, 3, 3)), self.settings.frequency
        for leg in self.legs:
            wanted[leg] = self.trajectories[leg].at(measurement.time)  # type: ignore[union-attr]
        wanted -= np.array([position, speed, _GRAVITY])
        wanted = wanted.reshape(12, 3).dot(rotation).reshape(4, 3, 3)  # trunk axes from here on
        off = wanted[:, 0] - state.feet
        pull = wanted[:, 2] + w * w * off + 2.0 * w * (wanted[:, 1] - motion.velocity) - motion.free_acceleration
        inverse = self._inverse(state.jacobians(state.feet))
        joint = np.matvec(inverse, pull)
        velocity = measurement.joint_velocity
        rate, friction = velocity[self._columns], self._body.friction(velocity, velocity)[self._columns]
        held = state.bias + friction
        felt = self._felt(measurement.effort[self._columns] - held, rate, motion.inertia, dt)
        self.force = np.vecmat(felt, inverse).dot(-rotation.T)
        self.touched = self.force.dot(normal) > self._least
        return held + np.matvec(motion.inertia, joint), np.matvec(motion.coupling, joint).sum(axis=0)

    def _felt(self, torque: Array, rate: Array, inertia: Array, dt: float) -> Array:
        """⟨τ - h - M q̈⟩ (4, 3) [N·m]."""
        if self._new:
            self._slow_rate[self._new], self._slow_torque[self._new] = rate[self._new], 0.0
            self._new = []
        share = dt / (self.settings.filter + dt)
        self._slow_torque += share * (torque - self._slow_torque)
        self._slow_rate += share * (rate - self._slow_rate)
        return np.asarray(self._slow_torque - np.matvec(inertia, rate - self._slow_rate) / self.settings.filter)

    def _inverse(self, jacobians: Array) -> Array:
        """J⁻¹ (4, 3, 3) of the swinging legs, damped near singularities; computed with the adjugate, for speed."""
        inverse = np.zeros((4, 3, 3))
        for leg in self.legs:
            (a, b, c), (d, e, f), (g, h, i) = jacobians[leg].tolist()
            adjugate = np.array(
                [
                    (e * i - f * h, c * h - b * i, b * f - c * e),
                    (f * g - d * i, a * i - c * g, c * d - a * f),
                    (d * h - e * g, b * g - a * h, a * e - b * d),
                ]
            )
            determinant = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
            size = adjugate.ravel()
            if size.dot(size) < self._most_squared * determinant**2 or not isfinite(determinant):
                inverse[leg] = adjugate / determinant
            else:
                inverse[leg] = _damped(jacobians[leg], self.settings.singular)
        return inverse


def _damped(jacobian: Array, singular: float) -> Array:
    u, s, vt = np.linalg.svd(jacobian)
    least = singular * s[0]
    return np.asarray((vt.T * (s / (s * s + np.where(s < least, least**2, 0.0)))) @ u.T)
