"""Feet and their forces at the instants of a log, computed once for all checks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stadera.checks.blocks import Blocks
from stadera.constants import GRAVITY
from stadera.legs.model import LegModel, LegPose
from stadera.robot.model import Robot
from stadera.trunk.standing.vertical import vertical_by_forces
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class Footing:
    """Kinematics and forces of the legs from encoders and torques, trunk frame; legs in the robot's order.

    The forces are those of legs at rest under the actual specific force (`LegModel.forces_at_rest`): the effect of the
    legs' accelerations cancels over steps, and is zero at rest.

    Attributes:
        robot: the model.
        blocks: the instants, joints in the tree's order.
    """

    robot: Robot
    blocks: Blocks

    @property
    def legs(self) -> LegModel:
        """The model of the legs."""
        return LegModel.of(self.robot)

    @cached_property
    def specific_force(self) -> Array:
        """(instants, 3) [m/s²]; without an IMU along the total contact force."""
        b = self.blocks
        if b.specific_force is not None:
            return b.specific_force
        still = np.zeros_like(b.position)
        return GRAVITY * vertical_by_forces(self.robot, b.position, still, b.effort)[0]

    @cached_property
    def up(self) -> Array:
        """(instants, 3), unit vectors along the specific force."""
        size = np.linalg.norm(self.specific_force, axis=1, keepdims=True)
        return np.asarray(self.specific_force / np.where(size > 0, size, 1.0))

    @cached_property
    def pose(self) -> LegPose:
        """Pose of the legs."""
        return self.legs.pose(self.blocks.position[:, self.legs.columns])

    @cached_property
    def force(self) -> Array:
        """Force of the ground on the feet, (instants, 4, 3) [N]."""
        columns, b = self.legs.columns, self.blocks
        return self.legs.forces_at_rest(b.position[:, columns], b.effort[:, columns], self.specific_force)[0]

    @cached_property
    def contact(self) -> Array:
        """Contact points, (instants, 4, 3) [m]."""
        return np.asarray(self.legs.contacts(self.pose.feet, self.up.T).transpose(1, 2, 0))

    @cached_property
    def load(self) -> Array:
        """Load of each foot along the specific force as a share of the robot's weight, (instants, 4)."""
        return np.asarray(np.einsum("nlk,nk->nl", self.force, self.up) / (self.robot.mass * GRAVITY))

    @cached_property
    def speed(self) -> Array:
        """Velocity of the contact points relative to the trunk, (instants, 4, 3) [m/s]."""
        jacobians = self.pose.jacobians(self.contact.transpose(2, 0, 1))
        rate = self.blocks.rate[:, self.legs.columns]
        return np.asarray((jacobians * rate).sum(axis=-1).transpose(1, 2, 0))

    @cached_property
    def leg_moment(self) -> Array:
        """First moment of the legs, (instants, 3) [kg·m]."""
        return np.asarray((self.legs.link_mass * self.legs.centres(self.pose)).sum(axis=(-1, -2)).T)
