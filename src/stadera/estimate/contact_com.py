"""Approach (c): the centre of mass from contact forces (the paper's section III.C, eq. 16-19).

At rest the contact forces' moment about the whole robot's centre of mass c vanishes, c x F = μ with F = Σ f_i and
μ = Σ p_i x f_i about the trunk's origin, p_i where the ground touches the foot. So -[F]x c = μ, of which [F]x has
rank two; its damped pseudo-inverse ([F]xᵀ [F]x + λ² 1)⁻¹ [F]xᵀ is -[F]x / (|F|² + λ²) on all that μ can be, hence

    c_⊥ = -[F]x⁺ μ = F x μ / (|F|² + λ²),

the point of the line of action nearest to the trunk's origin. The estimate steps towards it by α = 0.002 at 1 kHz, in
a plane (see `stadera.estimate.recursive`), and after a tilt of the trunk along what is left. Everything is in trunk
axes, so no heading is needed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.contact import ContactForces
from stadera.estimate.convergence import step_size
from stadera.estimate.measurement import Measurement
from stadera.estimate.recursive import LEAST_TILT, RecursiveCom

Array = NDArray[np.float64]

_DAMPING = 1e-3  # λ, as a share of the robot's weight: biases a centre of mass by a millionth
_NOT_TILTED = f"the height shows in a trunk that is tilted by {np.rad2deg(LEAST_TILT):.0f}° since the plane was found"
_LONGEST_STEP = 0.1  # s, that one measurement counts for at most, as a share of the settling time


class ContactCom(RecursiveCom):
    """Steps towards the line of action of the contact forces. Works with any controller, and in a closed loop or none.

    Arguments, attributes and errors: see `RecursiveCom`.
    """

    _last, _step = np.nan, 0.0

    def look_for_height(self) -> None:
        """Begins phase two: the plane's components stay, and poses tilted from now on show the height.

        Raises:
            IdentificationError: the plane's components have not been found yet.
        """
        self._look_for_height()

    def look_in_plane(self) -> None:
        """Begins phase one anew."""
        self._look_in_plane()

    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        time, up = measurement.time, measurement.up
        elapsed, self._last = time - self._last, time
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
        innovation = self._selected(error, up)
        if innovation is None:
            self._refuse(_NOT_TILTED)
            return
        self._settled.take(innovation, step)
        if self._adopt(time, mass, self._trunk.com_trunk + step * innovation, weighed and self._settled.reached):
            self._looked_at(measurement, forces, com)

    def _interrupted(self) -> None:
        self._last = np.nan
        self._settled.restart()
        self._mass_settled.restart()

    def _averaging(self) -> float:
        return self._step / (2.0 - self._step)


def _cross(a: Array, b: Array) -> Array:
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
