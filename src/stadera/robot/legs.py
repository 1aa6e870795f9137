"""Finds the four legs of a Pinocchio model: chains of three revolute joints on the trunk, named by names or places."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from stadera.errors import ModelError
from stadera.robot.model import LEG_NAMES
from stadera.robot.modelfile import Array, ModelFile, joint_axis

_TRUNK_JOINT = 1
_PREFIXES = {
    "LF": {"lf", "fl", "frontleft", "leftfront"},
    "RF": {"rf", "fr", "frontright", "rightfront"},
    "LH": {"lh", "hl", "rl", "lr", "bl", "lb", "hindleft", "lefthind", "rearleft", "leftrear", "backleft", "leftback"},
    "RH": {"rh", "hr", "rr", "br", "rb", "hindright", "righthind", "rearright", "rightrear", "backright", "rightback"},
}


@dataclass(frozen=True)
class Chain:
    """Pinocchio's indices of the joints of one leg, from the trunk outwards."""

    name: str
    joints: tuple[int, int, int]


def find_legs(file: ModelFile) -> tuple[tuple[Chain, ...], tuple[str, ...]]:
    """The four legs in the order LF, RF, LH, RH, and notes on what had to be assumed.

    A leg is a chain of exactly three revolute joints that starts on the trunk (branches off it, such as rotors, are
    not followed). It is named by its joints' names where they tell (lf_haa_joint, FL_hip, hr.hx); else, or where
    names clash, by where its hip is (x forward, y left in the trunk frame). Where both tell and disagree, the names
    win, for a log's columns carry them, and a note says so.

    Raises:
        ModelError: not four such chains.
    """
    chains = [_longest_chain(file.model, child) for child in file.model.children[_TRUNK_JOINT]]
    legs = [chain for chain in chains if len(chain) == 3 and all(_is_revolute(file.model, j) for j in chain)]
    by_name = [_name_from_words(file, chain) for chain in legs]
    if len(legs) > 4 and sorted(filter(None, by_name)) == sorted(LEG_NAMES):
        legs = [chain for chain, name in zip(legs, by_name, strict=True) if name]
        by_name = [name for name in by_name if name]
    if len(legs) != 4:
        raise ModelError(_not_four(file, chains, len(legs)))
    names, notes = _choose_names(file, legs, by_name)
    order = sorted(range(4), key=lambda k: LEG_NAMES.index(names[k]))
    found = tuple(Chain(names[k], (legs[k][0], legs[k][1], legs[k][2])) for k in order)
    return found, notes


def _choose_names(file: ModelFile, legs: list[list[int]], by_name: list[str]) -> tuple[list[str], tuple[str, ...]]:
    by_place = _names_from_places(np.array([_hip(file.model, chain) for chain in legs]))
    if sorted(by_name) == sorted(LEG_NAMES):
        if not by_place or by_place == by_name:
            return by_name, ()
        told = ", ".join(file.model.names[chain[0]] for chain in legs)
        return by_name, (f"legs named by their joints ({told}), though their places say {', '.join(by_place)}",)
    if not by_place:
        raise ModelError(f"{file.path}: neither the names nor the places of the hips tell the four legs apart")
    if any(by_name):
        return by_place, ("legs named by the places of their hips, for their joints' names clash",)
    return by_place, ()


def _longest_chain(model: Any, joint: int) -> list[int]:
    """The longest path outwards from a joint; of two as long, the one with the heavier end."""
    tails = [_longest_chain(model, child) for child in model.children[joint]]
    return [joint, *max(tails, key=lambda tail: (len(tail), model.inertias[tail[-1]].mass), default=[])]


def _is_revolute(model: Any, joint: int) -> bool:
    return joint_axis(model.joints[joint]) is not None


def _name_from_words(file: ModelFile, chain: list[int]) -> str:
    """The leg that a chain's joint and link names agree on; empty where they tell none, or several."""
    names = [file.model.names[j] for j in chain]
    words = [_words(name) for name in (*names, *(file.links[name] for name in names))]
    found = {leg for said in words for leg, prefixes in _PREFIXES.items() if prefixes & said}
    return found.pop() if len(found) == 1 else ""


def _words(name: str) -> set[str]:
    """Lower-case words of a name, and each two neighbours joined: front_left_hip -> front, left, hip, frontleft..."""
    split = [word.lower() for word in re.split(r"[^A-Za-z]+", re.sub(r"([a-z])([A-Z])", r"\1_\2", name)) if word]
    return set(split) | {a + b for a, b in pairwise(split)}


def _hip(model: Any, chain: list[int]) -> Array:
    """Mean of the first two joints' origins in the trunk frame at zero angles [m]."""
    first = model.jointPlacements[chain[0]]
    second = first * model.jointPlacements[chain[1]]
    hip: Array = 0.5 * (first.translation + second.translation)
    return hip


def _names_from_places(hips: Array) -> list[str]:
    """Leg names by place: two in front, two behind, of each pair one left of the other; empty where this is unclear."""
    by_x = np.argsort(-hips[:, 0])
    if hips[by_x[1], 0] - hips[by_x[2], 0] < 1e-3:
        return []
    names = [""] * 4
    for pair, (left, right) in ((by_x[:2], ("LF", "RF")), (by_x[2:], ("LH", "RH"))):
        a, b = sorted(pair, key=lambda k: -hips[k, 1])
        if hips[a, 1] - hips[b, 1] < 1e-3:
            return []
        names[a], names[b] = left, right
    return names


def _not_four(file: ModelFile, chains: list[list[int]], found: int) -> str:
    told = [f"{file.model.names[chain[0]]} ({len(chain)})" for chain in chains]
    wrong = [
        f"leg {name} at joint {file.model.names[chain[0]]!r} has {len(chain)} joints, not three revolute ones; "
        for chain in chains
        if (name := _name_from_words(file, chain)) and (len(chain) != 3 or not _all_revolute(file.model, chain))
    ]
    listed = ", ".join(told) if told else "none"
    return (
        f"{file.path}: {''.join(wrong)}trunk {file.trunk!r} has {found} legs of three revolute joints, a quadruped "
        f"has 4; chains on it (joints): {listed}"
    )


def _all_revolute(model: Any, chain: list[int]) -> bool:
    return all(_is_revolute(model, joint) for joint in chain)
