"""Approach (c): the centre of mass from contact forces (the paper's section III.C, eq. 16-19).

At rest the contact forces' moment about the whole robot's centre of mass c vanishes, c x F = μ with F = Σ f_i and
μ = Σ p_i x f_i about the trunk's origin, p_i where the ground touches the foot. So -[F]x c = μ, of which [F]x has
rank two; its damped pseudo-inverse ([F]xᵀ [F]x + λ² 1)⁻¹ [F]xᵀ is -[F]x / (|F|² + λ²) on all that μ can be, hence

    c_⊥ = -[F]x⁺ μ = F x μ / (|F|² + λ²),

the point of the line of action nearest to the trunk's origin. The estimate steps towards it in the world's x-y plane
(see `stadera.estimate.recursive`), by α = 0.002 at 1 kHz. Everything is in trunk axes; the plane is the one normal to
the vertical, so no heading is needed and slopes make no difference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.contact import ContactForces
from stadera.estimate.convergence import settling_time, step_size
from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.measurement import Measurement
from stadera.estimate.recursive import RecursiveCom
from stadera.estimate.stillness import StillnessLimits
from stadera.estimate.trunk import TrunkModel
from stadera.robot.model import Robot

Array = NDArray[np.float64]

_DAMPING = 1e-3  # λ, as a share of the robot's weight: biases a centre of mass by a millionth
_LONGEST_STEP = 0.1  # s, that one measurement counts for at most, as a share of the settling time


class ContactCom(RecursiveCom):
    """Steps towards the line of action of the contact forces. Works with any controller, and in a closed loop or none.

    Args:
        robot: whose legs are believed in.
        start: what is believed first; None for the robot's own trunk.
        forces: source of contact forces; None for one of its own.
        limits: of standing still; None for `SLOW`.
        settling: time [s] after which 5 % of an error is left; α = 0.002 at 1 kHz by default.
        height_std: see `RecursiveCom`.

    Raises:
        ImplausibleError: an implausible start.
        ModelError: a time or a length that is not positive.
    """

    def __init__(
        self,
        robot: Robot,
        start: TrunkModel | None = None,
        forces: ContactForceEstimator | None = None,
        limits: StillnessLimits | None = None,
        settling: float = settling_time(),
        height_std: float = 0.05,
    ) -> None:
        super().__init__(robot, start, forces, limits, settling, height_std)
        self._before = np.nan
        self._step = 0.0

    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        time, up = measurement.time, measurement.up
        elapsed, self._before = time - self._before, time
        if not elapsed > 0:  # the first after an interruption: nobody knows for how long it holds
            return
        step = self._step = step_size(self.settling, min(elapsed, _LONGEST_STEP * self.settling))
        F, mu = forces.total_force, forces.moment
        square = float(F @ F)
        nearest = _cross(F, mu) / (square + _DAMPING**2 * square)
        com = self._robot_com(self.forces.legs.at(measurement).moment)
        mass, weighed = self._weighed(forces, up, step)
        error = nearest - com
        error = (1.0 + self._leg_mass / self._trunk.mass) * (error - up * float(up @ error))
        self._settled.take(error, step)
        if self._adopt(time, mass, self._trunk.com_trunk + step * error, weighed and self._settled.reached):
            self._looked_at(time, forces, up, com)

    def _interrupted(self) -> None:
        self._before = np.nan
        self._settled.restart()

    def _averaging(self) -> float:
        return self._step / (2.0 - self._step)


def _cross(a: Array, b: Array) -> Array:
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
