"""Virtual springs and dampers of the trunk, scaled from the robot by one rule for all robots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array


@dataclass(frozen=True)
class Response:
    """Desired response in one direction, as that of a mass on a spring.

    Attributes:
        frequency: natural frequency ω [rad/s].
        damping: damping ratio ζ.
    """

    frequency: float
    damping: float = 0.8

    def __post_init__(self) -> None:
        for name in ("frequency", "damping"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ModelError(f"a response's {name} must be positive, got {value}")


@dataclass(frozen=True, eq=False)
class TrunkGains:
    """Springs and dampers of the trunk controller.

    Attributes:
        stiffness: [N/m], and
        damping: [N·s/m], on the centre of mass, equal in all directions.
        angular_stiffness: (3,) [N·m/rad], and
        angular_damping: (3,) [N·m·s/rad], about the trunk's axes. Not multiplied by an inertia again: the paper writes
            I K_p for the torsional stiffness (eq. 12), which is the product given here.
    """

    stiffness: float
    damping: float
    angular_stiffness: Array
    angular_damping: Array

    @classmethod
    def of(cls, robot: Robot, linear: Response | None = None, angular: Response | None = None) -> TrunkGains:
        """K = m ω², D = 2 ζ ω m, and the same with the moments of inertia, of the whole robot in its nominal stance.

        Args:
            linear: of the centre of mass; None for 12 rad/s.
            angular: of roll, pitch and yaw; None for 16 rad/s.
        """
        linear, angular = linear or Response(12.0), angular or Response(16.0)
        whole = composite(robot, standing_configuration(robot))
        moments = np.diag(whole.inertia_com)
        return cls(
            stiffness=whole.mass * linear.frequency**2,
            damping=2.0 * linear.damping * linear.frequency * whole.mass,
            angular_stiffness=moments * angular.frequency**2,
            angular_damping=2.0 * angular.damping * angular.frequency * moments,
        )


def composite(robot: Robot, joint_position: Array) -> InertialParameters:
    """The whole robot as one rigid body, in the trunk frame, at joint positions (n,) [rad]."""
    rotations, translations = forward_kinematics(robot.tree, joint_position[None])
    total = InertialParameters.zero()
    for i, link in enumerate(robot.tree.links):
        total = total + robot.inertias[link].transformed(rotations[0, i], translations[0, i])
    return total
