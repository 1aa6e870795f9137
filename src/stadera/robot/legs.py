"""Finds the legs of a Pinocchio model: four chains of three revolute joints on the trunk, identified by name or
position; else all chains that reach down from the trunk, of any number of revolute joints from three on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from stadera.errors import ModelError
from stadera.joint_words import leg_of, words
from stadera.robot.model import LEG_NAMES
from stadera.robot.modelfile import ModelFile, joint_axis
from stadera.types import Array

_TRUNK_JOINT = 1
_FEWEST = 2  # legs of a robot that stands
_REACH = 0.5  # depth of a leg's last joint below the trunk, in the model's zero pose, as a share of the deepest one's
_SHORTEST = 3  # joints of a leg: as many as a point contact has components


@dataclass(frozen=True)
class Chain:
    """Pinocchio's indices of the joints of one leg, from the trunk outwards."""

    name: str
    joints: tuple[int, ...]


def find_legs(file: ModelFile) -> tuple[tuple[Chain, ...], tuple[str, ...]]:
    """The legs and notes on assumptions made, of a quadruped in the order LF, RF, LH, RH; ModelError if there are none,
    or if a leg of a quadruped is not one.

    A quadruped's leg is a chain of exactly three revolute joints that starts at the trunk (branches, such as rotors,
    are ignored). Its name comes from its joints' names (lf_haa_joint, FL_hip, hr.hx); if these are unclear or clash,
    from the position of its hip (x forward, y left in the trunk frame). If names and positions disagree, the names are
    used, because a log's columns carry them, and a note says so.
    """
    chains = [_longest_chain(file.model, child) for child in file.model.children[_TRUNK_JOINT]]
    legs = {tuple(chain): _name_from_words(file, chain) for chain in chains if _is_leg(file.model, chain)}
    named = {chain: name for chain, name in legs.items() if name}
    if len(legs) > 4 and sorted(named.values()) == sorted(LEG_NAMES):
        legs = named
    if len(legs) != 4:
        broken = any(_name_from_words(file, chain) for chain in chains if tuple(chain) not in legs and len(chain) < 6)
        others = [] if broken else _reaching_down(file.model, chains)
        if len(others) < _FEWEST:
            raise ModelError(_not_four(file, chains, len(legs)))
        return tuple(map(Chain, _own_names(file, others), map(tuple, others))), ()
    names, notes = _choose_names(file, list(legs), list(legs.values()))
    found = [Chain(name, (a, b, c)) for name, (a, b, c) in zip(names, legs, strict=True)]
    return tuple(sorted(found, key=lambda chain: LEG_NAMES.index(chain.name))), notes


def _choose_names(
    file: ModelFile, legs: Sequence[Sequence[int]], by_name: list[str]
) -> tuple[list[str], tuple[str, ...]]:
    by_place = _names_from_places(np.array([_hip(file.model, chain) for chain in legs]))
    if sorted(by_name) == sorted(LEG_NAMES):
        if not by_place or by_place == by_name:
            return by_name, ()
        joints = ", ".join(file.model.names[chain[0]] for chain in legs)
        return by_name, (f"legs named by their joints ({joints}), though their places say {', '.join(by_place)}",)
    if not by_place:
        raise ModelError(f"{file.path}: neither the names nor the places of the hips distinguish the four legs")
    if any(by_name):
        return by_place, ("legs named by the places of their hips, for their joints' names clash",)
    return by_place, ()


def _longest_chain(model: Any, joint: int) -> list[int]:
    """The longest path outwards from a joint; of two equally long ones, that with the heavier end."""
    tails = [_longest_chain(model, child) for child in model.children[joint]]
    return [joint, *max(tails, key=lambda tail: (len(tail), model.inertias[tail[-1]].mass), default=[])]


def _is_leg(model: Any, chain: Sequence[int]) -> bool:
    return len(chain) == 3 and all(joint_axis(model.joints[joint]) is not None for joint in chain)


def _name_from_words(file: ModelFile, chain: Sequence[int]) -> str:
    """The leg that a chain's joint and link names indicate; empty if none or several."""
    names = [file.model.names[j] for j in chain]
    return leg_of([*names, *(file.links[name] for name in names)])


def _reaching_down(model: Any, chains: Sequence[Sequence[int]]) -> list[list[int]]:
    """The chains of revolute joints that end far below the trunk in the model's zero pose."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    turning = [
        list(c) for c in chains if len(c) >= _SHORTEST and all(joint_axis(model.joints[j]) is not None for j in c)
    ]
    depth = [float(data.oMi[_TRUNK_JOINT].translation[2] - data.oMi[chain[-1]].translation[2]) for chain in turning]
    deepest = max(depth, default=0.0)
    return [chain for chain, down in zip(turning, depth, strict=True) if down > _REACH * max(deepest, 1e-3)]


def _own_names(file: ModelFile, legs: Sequence[Sequence[int]]) -> list[str]:
    """Names of legs by the words of a quadruped, by left and right, or by what their joints' names begin with; by
    numbers if these are not unique.
    """
    first = [file.model.names[leg[0]] for leg in legs]
    sides = [next((word for word in ("left", "right") if word in words(name)), "") for name in first]
    prefixes = [name.split("_")[0] for name in first]
    for names in ([_name_from_words(file, leg) for leg in legs], sides, prefixes):
        if all(names) and len(set(names)) == len(legs):
            return names
    return [f"leg{k + 1}" for k in range(len(legs))]


def _hip(model: Any, chain: Sequence[int]) -> Array:
    """Mean of the first two joints' origins in the trunk frame at zero angles [m]."""
    first = model.jointPlacements[chain[0]]
    second = first * model.jointPlacements[chain[1]]
    hip: Array = 0.5 * (first.translation + second.translation)
    return hip


def _names_from_places(hips: Array) -> list[str]:
    """Leg names by position: two in front, two behind, and in each pair one left of the other; empty if this is
    unclear.
    """
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
    wrong = [
        f"leg {name} at joint {file.model.names[chain[0]]!r} has {len(chain)} joints, not three revolute ones; "
        for chain in chains
        if (name := _name_from_words(file, chain)) and not _is_leg(file.model, chain)
    ]
    listed = ", ".join(f"{file.model.names[chain[0]]} ({len(chain)})" for chain in chains) or "none"
    return (
        f"{file.path}: {''.join(wrong)}trunk {file.trunk!r} has {found} legs of three revolute joints, a quadruped "
        f"has 4; chains on it (joints): {listed}"
    )
