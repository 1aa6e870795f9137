"""Whether two model files are one robot: inertial parameters link by link, places, drives and limits joint by joint,
feet, IMU.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import isfinite

import numpy as np

from stadera.constants import SAME
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.types import Array

_LEAST = 1e-3  # size that a smaller value's rounding is a share of, in the value's unit
_DYNAMICS = {"armature": "kg·m²", "viscous": "N·m·s/rad", "coulomb": "N·m"}
_LIMITS = {"lower": "rad", "upper": "rad", "velocity": "rad/s", "effort": "N·m"}


@dataclass(frozen=True)
class Difference:
    """One value in which two models differ; None where one has no such link, joint or foot."""

    of: str  # the link, joint, foot or IMU
    value: str  # its name, with its unit
    first: float | None
    second: float | None


def differences(first: Robot, second: Robot) -> Iterator[Difference]:
    """Where two models differ: what one lacks, then values, link by link and joint by joint."""
    one, other = _values(first), _values(second)
    for of in dict.fromkeys((*one, *other)):
        if of not in one or of not in other:
            name, (value, _) = next(iter((one.get(of) or other[of]).items()))
            yield Difference(of[1], name, *((value, None) if of in one else (None, value)))
            continue
        for name in (name for name in one[of] if name in other[of]):
            (a, size), (b, most) = one[of][name], other[of][name]
            if a != b and not abs(a - b) <= SAME * max(size, most):
                yield Difference(of[1], name, a, b)


def _values(robot: Robot) -> dict[tuple[str, str], dict[str, tuple[float, float]]]:
    """By kind and name of link, joint, foot and IMU, since a link and a joint may share a name: each value by its name
    and unit, and the size that its rounding is a share of.
    """
    found: dict[tuple[str, str], dict[str, tuple[float, float]]] = {}
    for link in robot.tree.links:
        body, tensor = robot.inertias[link], robot.inertias[link].inertia_com
        largest = float(np.abs(tensor).max())
        own = found["link", link] = {"mass [kg]": (body.mass, body.mass)}
        own |= _vector("centre", "m", body.com)
        for i, j in combinations_with_replacement(range(3), 2):
            own[f"I{'xyz'[i]}{'xyz'[j]} about the centre [kg·m²]"] = float(tensor[i, j]), largest
    tree = robot.tree
    for k, joint in enumerate(tree.joints):
        own = found["joint", joint] = {"in the tree [0 or 1]": (1.0, 1.0)}
        own |= _vector("origin", "m", tree.translations[k])
        own |= _vector("axis", "1", tree.rotations[k] @ tree.axes[k])
        for values, units in ((robot.dynamics[joint], _DYNAMICS), (robot.limits[joint], _LIMITS)):
            for name, unit in units.items():
                value = float(getattr(values, name))
                own[f"{name} [{unit}]"] = value, max(abs(value), _LEAST) if isfinite(value) else 0.0
    for leg in robot.legs:
        own = found["foot", f"foot {leg.name}"] = {"radius [m]": (leg.foot_radius, max(leg.foot_radius, _LEAST))}
        own |= _vector("centre", "m", np.array(leg.foot_position))
    mount = ImuMount.of(robot)
    own = found["IMU", "IMU"] = _vector("place", "m", mount.translation)
    for axis, direction in zip("xyz", mount.rotation.T, strict=True):
        own |= _vector(f"{axis} axis", "1", direction)
    return found


def _vector(name: str, unit: str, values: Array) -> dict[str, tuple[float, float]]:
    """Its components, whose rounding is a share of its length."""
    length = max(float(np.linalg.norm(values)), _LEAST)
    return {f"{name} {axis} [{unit}]": (float(x), length) for axis, x in zip("xyz", values, strict=True)}
