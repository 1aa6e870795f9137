"""Model of a legged robot as plain frozen values, independent of the library that read the file.

Frames: the trunk frame is the floating base's. A link's frame is its joint's frame, fixed to the link: for a URDF the
link frame; for an MJCF the body's axes with the origin at the joint's anchor.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from shlex import quote
from types import MappingProxyType
from typing import Literal

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import ModelError, UnknownNameError, require_known
from stadera.inertia import InertialParameters
from stadera.joint_words import LEG_NAMES as LEG_NAMES
from stadera.joint_words import PARTS
from stadera.robot.catalog import is_file_of
from stadera.robot.extra import ExtraJoints
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class Tree:
    """Kinematic tree as arrays: a trunk and revolute joints, in topological order."""

    links: tuple[str, ...]  # names; `links[0]` is the trunk, and `joints[i]` moves `links[i + 1]`
    joints: tuple[str, ...]  # names of the n joints
    parents: tuple[int, ...]  # `parents[i]` is the index in `links` of the parent link of joint i
    rotations: Array  # (n, 3, 3), R of joint i's frame in its parent link's frame, at zero angle
    translations: Array  # (n, 3) [m], origin of joint i's frame in its parent link's frame
    axes: Array  # (n, 3), unit vector of joint i's rotation, in its own frame

    def ancestors(self, joint: int) -> tuple[int, ...]:
        """Indices of the joints from the trunk to joint `joint`, inclusive."""
        chain = [joint]
        while (parent := self.parents[chain[-1]]) > 0:
            chain.append(parent - 1)
        return tuple(reversed(chain))

    def restricted(self, joints: tuple[str, ...]) -> Tree:
        """The tree of these joints only, including their ancestors; the trunk stays. UnknownNameError if one is not in
        this tree, ModelError if a joint's parent joint is left out.
        """
        require_known("joint", joints, self.joints)
        keep = sorted(map(self.joints.index, joints))
        kept_links = [0, *(i + 1 for i in keep)]
        for i in keep:
            if self.parents[i] not in kept_links:
                raise ModelError(f"joint {self.joints[i]!r} hangs on a joint that was left out")
        return Tree(
            links=tuple(self.links[k] for k in kept_links),
            joints=tuple(self.joints[i] for i in keep),
            parents=tuple(kept_links.index(self.parents[i]) for i in keep),
            rotations=self.rotations[keep],
            translations=self.translations[keep],
            axes=self.axes[keep],
        )


@dataclass(frozen=True)
class JointLimits:
    """Limits of one joint; infinite if the model states none."""

    lower: float = -np.inf  # rad
    upper: float = np.inf  # rad
    velocity: float = np.inf  # rad/s
    effort: float = np.inf  # N·m


@dataclass(frozen=True)
class JointDynamics:
    """Joint-side torque in addition to the rigid bodies': I_a q̈ + b q̇ + τ_c sign(q̇) + offset."""

    armature: float = 0.0  # kg·m², rotor inertia seen at the joint
    viscous: float = 0.0  # N·m·s/rad
    coulomb: float = 0.0  # N·m
    offset: float = 0.0  # N·m


@dataclass(frozen=True)
class Leg:
    """One leg: its joints from the trunk outwards (three of a quadruped: HAA, HFE, KFE) and a foot.

    Attributes:
        name: LF, RF, LH or RH of a quadruped.
        joints, links: names in the model file, from the trunk outwards.
        foot: the foot frame's name in the model file, or "<last link>_foot" if the file has none.
        foot_position: (3,) [m], centre of the foot sphere in the last link's frame; it may lie off the foot frame.
        foot_radius: [m], 0 if unknown.
        contact: components of what the ground does to the foot: 3 for a point, 6 for a flat foot.
        unfelt: (3,), axis in the last link's frame of the contact's moment that five joints do not tell, or of the
            force that two do not; zero if they tell all. unfelt_bound: times the foot's force its bound [m; 1 of a
            force].
    """

    name: str
    joints: tuple[str, ...]
    links: tuple[str, ...]
    foot: str
    foot_position: tuple[float, float, float]
    foot_radius: float = 0.0
    contact: int = 3
    unfelt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    unfelt_bound: float = 0.0


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame fixed to a link: r_link = rotation @ r_frame + translation."""

    link: str
    rotation: Array  # (3, 3)
    translation: Array  # (3,) m


@dataclass(frozen=True, eq=False)
class Shape:
    """A primitive shape fixed to a link, for figures and clearance; its pose is in the link's frame.

    `size` is (radius,) for a sphere, (radius, length) for a capsule or cylinder along its own z (a capsule's length is
    the distance between the centres of its caps), and the three full edge lengths for a box [m].
    """

    link: str
    kind: Literal["sphere", "capsule", "cylinder", "box"]
    size: tuple[float, ...]
    rotation: Array
    translation: Array

    def reach(self, direction: Array) -> Array:
        """Distance from its centre to its farthest point along unit vectors (n, 3) in its own axes, (n,) [m]."""
        along = np.abs(direction)
        match self.kind:
            case "sphere":
                return np.full(len(along), self.size[0])
            case "capsule":
                return self.size[0] + 0.5 * self.size[1] * along[:, 2]
            case "cylinder":
                across = np.sqrt(np.maximum(1.0 - along[:, 2] ** 2, 0.0))
                return self.size[0] * across + 0.5 * self.size[1] * along[:, 2]
            case "box":
                return np.asarray(0.5 * along @ np.array(self.size))

    def moved(self, link: str, rotation: Array, translation: Array) -> Shape:
        """The shape on another link, in whose frame its own link's is at that rotation and translation [m]."""
        place = rotation @ self.translation + translation
        return replace(self, link=link, rotation=rotation @ self.rotation, translation=place)


@dataclass(frozen=True, eq=False)
class Robot:
    """A legged robot: tree, legs, prior inertial parameters and joint dynamics, limits, frames and simple shapes.

    Attributes:
        name: as requested, or the model file's own.
        tree: all leg joints; other joints are fixed and their links merged into the parents.
        legs: of a quadruped LF, RF, LH, RH in this order.
        inertias: prior (CAD) parameters by link, in the link's frame, with everything fixed to the link included.
        dynamics: prior joint dynamics by joint.
        dynamics_std: standard deviations of `dynamics`, for joints that were identified; NaN for terms that were not.
        distrust: why its identified legs are not to be trusted, empty if they are; nothing weighed with it is good.
        limits: by joint.
        frames: fixed frames by name, including feet and IMUs.
        shapes: primitive shapes.
        source: the model file, None for a robot made in memory. feet, root: the feet and the trunk link that its owner
            named to load it; none, and None, where they were found.
        notes: the loader's assumptions and corrections, one sentence each.
        extra: the joints outside the legs that can move; None if there are none. Their links are part of the trunk's
            inertia, at the reference position of `extra`.
    """

    name: str
    tree: Tree
    legs: tuple[Leg, ...]
    inertias: Mapping[str, InertialParameters]
    dynamics: Mapping[str, JointDynamics]
    limits: Mapping[str, JointLimits]
    frames: Mapping[str, Frame] = field(default_factory=dict)
    shapes: tuple[Shape, ...] = ()
    source: Path | None = None
    notes: tuple[str, ...] = ()
    extra: ExtraJoints | None = None
    dynamics_std: Mapping[str, JointDynamics] = field(default_factory=dict)
    distrust: str = ""
    feet: tuple[str, ...] = ()
    root: str | None = None

    def __post_init__(self) -> None:
        for name, keys in (("inertias", self.tree.links), ("dynamics", self.tree.joints), ("limits", self.tree.joints)):
            given = getattr(self, name)
            if missing := [key for key in keys if key not in given]:
                raise ModelError(f"robot {self.name}: {name} lack {', '.join(missing)}")
            object.__setattr__(self, name, MappingProxyType(dict(given)))
        for name in ("frames", "dynamics_std"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __repr__(self) -> str:
        """One line for the robot and one for each leg."""
        joints = len(self.tree.joints)
        lines = [f"Robot {self.name!r}: {self.mass:.2f} kg, trunk {self.trunk!r}, {joints} joints, from {self.source}"]
        return "\n".join(lines + [f"  {leg.name}: {', '.join(leg.joints)}, foot {leg.foot}" for leg in self.legs])

    @property
    def argument(self) -> str:
        """What `--robot` needs to load it again: a name of the catalogue or its file's path, with its owner's feet and
        trunk.
        """
        known = self.source is None or is_file_of(self.name, self.source)
        given = self.name if known else quote(os.path.relpath(self.source or ""))
        more = [f"--feet {','.join(self.feet)}"] * bool(self.feet) + [f"--trunk {self.root}"] * bool(self.root)
        return " ".join((given, *more))

    @property
    def trunk(self) -> str:
        """Name of the trunk link."""
        return self.tree.links[0]

    @cached_property
    def mass(self) -> float:
        """Mass of the whole robot, prior values [kg]."""
        return sum(self.inertias[link].mass for link in self.tree.links)

    @property
    def quadruped(self) -> bool:
        """True if it has the legs LF, RF, LH and RH of three joints each."""
        legs = {leg.name: len(leg.joints) for leg in self.legs}
        return tuple(legs) == LEG_NAMES and set(legs.values()) == {len(PARTS)}

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of joints that its legs have, from the trunk outwards."""
        most = max(len(leg.joints) for leg in self.legs)
        return PARTS if self.quadruped else tuple(f"no. {k + 1}" for k in range(most))

    @cached_property
    def leg_length(self) -> float:
        """Length of the shortest leg when fully extended [m], from its second joint, its first of two, to its foot."""
        lengths = []
        for leg in self.legs:
            after = leg.joints[min(2, len(leg.joints) - 1) :]
            arms = [self.tree.translations[self.tree.joints.index(joint)] for joint in after]
            lengths.append(sum(float(np.linalg.norm(arm)) for arm in (*arms, np.array(leg.foot_position))))
        return min(lengths)

    @cached_property
    def unfelt_std(self) -> Array:
        """Standard deviations (legs,) of the `Leg.unfelt` moments and forces [N·m, N]: anywhere within their bounds,
        with all of the weight on one foot.
        """
        bounds = np.array([leg.unfelt_bound for leg in self.legs])
        return np.asarray(GRAVITY * self.mass / np.sqrt(3.0) * bounds)

    @cached_property
    def stops(self) -> Array:
        """Lower and upper mechanical stop of the legs' joints, (joints, 2) [rad]."""
        return np.array([[self.limits[joint].lower, self.limits[joint].upper] for joint in self.tree.joints])

    @property
    def effort_limits(self) -> Array:
        """Of the legs' joints, (joints,) [N·m]; where the model has none, or a placeholder, the torque that carries the
        robot's weight on one stretched leg.
        """
        given = np.array([self.limits[joint].effort for joint in self.tree.joints])
        largest = GRAVITY * self.mass * self.leg_length
        return np.where(given < 2.0 * largest, given, largest)

    @property
    def hips(self) -> Array:
        """Origins of the legs' first joints in the trunk frame [m], (legs, 3)."""
        return np.array([self.tree.translations[self.tree.joints.index(leg.joints[0])] for leg in self.legs])

    def leg(self, name: str) -> Leg:
        """The leg of that name: LF, RF, LH, RH on quadrupeds (any case), or the robot's own prefix (FL, RR, ...).
        UnknownNameError: no such leg.
        """
        wanted = name.upper()
        for leg in self.legs:
            if wanted == leg.name.upper():
                return leg
        for leg in self.legs:
            # the robot's own prefix ends at the name's first separator: FL_hip_joint, fl.hx
            own = leg.joints[0].upper()
            if own.startswith(wanted) and not own[len(wanted) : len(wanted) + 1].isalpha():
                return leg
        raise UnknownNameError("leg", name, (leg.name for leg in self.legs), self.name)

    def with_inertias(self, inertias: Mapping[str, InertialParameters]) -> Robot:
        """Returns the robot with other inertial parameters for these links (in the links' frames). UnknownNameError: a
        name is not a link of the tree.
        """
        require_known("link", inertias, self.tree.links, self.name)
        return replace(self, inertias={**self.inertias, **inertias})

    def with_dynamics(
        self, dynamics: Mapping[str, JointDynamics], std: Mapping[str, JointDynamics] | None = None
    ) -> Robot:
        """Returns the robot with other joint dynamics for these joints, and their standard deviations, see
        `dynamics_std`, if there are any. UnknownNameError: a name is not a joint of the tree.
        """
        require_known("joint", dynamics, self.tree.joints, self.name)
        kept = {joint: known for joint, known in self.dynamics_std.items() if joint not in dynamics}
        return replace(self, dynamics={**self.dynamics, **dynamics}, dynamics_std={**kept, **(std or {})})

    def posed(self, positions: Mapping[str, float]) -> Robot:
        """Returns the robot with these joints outside the legs at other positions [rad or m]: its trunk's inertia has
        their links there. Names that are not those of such joints are ignored.
        """
        if self.extra is None:
            return self
        moved = self.extra.at(positions)
        trunk = self.inertias[self.trunk] - self.extra.lumped + moved.lumped
        return replace(self, inertias={**self.inertias, self.trunk: trunk}, extra=moved)

    def leg_tree(self, name: str) -> Tree:
        """The tree of one leg on a held trunk, the same object at each call."""
        return self._leg_trees[self.leg(name).name]

    @cached_property
    def _leg_trees(self) -> dict[str, Tree]:
        return {leg.name: self.tree.restricted(leg.joints) for leg in self.legs}
