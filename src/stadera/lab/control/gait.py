"""What all gaits have in common: they walk by a trunk controller and use its models of robot and trunk."""

from __future__ import annotations

from stadera.lab.control.trunk import TrunkController
from stadera.robot.model import Robot
from stadera.trunk.model import TrunkModel
from stadera.types import Bools


class Gait:
    """The part of a `Controller` that a gait leaves to its trunk controller; `update` is the gait's own.

    Args:
        controller: what it walks by.
    """

    def __init__(self, controller: TrunkController) -> None:
        self.controller = controller

    @property
    def robot(self) -> Robot:
        """The model of the robot."""
        return self.controller.robot

    @property
    def stance(self) -> Bools:
        """(4,) bool, the legs that are to carry."""
        return self.controller.stance

    def update_trunk(self, trunk: TrunkModel) -> bool:
        """Takes a new model of the trunk, for controller and planner; False where it is not plausible."""
        return self.controller.update_trunk(trunk)
