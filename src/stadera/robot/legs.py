"""Finds the legs of a model file: four chains of three revolute joints on the trunk, identified by name or
position; else all chains that reach down from the trunk, of any number of revolute joints from three on, or of two if
there are no others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError, require_known
from stadera.joint_words import leg_of, words
from stadera.robot.model import LEG_NAMES
from stadera.robot.modelfile import ModelFile
from stadera.robot.shapes import FLAT
from stadera.types import Array

_FEWEST = 2  # legs of a robot that stands
_REACH = 0.5  # depth of a leg's last joint below the trunk, in the model's zero pose, as a share of the deepest one's
_SHORTEST = 2  # joints of a leg: one less than a point contact has components


@dataclass(frozen=True)
class Chain:
    """Places of the links of one leg in the model file, from the trunk outwards."""

    name: str
    links: tuple[int, ...]
    foot: str | None = None  # the link or frame that its owner names


def find_legs(file: ModelFile, feet: Sequence[str], notes: list[str]) -> tuple[Chain, ...]:
    """The legs, of a quadruped in the order LF, RF, LH, RH; ModelError if there are none, or if a leg of a quadruped is
    not one. Notes on assumptions made are added to `notes`.

    A quadruped's leg is a chain of exactly three revolute joints, or of two on all, that starts at the trunk (branches,
    such as rotors, are ignored). Its name comes from its joints' names (lf_haa_joint, FL_hip, hr.hx); if these are
    unclear or clash, from the position of its hip (x forward, y left in the trunk frame). If names and positions
    disagree, the names are used, because a log's columns carry them, and a note says so. With `feet`, links or frames,
    legs are the chains of revolute joints from the trunk to these; UnknownNameError if there is no such link.
    """
    if feet:
        return _named(file, _to_feet(file, feet), feet, notes)
    poses = file.carried(())
    masses = {k: body.mass for k, body in file.lumped(file.carried(file.joints)).items()}
    chains = [_longest_chain(file, masses, k) for k in file.joints if file.above(k) == 0]
    legs = {tuple(chain): _name_from_words(file, chain) for chain in chains if _is_leg(file, chain)}
    named = {chain: name for chain, name in legs.items() if name}
    if len(legs) > 4 and sorted(named.values()) == sorted(LEG_NAMES):
        legs = named
    found = [list(chain) for chain in legs]
    if len(legs) != 4:
        named_ones = (chain for chain in chains if _name_from_words(file, chain) and len(chain) < FLAT)
        kinds = {(len(chain), _turns(file, chain)) for chain in named_ones}
        found = [] if len(kinds) > 1 else _reaching_down(file, poses, chains)
        if len(found) < _FEWEST:
            raise ModelError(_not_four(file, chains, len(legs)))
    return _named(file, found, [None] * len(found), notes)


def below_a_waist(file: ModelFile) -> str | None:
    """The link from which both legs of a humanoid hang whose file begins with its torso: the only one below the root
    in height too, with two chains of five revolute joints or more that reach down from it. None if there is none.
    """
    poses, masses = file.carried(()), {k: body.mass for k, body in file.lumped(file.carried(file.joints)).items()}
    found = []
    for link in (link for link in file.joints if poses[link][2][2] < 0.0):
        chains = [_longest_chain(file, masses, k) for k in file.joints if file.above(k) == link]
        legs = [chain for chain in chains if len(chain) >= FLAT - 1 and _turns(file, chain)]
        if len(legs) == 2 and all(poses[leg[-1]][2][2] < poses[link][2][2] for leg in legs):
            found.append(file.links[link].name)
    return found[0] if len(found) == 1 else None


def _to_feet(file: ModelFile, feet: Sequence[str]) -> list[list[int]]:
    places = {link.name: k for k, link in enumerate(file.links)} | {name: site[0] for name, site in file.sites.items()}
    require_known("foot", feet, places, file.name)
    moved, found, used = file.carried(file.joints), list[list[int]](), dict[int, str]()
    if len(feet) < _FEWEST:
        raise ModelError(f"{file.path}: a robot has two feet or more, got {', '.join(feet)}")
    for foot in feet:
        chain = [moved[places[foot]][0]]
        while chain[0] > 0:
            chain.insert(0, file.above(chain[0]))
        chain = chain[1:]
        if len(chain) < _SHORTEST or not _turns(file, chain):
            joints = ", ".join(file.joint(k).name for k in chain) or "none"
            raise ModelError(
                f"{file.path}: foot {foot!r}: a leg has two or more revolute joints between trunk {file.trunk!r} and "
                f"foot, these are {joints}"
            )
        if shared := [k for k in chain if k in used]:
            both, joint = f"{used[shared[0]]!r} and {foot!r}", file.joint(shared[0]).name
            raise ModelError(f"{file.path}: feet {both} hang from the same joint {joint!r}")
        used |= dict.fromkeys(chain, foot)
        found.append(chain)
    return found


def _named(
    file: ModelFile, found: Sequence[Sequence[int]], feet: Sequence[str | None], notes: list[str]
) -> tuple[Chain, ...]:
    """The chains with their names; in the order LF, RF, LH, RH if they have such names."""
    few = len(found) == 4 and all(len(chain) <= 3 for chain in found)
    names = _choose_names(file, found, notes) if few else _own_names(file, found)
    legs = [Chain(name, tuple(chain), foot) for name, chain, foot in zip(names, found, feet, strict=True)]
    if sorted(names) == sorted(LEG_NAMES):
        legs.sort(key=lambda leg: LEG_NAMES.index(leg.name))
    return tuple(legs)


def _choose_names(file: ModelFile, legs: Sequence[Sequence[int]], notes: list[str]) -> list[str]:
    by_name = [_name_from_words(file, chain) for chain in legs]
    # the mean of the first two joints' origins in the trunk frame at zero angles [m]
    poses = file.carried(())
    by_place = _names_from_places(np.array([0.5 * (poses[chain[0]][2] + poses[chain[1]][2]) for chain in legs]))
    if sorted(by_name) == sorted(LEG_NAMES):
        if by_place and by_place != by_name:
            joints = ", ".join(file.joint(chain[0]).name for chain in legs)
            notes.append(f"legs named by their joints ({joints}), though their places say {', '.join(by_place)}")
        return by_name
    if not by_place:
        raise ModelError(f"{file.path}: neither the names nor the places of the hips distinguish the four legs")
    if any(by_name):
        notes.append("legs named by the places of their hips, for their joints' names clash")
    return by_place


def _longest_chain(file: ModelFile, masses: Mapping[int, float], k: int) -> list[int]:
    """The longest path outwards from a joint; of two equally long ones, that with the heavier end."""
    tails = [_longest_chain(file, masses, child) for child in file.joints if file.above(child) == k]
    return [k, *max(tails, key=lambda tail: (len(tail), masses[tail[-1]]), default=[])]


def _is_leg(file: ModelFile, chain: Sequence[int]) -> bool:
    return len(chain) == 3 and _turns(file, chain)


def _turns(file: ModelFile, chain: Sequence[int]) -> bool:
    return all(file.joint(k).kind == "turns" for k in chain)


def _name_from_words(file: ModelFile, chain: Sequence[int]) -> str:
    """The leg that a chain's joint and link names indicate; empty if none or several."""
    return leg_of([*(file.joint(k).name for k in chain), *(file.links[k].name for k in chain)])


def _reaching_down(file: ModelFile, poses: list[tuple[int, Array, Array]], chains: list[list[int]]) -> list[list[int]]:
    """The chains of revolute joints that end far below the trunk in the model's zero pose; without those of two joints
    if there are longer ones.
    """
    turning = [chain for chain in chains if len(chain) >= _SHORTEST and _turns(file, chain)]
    depth = [-float(poses[chain[-1]][2][2]) for chain in turning]
    deepest = max(depth, default=0.0)
    down = [chain for chain, own in zip(turning, depth, strict=True) if own > _REACH * max(deepest, 1e-3)]
    return [chain for chain in down if len(chain) > _SHORTEST] or down


def _own_names(file: ModelFile, legs: Sequence[Sequence[int]]) -> list[str]:
    """Names of legs by the words of a quadruped, by left and right, or by what their joints' names begin with; by
    numbers if these are not unique.
    """
    first = [file.joint(leg[0]).name for leg in legs]
    sides = [next((word for word in ("left", "right") if word in words(name)), "") for name in first]
    prefixes = [name.split("_")[0] for name in first]
    for names in ([_name_from_words(file, leg) for leg in legs], sides, prefixes):
        if all(names) and len(set(names)) == len(legs):
            return names
    return [f"leg{k + 1}" for k in range(len(legs))]


def _names_from_places(hips: Array) -> list[str]:
    """Leg names by position: two in front, two behind, and in each pair one left of the other; empty if this is
    unclear.
    """
    by_x = np.argsort(-hips[:, 0])
    pairs = [pair[np.argsort(-hips[pair, 1])] for pair in (by_x[:2], by_x[2:])]  # the left one first
    apart = [hips[by_x[1], 0] - hips[by_x[2], 0], *(hips[left, 1] - hips[right, 1] for left, right in pairs)]
    place = np.concatenate(pairs).tolist()
    return [LEG_NAMES[place.index(k)] for k in range(4)] if min(apart) >= 1e-3 else []


def _not_four(file: ModelFile, chains: list[list[int]], found: int) -> str:
    wrong = [
        f"leg {name} at joint {file.joint(chain[0]).name!r} has {len(chain)} joints, not three revolute ones; "
        for chain in chains
        if (name := _name_from_words(file, chain)) and not _is_leg(file, chain)
    ]
    listed = ", ".join(f"{file.joint(chain[0]).name} ({len(chain)})" for chain in chains) or "none"
    low = "" if wrong else ", and fewer than two other chains reach down along its -z axis"
    return (
        f"{file.path}: {''.join(wrong)}trunk {file.trunk!r} has {found} leg{'s' * (found != 1)} of three revolute "
        f"joints, a quadruped has 4{low}; chains on it (joints): {listed}; --feet and --trunk name them where they are "
        "not found"
    )
