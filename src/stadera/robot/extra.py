"""Joints that belong to no leg, such as an arm's or a turning lidar's, and the links that they move.

They hang from the trunk. `Robot.inertias` has their links lumped into the trunk at a reference position; where they
move, `stadera.body` computes what that changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stadera.inertia import InertialParameters
from stadera.robot.kinematics import link_poses
from stadera.types import Array

if TYPE_CHECKING:
    from stadera.logs.recording import OtherJoints
    from stadera.robot.model import Frame


@dataclass(frozen=True, eq=False)
class ExtraJoints:
    """The k joints outside the legs that can move, in topological order."""

    joints: tuple[str, ...]  # names
    parents: tuple[int, ...]  # of each joint, the index of the joint whose link carries it; -1 for the trunk
    # rotations, translations: (k, 3, 3) and (k, 3) [m], pose of each joint's frame in its parent link's at zero
    rotations: Array
    translations: Array
    axes: Array  # (k, 3), unit vectors, in the joints' own frames
    sliding: tuple[bool, ...]  # (k,), True for a prismatic joint, whose position is in m
    bodies: tuple[InertialParameters, ...]  # of each link, in its joint's frame, with everything fixed to it
    reference: Array  # (k,) [rad or m], the position at which the robot's trunk contains the links
    links: tuple[str, ...] = ()  # names of the links that they move
    effort: tuple[float, ...] = ()  # (k,) [N·m or N], limits; infinite where the model states none
    frames: Mapping[str, Frame] = field(default_factory=dict)  # every link and site of the file on these links

    def at(self, positions: Mapping[str, float]) -> ExtraJoints:
        """The same joints with another reference; joints that are not named keep theirs."""
        named = zip(self.joints, self.reference.tolist(), strict=True)
        return replace(self, reference=np.array([positions.get(joint, now) for joint, now in named]))

    @cached_property
    def lumped(self) -> InertialParameters:
        """All links together at the reference, trunk frame."""
        placed = zip(self.bodies, self.poses(self.reference), strict=True)
        return sum((body.transformed(*pose) for body, pose in placed), InertialParameters.zero())

    def states(self, recorded: OtherJoints | None, samples: int) -> Array:
        """Positions, velocities and efforts, (samples, 3 k), of what was recorded, joints that were not at the
        reference; zero efforts where none are known; (samples, 0) if nothing was recorded.
        """
        if recorded is None:
            return np.zeros((samples, 0))
        states = np.zeros((samples, 3, len(self.joints)))
        states[:, 0] = self.reference
        own = [k for k, joint in enumerate(recorded.names) if joint in self.joints]
        places = [self.joints.index(recorded.names[k]) for k in own]
        for part, values in enumerate((recorded.position, recorded.velocity, recorded.effort)):
            if values is not None:
                states[:, part, places] = values[:, own]
        return states.reshape(samples, -1)

    def poses(self, position: Array) -> list[tuple[Array, Array]]:
        """Rotation and origin [m] of each link in the trunk frame."""
        parents = [parent + 1 for parent in self.parents]
        R, p = link_poses(parents, self.rotations, self.translations, self.axes, position[None], self.sliding)
        return list(zip(R[0, 1:], p[0, 1:], strict=True))
