"""Common base of the gaits: the trunk controller and the models of robot and trunk."""

from __future__ import annotations

from stadera.lab.control.trunk import TrunkController
from stadera.robot.model import Robot
from stadera.trunk.model import TrunkModel
from stadera.types import Bools


class Gait:
    """The part of a `Controller` that a gait delegates to its trunk controller; `update` is implemented by the gait.

    Args:
        controller: the trunk controller.
    """

    def __init__(self, controller: TrunkController) -> None:
        self.controller = controller

    @property
    def robot(self) -> Robot:
        """The model of the robot."""
        return self.controller.robot

    @property
    def stance(self) -> Bools:
        """Legs meant to be in stance, (4,) bool."""
        return self.controller.stance

    def update_trunk(self, trunk: TrunkModel) -> bool:
        """Sets a new model of the trunk for controller and planner; False if it is not plausible."""
        return self.controller.update_trunk(trunk)
