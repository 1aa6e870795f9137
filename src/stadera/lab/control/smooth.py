"""The controller's trunk model, checked for plausibility and low-pass filtered.

A new model is a target. Mass m and first moment h = m c approach it through a first-order low-pass::

    ṁ = (m* - m) / T,     ḣ = (h* - h) / T

Torques are continuous in m and h, so a step of the model changes them by at most the share dt / T of its full effect in
one control period. The centre of mass h / m is a mean of past and new ones weighted by mass, so it stays in any box
that contains them all.
"""

from __future__ import annotations

import numpy as np

from stadera.constants import NOTHING
from stadera.errors import ModelError, positive
from stadera.trunk.model import TrunkBounds, TrunkModel


class SmoothTrunk:
    """A `TrunkModel` that is checked and low-pass filtered with T [s].

    Attributes:
        mass, moment: [kg], (3,) [kg·m], in use now.
        target_mass, target_moment: those of the last accepted model, without filtering: for planning ahead.
        rejected: why the last model was rejected, one sentence; empty if it was accepted.
    """

    def __init__(self, start: TrunkModel, bounds: TrunkBounds, time_constant: float = 0.05) -> None:
        positive("the trunk model's time constant", time_constant, "s", ModelError)
        bounds.check(start)
        self.bounds, self.time_constant = bounds, time_constant
        self.rejected = ""
        self.mass, self.moment = start.mass, start.mass * start.com_trunk
        self.target_mass, self.target_moment = self.mass, self.moment
        self._settled = True

    @property
    def model(self) -> TrunkModel:
        return TrunkModel(self.mass, self.moment / self.mass)

    def accept(self, model: TrunkModel) -> bool:
        """Makes a model the target if it is plausible; else keeps the last one and sets `rejected`."""
        self.rejected = self.bounds.complaint(model) or ""
        if self.rejected:
            return False
        self.target_mass, self.target_moment = model.mass, model.mass * model.com_trunk
        self._settled = False
        return True

    def advance(self, dt: float) -> None:
        """Advances the filter by dt [s]."""
        if self._settled:
            return
        share = dt / (self.time_constant + dt)
        self.mass += share * (self.target_mass - self.mass)
        left = self.target_moment - self.moment
        self.moment = self.moment + share * left
        self._settled = abs(self.target_mass - self.mass) + float(np.abs(left).max()) < NOTHING
