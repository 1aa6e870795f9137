"""The trunk as estimated at one time, with what is known from outside; computed as far as it is asked for."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from stadera.inertia import InertialParameters
from stadera.robot.model import Robot
from stadera.trunk.joint_errors import Errors
from stadera.trunk.load import without_scale
from stadera.trunk.model import ImplausibleError, TrunkBounds, TrunkModel
from stadera.trunk.outside import Correction, Knowledge
from stadera.trunk.result import TrunkParameters
from stadera.trunk.segment import Segment
from stadera.types import Array


class Reading:
    """A trunk.

    Args:
        robot: the model. start: values of what was not observed.
        segment: the rows. errors: of the model. known: from outside.
    """

    def __init__(
        self,
        robot: Robot,
        start: InertialParameters,
        segment: Segment,
        errors: Errors,
        known: tuple[Knowledge, ...],
    ) -> None:
        self._robot, self._start, self._segment, self._errors, self._known = robot, start, segment, errors, known

    @cached_property
    def vector(self) -> Array:
        """The ten parameters (10,)."""
        return self._corrected[0] if self._known else self._segment.mean(self._errors.mean)

    @property
    def covariance(self) -> Array:
        """Of the ten parameters, (10, 10)."""
        return self._corrected[1]

    @cached_property
    def _corrected(self) -> tuple[Array, Array, Array]:
        """The ten parameters, their covariance, and `Errors.by_scale`."""
        segment, errors = self._segment, self._errors
        found = segment.mean(errors.mean), errors.trunk_covariance(segment), errors.by_scale(segment.sensitivity)
        outside = Correction.by(self._known, errors, segment, errors.scatter, errors.alike(segment))
        return found if outside is None else outside.of_trunks({segment: np.eye(10)}, *found)

    @cached_property
    def parameters(self) -> TrunkParameters:
        """All ten parameters and their uncertainty."""
        robot, (vector, covariance, by_scale) = self._robot, self._corrected
        found = TrunkParameters.of(vector, covariance, self._start, robot.mass, robot.leg_length)
        return replace(found, mass_std_without_scale=without_scale(covariance[0, 0], by_scale[0]))

    def complaint(self, bounds: TrunkBounds) -> str | None:
        """Why the trunk, with `start` for unobserved parameters, is implausible; None if plausible."""
        mass, *moment = self.vector[:4].tolist()
        if not mass > 0.0:
            return f"a mass of {mass:.3g} kg"
        if bounds.mass[0] <= mass <= bounds.mass[1]:
            within = zip(bounds.low.tolist(), moment, bounds.high.tolist(), strict=True)
            if all(low * mass <= value <= high * mass for low, value, high in within):
                return None  # the start is inside too, so any mixture of the two is
        try:
            return bounds.complaint(TrunkModel.of(self.parameters.inertial))
        except ImplausibleError as error:
            return str(error)
