"""Approach (c): the centre of mass from contact forces (the paper's section III.C, eq. 16-19).

At rest the contact forces' moment about the whole robot's centre of mass c vanishes, c x F = μ with F = Σ f_i and
μ = Σ p_i x f_i about the trunk's origin, p_i where the ground touches the foot. So -[F]x c = μ, of which [F]x has
rank two; its damped pseudo-inverse ([F]xᵀ [F]x + λ² 1)⁻¹ [F]xᵀ is -[F]x / (|F|² + λ²) on all that μ can be, hence

    c_⊥ = -[F]x⁺ μ = F x μ / (|F|² + λ²),

the point of the line of action nearest to the trunk's origin. The estimate steps towards it by α = 0.002 at 1 kHz,
first in a plane (see `RecursiveCom`), and after a tilt of the trunk along the remaining direction. All vectors
are in trunk axes, so no heading is needed.
"""

from __future__ import annotations

import numpy as np

from stadera.lab.laws.recursive import LEAST_TILT, RecursiveCom, step_size
from stadera.trunk.measurement import Measurement
from stadera.trunk.standing.forces import ContactForces

_NOT_TILTED = f"the height is observable in a trunk tilted by {np.rad2deg(LEAST_TILT):.0f}° since the plane was found"


class ContactCom(RecursiveCom):
    """Steps towards the line of action of the contact forces, with any controller, in closed loop or open loop."""

    _last = np.nan

    def look_for_height(self) -> None:
        """Starts phase two: the components in the plane are kept, and later tilted poses determine the height.
        Raises IdentificationError: the components in the plane have not been found yet.
        """
        self._look_for_height()

    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        time, up = measurement.time, measurement.up
        elapsed, self._last = time - self._last, time
        if not elapsed > 0:  # the first after an interruption has no duration
            return
        settling = self.settings.settling
        step = self._step = step_size(settling, min(elapsed, self.settings.longest_step * settling))
        F, mu = np.split(forces.wrench, 2)
        square = float(F @ F)
        nearest = np.cross(F, mu) / (square + self.settings.damping**2 * square)
        com = self._robot_com(forces.weights.moment)
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
        super()._interrupted()
        self._last = np.nan
