"""Standing with a small motion of the body, which makes height and inertia observable without stepping.

Each of the three rotations and three shifts is a sum of sines with separate frequencies, none a multiple of another,
with smaller amplitudes at higher frequencies; all start from rest::

    x(t) = e(t) A Σ_k w_k sin(2π f_k (t - t_0)),      w_k ∝ 1 / f_k,  Σ_k w_k = 1

with A the amplitude and e the smooth step from 0 to 1 within the first second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stadera.errors import ModelError
from stadera.lab.control.reference import TrunkPose, turning_map
from stadera.legs.model import foot_positions
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array

_ANGLE = np.deg2rad(3.0)
# Hz, of roll, pitch, yaw, x, y, z: within 0.5 to 2 Hz
_FREQUENCIES = np.array([[0.61, 1.37], [0.73, 1.61], [0.53, 1.13], [0.67, 1.49], [0.79, 1.27], [0.57, 1.87]])

_OMEGA, _ONES = 2.0 * np.pi * _FREQUENCIES, np.ones(2)


@dataclass(frozen=True, eq=False)
class Shake:
    """A motion around a pose; a `TrunkReference`.

    Attributes:
        centre: the pose, at rest.
        begin: [s].
        angle: amplitudes of roll, pitch and yaw, (3,) [rad].
        shift: amplitudes along x, y and z of the odometry frame, (3,) [m].
        ease: time over which the motion grows [s].

    Raises:
        ModelError: an amplitude is negative, not finite, or above half a radian.
    """

    centre: TrunkPose
    begin: float
    angle: Array
    shift: Array
    ease: float = 1.0

    def __post_init__(self) -> None:
        amplitudes = np.concatenate([np.broadcast_to(self.angle, 3), np.broadcast_to(self.shift, 3)])
        if not (np.isfinite(amplitudes).all() and (amplitudes >= 0).all() and (amplitudes[:3] <= 0.5).all()):
            raise ModelError(f"a shake's amplitudes must lie within 0 and 0.5 rad, got {self.angle} and {self.shift}")
        weights = 1.0 / _FREQUENCIES
        weights *= (amplitudes / weights.sum(axis=1))[:, None]
        object.__setattr__(self, "_weights", weights)

    @classmethod
    def of(cls, robot: Robot, centre: TrunkPose, begin: float, amplitude: float = 1.0, shift: float = 0.03) -> Shake:
        """Rotations of 3° and shifts of a share of the robot's height, times an amplitude."""
        height = -float(foot_positions(robot, standing_configuration(robot)[None])[0, :, 2].mean())
        return cls(centre, begin, np.full(3, amplitude * _ANGLE), np.full(3, amplitude * shift * height))

    def at(self, time: float) -> TrunkPose:
        """Reference at a time [s]."""
        late = max(time - self.begin, 0.0)
        weights = self._weights  # type: ignore[attr-defined]
        phase = _OMEGA * late
        sine, cosine = weights * np.sin(phase), weights * np.cos(phase)
        x, rate, rate_2 = sine @ _ONES, (_OMEGA * cosine) @ _ONES, (-_OMEGA * _OMEGA * sine) @ _ONES
        if late < self.ease:
            e, e_1, e_2 = _eased(late, self.ease)
            rate_2 = e * rate_2 + 2.0 * e_1 * rate + e_2 * x
            rate, x = e * rate + e_1 * x, e * x
        return TrunkPose(
            self.centre.position + x[3:],
            self.centre.rotation @ pin.exp3(x[:3]),
            rate[3:],
            turning_map(x[:3]) @ rate[:3],
            rate_2[3:],
        )


def _eased(late: float, ease: float) -> tuple[float, float, float]:
    """e and its first two derivatives."""
    x = late / ease
    return (
        x**3 * (10.0 - 15.0 * x + 6.0 * x * x),
        30.0 * (x * (1.0 - x)) ** 2 / ease,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / ease**2,
    )
