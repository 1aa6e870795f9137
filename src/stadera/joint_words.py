"""Parses names of joints and links: which leg they belong to, and which of the leg's three joints they are."""

import re
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TypeVar

from stadera.errors import RecordingError

Value = TypeVar("Value")

_SIDES = {"L": ("l", "left"), "R": ("r", "right")}
_ENDS = {"F": ("f", "front"), "H": ("h", "r", "b", "hind", "rear", "back")}


def _joined(sides: Iterable[str], ends: Iterable[str]) -> frozenset[str]:
    """Words for a side and an end in either order, both by letters or both in full."""
    pairs = [(side, end) for side in sides for end in ends if (len(side) == 1) == (len(end) == 1)]
    return frozenset(word for side, end in pairs for word in (side + end, end + side))


LEG_WORDS = {side + end: _joined(words, ends) for end, ends in _ENDS.items() for side, words in _SIDES.items()}
"""Words that indicate each leg: lf, fl, frontleft, leftfront and so on."""
_PART_WORDS = (
    ("haa", "abad", "abduction", "adduction", "hx", "hipx", "hipaa", "coxa"),
    ("hfe", "thigh", "hy", "hipy", "hipfe", "femur", "upper", "upperleg"),
    ("kfe", "calf", "knee", "kn", "tibia", "shank", "lower", "lowerleg"),
)
LEG_NAMES = tuple(LEG_WORDS)
"""Names of a quadruped's legs: LF, RF, LH, RH."""
PARTS = tuple(words[0].upper() for words in _PART_WORDS)
"""Names of its joints' kinds, from the trunk outwards: HAA, HFE, KFE."""
_HIP = "hip"
"""The first joint for Unitree and Boston Dynamics; the second for MIT, whose first joint is `abad`."""

Place = tuple[str, int]
"""A leg and the index of one of its joints, from the trunk outwards: 0, 1, 2."""


def words(name: str) -> set[str]:
    """Lower-case words of a name, and each two neighbours joined: front_left_hip -> front, left, hip, frontleft..."""
    split = [word.lower() for word in re.split(r"[^A-Za-z]+", re.sub(r"([a-z])([A-Z])", r"\1_\2", name)) if word]
    return set(split) | {a + b for a, b in pairwise(split)}


def leg_of(names: Iterable[str]) -> str:
    """The leg that all these names indicate; empty if they indicate none or several."""
    found = {leg for name in names for leg, known in LEG_WORDS.items() if known & words(name)}
    return found.pop() if len(found) == 1 else ""


def places(names: Iterable[str]) -> dict[str, Place]:
    """Leg and joint of every name that indicates both, by a word (FL_thigh_joint, rh_KFE) or a number (FL_1)."""
    said = {name: (leg, words(name)) for name in names if (leg := leg_of([name]))}
    with_abad = {leg for leg, found in said.values() if not found.isdisjoint(_PART_WORDS[0])}
    placed = {name: (leg, _part(name, found, leg in with_abad)) for name, (leg, found) in said.items()}
    return {name: (leg, part) for name, (leg, part) in placed.items() if part is not None}


def _part(name: str, found: set[str], has_abad: bool) -> int | None:
    parts = [k for k in (1, 2, 0) if not found.isdisjoint(_PART_WORDS[k])]
    if parts:
        return parts[0]
    if _HIP in found:
        return 1 if has_abad else 0
    number = re.search(r"(?<!\d)([0-2])$", name)
    return int(number[1]) if number else None


def by_place(names: Iterable[str]) -> dict[Place, list[str]]:
    """By leg and joint, the names that indicate it."""
    found: dict[Place, list[str]] = {}
    for name, place in places(names).items():
        found.setdefault(place, []).append(name)
    return found


def by_part(values: Sequence[Value], joints: Sequence[str], what: str) -> list[Value]:
    """A value for each joint, of one for all (`what`, for messages) or of three for hip, thigh and calf. Raises
    RecordingError: three are given, and a joint's name does not say which it is.
    """
    if len(values) == 1:
        return [*values] * len(joints)
    known = places(joints)
    if unknown := next((joint for joint in joints if joint not in known), None):
        raise RecordingError(f"the name of joint {unknown!r} says neither hip, thigh nor calf: give {what}")
    return [values[known[joint][1]] for joint in joints]


def matched(wanted: Sequence[str], names: Iterable[str]) -> dict[str, str] | None:
    """Maps each joint of `wanted` to the one name for the same joint of the same leg; None unless every match is
    unique.
    """
    found, sought = by_place(names), places(wanted)
    answer = {joint: found.get(sought[joint], []) for joint in wanted if joint in sought}
    if len(answer) < len(wanted) or any(len(fitting) != 1 for fitting in answer.values()):
        return None
    return {joint: fitting[0] for joint, fitting in answer.items()}
