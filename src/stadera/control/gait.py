"""What all gaits are: something that walks by a trunk controller, whose robot and belief are its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stadera.control.trunk import TrunkController
from stadera.estimate.trunk import TrunkModel
from stadera.robot.model import Robot

Bools = NDArray[np.bool_]


class Gait:
    """The part of a `Controller` that a gait leaves to its trunk controller; `update` is the gait's own.

    Args:
        controller: what it walks by.
    """

    def __init__(self, controller: TrunkController) -> None:
        self.controller = controller

    @property
    def robot(self) -> Robot:
        """The robot that it believes in."""
        return self.controller.robot

    @property
    def stance(self) -> Bools:
        """(4,) bool, the legs that are to carry."""
        return self.controller.stance

    def believe(self, trunk: TrunkModel) -> bool:
        """Takes a new belief of the trunk, for whatever is controlled and planned; False where it is not plausible."""
        return self.controller.believe(trunk)
