"""Virtual springs and dampers of the trunk, scaled from the robot by one rule for all robots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError, positive
from stadera.inertia import InertialParameters
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array

ANGULAR, DAMPING = 16.0, 0.8
"""Natural frequency of roll, pitch and yaw [rad/s], and damping ratio of all directions."""


@dataclass(frozen=True, eq=False)
class TrunkGains:
    """Springs and dampers of the trunk controller."""

    stiffness: float  # [N/m]
    damping: float  # [N·s/m], on the centre of mass, equal in all directions
    angular_stiffness: Array  # (3,) [N·m/rad]
    # (3,) [N·m·s/rad], about the trunk's axes. Not multiplied by an inertia again: the paper writes I K_p for the
    # torsional stiffness (eq. 12), which is the product given here.
    angular_damping: Array

    @classmethod
    def of(cls, robot: Robot, linear: float = 12.0, angular: float = ANGULAR, damping: float = DAMPING) -> TrunkGains:
        """K = m ω², D = 2 ζ ω m, and the same with the moments of inertia, of the whole robot in its nominal stance;
        natural frequencies ω of the centre of mass (linear), and of roll, pitch and yaw (angular) [rad/s], and damping
        ratio ζ.
        """
        for value in (linear, angular, damping):
            positive("frequencies and damping of the trunk", value, error=ModelError)
        whole = composite(robot, standing_configuration(robot))
        moments = np.diag(whole.inertia_com)
        return cls(
            stiffness=whole.mass * linear**2,
            damping=2.0 * damping * linear * whole.mass,
            angular_stiffness=moments * angular**2,
            angular_damping=2.0 * damping * angular * moments,
        )


def composite(robot: Robot, joint_position: Array) -> InertialParameters:
    """The whole robot as one rigid body, in the trunk frame, at joint positions (n,) [rad]."""
    rotations, translations = forward_kinematics(robot.tree, joint_position[None])
    total = InertialParameters.zero()
    for i, link in enumerate(robot.tree.links):
        total = total + robot.inertias[link].transformed(rotations[0, i], translations[0, i])
    return total
