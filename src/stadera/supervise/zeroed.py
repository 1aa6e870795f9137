"""Contact forces with torque offsets taken off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.measurement import Measurement

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ZeroedForces:
    """What to weigh with once torque offsets are known.

    Attributes:
        forces: its noise has what is still unknown of the offsets for their constant part.
        offsets: (12,) [N·m], leg by leg.
    """

    forces: ContactForceEstimator
    offsets: Array

    @classmethod
    def of(cls, forces: ContactForceEstimator, offsets: Array, std: Array) -> ZeroedForces:
        """Offsets (12,) [N·m] as known, taken off, and how well they are."""
        noise = replace(forces.noise, torque_constant=std.reshape(4, 3))
        return cls(ContactForceEstimator(forces.robot, noise, jacobian=forces.jacobian), offsets)

    @classmethod
    def none(cls, forces: ContactForceEstimator) -> ZeroedForces:
        """Nothing known, nothing taken off."""
        return cls(forces, np.zeros(12))

    def measurement(self, m: Measurement) -> Measurement:
        """The measurement without the offsets; itself if there are none."""
        if not self.offsets.any():
            return m
        effort = m.effort.copy()
        effort[self.forces.legs.columns.ravel()] -= self.offsets
        return replace(m, effort=effort)
