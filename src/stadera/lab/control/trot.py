"""A trot: diagonal pairs of legs alternate, and balance is kept by the choice of footholds.

With two feet on the ground, the trunk's moment about the line between them cannot be controlled: the body falls over
that line as an inverted pendulum with time constant T = √(h / g). A foot that lands p ahead of the centre of mass,
which then has the velocity v, and stays in stance for a time S, leads to (linear inverted pendulum)::

    v' = v cosh(S / T) - (p / T) sinh(S / T)

With p = T tanh(S / 2T) v_d + k (v - v_d) a velocity v_d is preserved, and its error is multiplied in each step by
cosh(S / T) - (k / T) sinh(S / T): zero for k = T coth(S / T) (capture within a step). A slow integral of the velocity
error also moves the feet, which compensates for an unknown load.

All times follow from T and all lengths from those of the legs, by the same rule for every robot. Like the trunk
controller, it uses measurements only.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, hypot, sin, tanh

import numpy as np
from numpy.typing import ArrayLike

from stadera.constants import GRAVITY
from stadera.lab.control.reference import TrunkPose
from stadera.lab.control.stand import Gait
from stadera.lab.control.swing import SwingTrajectory
from stadera.lab.control.trunk import TrunkController, composite
from stadera.robot.model import Robot
from stadera.robot.stance import nominal_feet, standing_configuration
from stadera.trunk.measurement import Measurement
from stadera.types import Array, Bools

PAIRS = ((0, 3), (1, 2))
"""The diagonal pairs of legs: LF with RH, RF with LH."""

_NOTHING = (0.0, 0.0)


@dataclass(frozen=True)
class TrotSettings:
    """Settings of a trot."""

    pendulum: float  # T [s]
    swing: float  # duration of a swing [s]
    overlap: float  # [s], time on all four feet between two swings
    clearance: float  # of the feet [m]
    capture: float  # k [s]
    leash: float  # [m], largest distance between the reference and the trunk
    acceleration: float  # [m/s²], limit with which commands are followed
    reach: float  # [m], largest distance of a foothold from below the hip
    late: float = 1.4  # share of the swing's time after which a foot counts as landed, even without touch-down
    frozen: float = 0.85  # share of the swing's time after which the target is fixed
    trusted: float = 0.5  # share of the swing's time after which touch-down is accepted
    slow: float = 0.08  # speed below which four feet can stop the trunk, as a share of √(g h)
    drift_steps: float = 18.0  # time constant of the integral of the velocity error, in steps

    @property
    def step(self) -> float:
        """Time between the landings of the two pairs [s]."""
        return self.swing + self.overlap

    @classmethod
    def of(cls, robot: Robot) -> TrotSettings:
        """Scaled from the robot's nominal stance."""
        q = standing_configuration(robot)
        height = float(composite(robot, q).com[2] - nominal_feet(robot)[:, 2].mean())
        pendulum = float(np.sqrt(height / GRAVITY))
        swing, overlap = 0.9 * pendulum, 0.15 * pendulum
        return cls(
            pendulum=pendulum,
            swing=swing,
            overlap=overlap,
            clearance=0.12 * height,
            capture=0.9 * pendulum / tanh((swing + overlap) / pendulum),
            leash=0.08 * height,
            acceleration=0.15 * GRAVITY,
            reach=0.45 * height,
        )


class Trot(Gait):
    """Trots with a trunk controller as made by `Trot.of`; stands before the first `walk` and after `stop`."""

    def __init__(self, controller: TrunkController, settings: TrotSettings | None = None) -> None:
        super().__init__(controller)
        self.settings = settings or TrotSettings.of(controller.robot)
        feet = nominal_feet(controller.robot)[:, :2]
        self._nominal = (feet - feet.mean(axis=0)).tolist()
        self._ahead = self.settings.pendulum * tanh(0.5 * self.settings.step / self.settings.pendulum)
        self._asked, self._asked_turn = _NOTHING, 0.0
        self._velocity, self._turn = _NOTHING, 0.0
        self._wanted = self.stepping = False
        self._place, self._yaw, self._drift = _NOTHING, 0.0, _NOTHING
        self._height, self._ground, self._level = 0.0, 0.0, 0.0
        self._stood_on: Bools | None = None
        self._pair, self._swinging, self._hand_over = 0, False, np.nan

    @classmethod
    def of(cls, robot: Robot) -> Trot:
        """Makes a trot with a suitable trunk controller: velocity from legs and IMU, moments weighted over forces."""
        pendulum = TrotSettings.of(robot).pendulum
        length = 0.15 * pendulum**2 * GRAVITY
        return cls(TrunkController(robot, velocity_time=0.12 * pendulum, moment_length=length))

    def walk(self, velocity: ArrayLike, turn: float = 0.0) -> None:
        """Starts trotting ahead and to the left, (2,) [m/s], turning to the left [rad/s]; with zeros, on the spot."""
        ahead, left = np.asarray(velocity, dtype=float).tolist()
        self._asked, self._asked_turn, self._wanted = (ahead, left), float(turn), True

    def stop(self) -> None:
        """Slows down, and then stands on four feet."""
        self._asked, self._asked_turn, self._wanted = _NOTHING, 0.0, False

    def update(self, measurement: Measurement) -> Array:
        c = self.controller
        if not np.isnan(c.time):
            self._plan(measurement.time - c.time)
        torque = c.update(measurement)
        if self._height == 0.0:
            self._height = float(c.position[2] - c.feet[:, 2].mean())
        return torque

    def at(self, time: float) -> TrunkPose:
        return self._pose

    # -- inside ---------------------------------------------------------------------------------------------------
    def _plan(self, dt: float) -> None:
        if not self.stepping:
            if not self._wanted:
                return
            self._start()
        self._follow_command(dt)
        self._legs()

    def _start(self) -> None:
        c = self.controller
        here = c.reference
        self.stepping = True
        self._place = (float(here.position[0]), float(here.position[1]))
        self._yaw = atan2(here.rotation[1, 0], here.rotation[0, 0])
        self._ground = self._level = float(c.feet[:, 2].mean())
        self._drift = _NOTHING
        self._follow_command(0.0)
        c.follow(self)
        self._relieve()

    def _follow_command(self, dt: float) -> None:
        c, s = self.controller, self.settings
        most = s.acceleration * dt
        vx, vy = (now + _within(asked - now, most) for now, asked in zip(self._velocity, self._asked, strict=True))
        self._velocity = vx, vy
        self._turn += _within(self._asked_turn - self._turn, most / s.reach)
        self._yaw += self._turn * dt
        cosine, sine = cos(self._yaw), sin(self._yaw)
        ux, uy = cosine * vx - sine * vy, sine * vx + cosine * vy
        (x, y), (here_x, here_y, _) = self._place, c.position.tolist()
        away_x, away_y = x + ux * dt - here_x, y + uy * dt - here_y
        held = min(1.0, s.leash / max(hypot(away_x, away_y), 1e-9))
        self._place = here_x + held * away_x, here_y + held * away_y
        now_x, now_y, _ = c.velocity.tolist()
        share = dt / (s.drift_steps * s.step)
        self._drift = self._drift[0] + share * (now_x - ux), self._drift[1] + share * (now_y - uy)
        if c.stance is not self._stood_on:
            self._stood_on, self._level = c.stance, float(c.odometry.anchors[:, 2].mean())
        self._ground += dt / (s.step + dt) * (self._level - self._ground)
        self._pose = TrunkPose(
            np.array([*self._place, self._ground + self._height]),
            np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]),
            np.array([ux, uy, 0.0]),
            np.array([0.0, 0.0, self._turn]),
        )

    def _legs(self) -> None:
        c, s = self.controller, self.settings
        if not self._swinging:
            if c.time >= self._hand_over:
                self._swinging = True
                for leg in PAIRS[self._pair]:
                    c.swing(leg, self._path(leg, c.feet[leg].copy(), c.time))
            return
        legs = PAIRS[self._pair]
        for leg in legs:
            path = c.swinging.trajectories[leg]
            if path is None:
                continue
            late = (c.time - path.begin) / path.duration
            if late > s.late or (late > s.trusted and c.swinging.touched[leg]):
                c.land(leg, s.overlap)
            elif late < s.frozen:
                c.swing(leg, self._path(leg, path.start, path.begin))
        if c.stance.all():
            self._landed()

    def _landed(self) -> None:
        self._swinging, self._pair = False, 1 - self._pair
        slow = hypot(*self.controller.velocity[:2].tolist()) < self.settings.slow * GRAVITY * self.settings.pendulum
        if not self._wanted and slow and self._velocity == _NOTHING:
            self._stand()
        else:
            self._relieve()

    def _stand(self) -> None:
        c = self.controller
        self.stepping = False
        middle = c.feet.mean(axis=0)
        level = self._pose.rotation
        place = np.array([*(middle + c.position - c.com)[:2], self._ground + self._height])
        c.move(TrunkPose(place, level), 3.0 * self.settings.step)

    def _relieve(self) -> None:
        c, s = self.controller, self.settings
        for leg in PAIRS[self._pair]:
            c.relieve(leg, s.overlap)
        self._hand_over = c.time + s.overlap

    def _path(self, leg: int, start: Array, begin: float) -> SwingTrajectory:
        """Trajectory to the foothold, as predicted now."""
        c, s = self.controller, self.settings
        left = max(begin + s.swing - c.time, 0.0)
        (ux, uy, _), (vx, vy, _), (x, y, _) = self._pose.velocity.tolist(), c.velocity.tolist(), c.com.tolist()
        step_x = self._ahead * ux + s.capture * (vx - ux) + self._drift[0]
        step_y = self._ahead * uy + s.capture * (vy - uy) + self._drift[1]
        short = min(1.0, s.reach / max(hypot(step_x, step_y), 1e-9))
        yaw, (hip_x, hip_y) = self._yaw + self._turn * (left + 0.5 * s.step), self._nominal[leg]
        cosine, sine = cos(yaw), sin(yaw)
        target = np.array(
            [
                x + vx * left + cosine * hip_x - sine * hip_y + short * step_x,
                y + vy * left + sine * hip_x + cosine * hip_y + short * step_y,
                self._ground,
            ]
        )
        return SwingTrajectory(start, target, begin, s.swing, s.clearance, descent=s.clearance / s.swing)


def _within(value: float, most: float) -> float:
    return min(max(value, -most), most)
