"""Output of the model readers: a URDF or MJCF as a tree of its links, before trunk and legs are known."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from stadera.errors import ModelError, require_known
from stadera.inertia import InertialParameters
from stadera.robot.model import JointDynamics, JointLimits, Shape
from stadera.types import Array

TURNED = "turned round: "  # begins the name of the link without mass by which a joint of `rooted_at` moves another


@dataclass(frozen=True, eq=False)
class FileJoint:
    """A joint of a model file: it turns about or slides along a unit axis (3,) in its own frame, or is of another kind,
    which stays at zero.
    """

    name: str
    kind: Literal["turns", "slides", "other"]
    axis: Array
    limits: JointLimits
    dynamics: JointDynamics


@dataclass(frozen=True, eq=False)
class FileLink:
    """A link of a model file; all quantities in its frame, which is that of its joint."""

    name: str
    parent: int  # place of the link that carries it; -1 for the root
    rotation: Array  # (3, 3), with the translation its pose in the parent's frame at zero
    translation: Array  # (3,) [m]
    body: InertialParameters  # its own ten parameters, before any merging
    joint: FileJoint | None = None  # None if it is fixed to its parent
    origin: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m], of the file's own frame, with the same axes


@dataclass(frozen=True, eq=False)
class ModelFile:
    """A model file that has been read but not yet interpreted as a robot. ModelError: a mass that is negative or not
    finite.
    """

    path: Path
    name: str  # of the model in it
    links: tuple[FileLink, ...]  # the root first, each after its parent
    trunk: str  # name of the trunk link, which is the root or fixed to it
    sites: Mapping[str, tuple[int, Array, Array]]  # named frames besides the links: place of their link, pose in it
    shapes: tuple[Shape, ...]  # primitive shapes, each in the file's own frame of its link
    loops: tuple[tuple[str, str], ...] = ()  # names of links between which the file closes a loop

    def __post_init__(self) -> None:
        for link in self.links:
            if link.body.mass < 0 or not np.isfinite(link.body.mass):
                raise ModelError(f"{self.path}: link {link.name!r} has mass {link.body.mass:g} kg; it is not negative")

    @cached_property
    def joints(self) -> tuple[int, ...]:
        """Places of the links that have a joint."""
        return tuple(k for k, link in enumerate(self.links) if link.joint is not None)

    def joint(self, k: int) -> FileJoint:
        """The joint of the link at a place."""
        joint = self.links[k].joint
        assert joint is not None
        return joint

    def above(self, k: int) -> int:
        """Place of the next link above one that has a joint, or of the root."""
        k = self.links[k].parent
        return k if k <= 0 or self.links[k].joint is not None else self.above(k)

    def require_open(self, moving: Collection[int]) -> None:
        """Checks that the joints of some links are part of no closed loop: what they carry would not follow from their
        own torques. ModelError: one is; names the loop.
        """
        names = [link.name for link in self.links]
        for ends in self.loops:
            above = [self._above_all(names.index(end)) for end in ends]
            if around := (above[0] ^ above[1]) & set(moving):
                joints = ", ".join(self.joint(k).name for k in sorted(around))
                raise ModelError(
                    f"{self.path}: links {ends[0]!r} and {ends[1]!r} are connected too, a closed loop with the legs' "
                    f"joints {joints}: their torques alone do not tell what the foot carries"
                )

    def _above_all(self, k: int) -> set[int]:
        """Places of the links between the root and a link, itself included."""
        return {k} if k <= 0 else {k} | self._above_all(self.links[k].parent)

    def carried(self, moving: Collection[int]) -> list[tuple[int, Array, Array]]:
        """With all joints at zero but those of some links: for each link the place of the one that moves it, itself
        or the root perhaps, and its pose in that one's frame.
        """
        found: list[tuple[int, Array, Array]] = []
        for k in range(len(self.links)):
            if k == 0 or k in moving:
                found.append((k, np.eye(3), np.zeros(3)))
            else:
                found.append(self.placed(found, k))
        return found

    def placed(self, carried: list[tuple[int, Array, Array]], k: int) -> tuple[int, Array, Array]:
        """The place of the moving link that carries a link's joint, and its frame's pose in that one's at zero."""
        at, R, p = carried[self.links[k].parent]
        return at, R @ self.links[k].rotation, p + R @ self.links[k].translation

    def lumped(self, carried: list[tuple[int, Array, Array]]) -> dict[int, InertialParameters]:
        """By place, the ten parameters of each moving link with everything that it carries."""
        found: dict[int, InertialParameters] = {}
        for link, (at, R, p) in zip(self.links, carried, strict=True):
            found[at] = found.get(at, InertialParameters.zero()) + link.body.transformed(R, p)
        return found


def rooted_at(file: ModelFile, name: str) -> ModelFile:
    """The file with another link, which its owner names, as its root and trunk. UnknownNameError: no such link.

    Joints between the old root and the new one are turned round. A joint from P to C with the pose T at zero moves P,
    seen from C, as one about its negative axis at C's origin, then T⁻¹: so C carries a link without mass by a joint of
    the same name and position, and that link carries P, fixed.
    """
    names = [link.name for link in file.links]
    require_known("link", (name,), names, file.name)
    links, child = list(file.links), names.index(name)
    up, still = links[child].parent, (np.eye(3), np.zeros(3))
    links[child] = FileLink(name, -1, *still, links[child].body, None, links[child].origin)
    while up >= 0:
        turned, at = file.links[child], child
        if (joint := turned.joint) is not None:
            around = replace(joint, axis=-joint.axis)
            links.append(FileLink(TURNED + names[up], child, *still, InertialParameters.zero(), around))
            at = len(links) - 1
        R = turned.rotation.T
        links[up] = replace(links[up], parent=at, rotation=R, translation=-R @ turned.translation, joint=None)
        child, up = up, file.links[up].parent
    return _in_order(replace(file, trunk=name), links, names.index(name))


def _in_order(file: ModelFile, links: list[FileLink], root: int) -> ModelFile:
    """The file with these links, the root first and each after its parent."""
    order = [root]
    for k in order:
        order += [child for child, link in enumerate(links) if link.parent == k]
    places = {k: place for place, k in enumerate(order)} | {-1: -1}
    moved = tuple(replace(links[k], parent=places[links[k].parent]) for k in order)
    sites = {name: (places[k], R, p) for name, (k, R, p) in file.sites.items()}
    return replace(file, links=moved, sites=sites)
