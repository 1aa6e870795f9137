"""Whether two model files are one robot: inertial parameters link by link, drives and limits joint by joint."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import isfinite

import numpy as np

from stadera.robot.model import Robot

SAME = 1e-6
"""Relative difference below which two values are the same: a file's rounding."""

_LEAST = 1e-3  # size that a smaller value's rounding is a share of, in the value's unit
_DYNAMICS = {"armature": "kg·m²", "viscous": "N·m·s/rad", "coulomb": "N·m"}
_LIMITS = {"lower": "rad", "upper": "rad", "velocity": "rad/s", "effort": "N·m"}


@dataclass(frozen=True)
class Difference:
    """One value in which two models differ; None where one has no such link or joint."""

    of: str  # the link or joint
    value: str  # its name, with its unit
    first: float | None
    second: float | None


def differences(first: Robot, second: Robot) -> Iterator[Difference]:
    """Where two models differ: what one lacks, then values, link by link and joint by joint."""
    one, other = _values(first), _values(second)
    for of in dict.fromkeys((*one, *other)):
        if of not in one or of not in other:
            name, (value, _) = next(iter((one.get(of) or other[of]).items()))
            yield Difference(of, name, *((value, None) if of in one else (None, value)))
            continue
        for name in (name for name in one[of] if name in other[of]):
            (a, size), (b, most) = one[of][name], other[of][name]
            if a != b and not abs(a - b) <= SAME * max(size, most):
                yield Difference(of, name, a, b)


def _values(robot: Robot) -> dict[str, dict[str, tuple[float, float]]]:
    """By link and joint, each value by its name with its unit, and the size that its rounding is a share of."""
    found: dict[str, dict[str, tuple[float, float]]] = {}
    for link in robot.tree.links:
        body, tensor = robot.inertias[link], robot.inertias[link].inertia_com
        length, largest = float(np.linalg.norm(body.com)), float(np.abs(tensor).max())
        found[link] = {"mass [kg]": (body.mass, body.mass)}
        found[link] |= {
            f"centre {a} [m]": (float(x), max(length, _LEAST)) for a, x in zip("xyz", body.com, strict=True)
        }
        for i, j in combinations_with_replacement(range(3), 2):
            found[link][f"I{'xyz'[i]}{'xyz'[j]} about the centre [kg·m²]"] = float(tensor[i, j]), largest
    for joint in robot.tree.joints:
        found[joint] = {"in the tree [0 or 1]": (1.0, 1.0)}
        for values, units in ((robot.dynamics[joint], _DYNAMICS), (robot.limits[joint], _LIMITS)):
            for name, unit in units.items():
                value = float(getattr(values, name))
                found[joint][f"{name} [{unit}]"] = value, max(abs(value), _LEAST) if isfinite(value) else 0.0
    return found
