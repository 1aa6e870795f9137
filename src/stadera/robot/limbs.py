"""Limbs besides the legs, and where on a robot a load may be: on its trunk, at the end of a limb, or on any named link.

A limb is a chain of joints outside the legs. Joints of grippers and fingers are not part of it: what they hold presses
them, so their torques tell no weight. Its end is a hand or a head; a link from which several limbs branch, such as a
torso, may carry a load too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from stadera.errors import UnknownNameError
from stadera.robot.extra import ExtraJoints
from stadera.robot.model import Robot
from stadera.types import Array

_FINGER = re.compile(r"gripper|finger|thumb|hand|claw|jaw", re.IGNORECASE)
_REACH = 0.25  # least reach of a limb, from its first joint to the centre of its last link, share of the legs' length
_ALIKE = 0.1  # difference of the masses of two hands, as a share


@dataclass(frozen=True, eq=False)
class Place:
    """A link or frame on which a load may be, and its pose in the link that moves it."""

    name: str
    body: int  # place among the joints of `stadera.body.Body` of the one that moves it, -1 for the trunk
    rotation: Array  # (3, 3)
    translation: Array  # (3,) [m]


@dataclass(frozen=True, eq=False)
class Limbs:
    """Joints of limbs, and the ends at which a load is looked for."""

    joints: tuple[int, ...]  # places among those of `ExtraJoints`, without grippers and fingers
    ends: tuple[int, ...]  # of these, the joints whose links may carry a load
    hands: tuple[tuple[int, int], ...]  # pairs of ends that may carry one load together

    @staticmethod
    @lru_cache(maxsize=16)
    def of(robot: Robot) -> Limbs:
        """Of a robot; empty if it has no joints outside the legs."""
        extra = robot.extra
        if extra is None:
            return Limbs((), (), ())
        joints: list[int] = []
        for k, joint in enumerate(extra.joints):
            if not _FINGER.search(joint) and (extra.parents[k] < 0 or extra.parents[k] in joints):
                joints.append(k)
        least = _REACH * robot.leg_length
        ends = []
        for k in joints:
            after = [c for c in joints if extra.parents[c] == k]
            if (not after and _reach(extra, k) > least) or sum(_beyond(extra, joints, c) > least for c in after) > 1:
                ends.append(k)
        tips = [k for k in ends if all(extra.parents[c] != k for c in joints)]
        return Limbs(tuple(joints), tuple(ends), tuple(pair for pair in combinations(tips, 2) if _alike(extra, *pair)))


def place_of(robot: Robot, name: str) -> Place:
    """The place of a link or frame of the model. UnknownNameError: none of that name; lists the links."""
    tree, extra = robot.tree, robot.extra
    if extra is not None and name in extra.frames:
        frame = extra.frames[name]
        return Place(name, len(tree.joints) + extra.links.index(frame.link), frame.rotation, frame.translation)
    if name in tree.links:
        return Place(name, tree.links.index(name) - 1, np.eye(3), np.zeros(3))
    if name in robot.frames:
        frame = robot.frames[name]
        return Place(name, tree.links.index(frame.link) - 1, frame.rotation, frame.translation)
    raise UnknownNameError("link", name, (*tree.links, *(extra.links if extra is not None else ())), robot.name)


def inwards(extra: ExtraJoints, joint: int) -> Iterator[int]:
    """Yields the joints of a limb from one of them inwards, up to where it branches off or the trunk."""
    while True:
        yield joint
        joint = extra.parents[joint]
        if joint < 0 or extra.parents.count(joint) > 1:
            return


def _reach(extra: ExtraJoints, joint: int) -> float:
    """Distance [m] along a limb from its first joint to the centre of its last link."""
    *before, _ = inwards(extra, joint)
    return sum(float(np.linalg.norm(arm)) for arm in (extra.bodies[joint].com, *extra.translations[before]))


def _beyond(extra: ExtraJoints, joints: list[int], joint: int) -> float:
    """Greatest reach of what hangs from a joint [m]."""
    after = [
        _beyond(extra, joints, c) + float(np.linalg.norm(extra.translations[c]))
        for c in joints
        if extra.parents[c] == joint
    ]
    return max(after, default=float(np.linalg.norm(extra.bodies[joint].com)))


def _alike(extra: ExtraJoints, one: int, other: int) -> bool:
    """True if two limbs have as many joints and hands of about the same mass."""
    a, b = extra.bodies[one].mass, extra.bodies[other].mass
    same = len(list(inwards(extra, one))) == len(list(inwards(extra, other)))
    return same and abs(a - b) < _ALIKE * max(a, b)
