"""Whether two model files are one robot: inertial parameters link by link, drives and limits joint by joint."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stadera.robot.model import JointDynamics, JointLimits, Robot

SAME = 1e-6
"""Relative difference below which two values are the same: a file's rounding."""


@dataclass(frozen=True)
class Difference:
    """One value in which two models differ; None where one has no such link or joint."""

    of: str  # the link or joint
    value: str  # its name, with its unit
    first: float | None
    second: float | None


def differences(first: Robot, second: Robot) -> Iterator[Difference]:
    """Where two models differ: what one lacks, then values, link by link and joint by joint."""
    links = dict.fromkeys((*first.tree.links, *second.tree.links))
    for link in links:
        one, other = first.inertias.get(link), second.inertias.get(link)
        if one is None or other is None:
            a, b = (None if body is None else body.mass for body in (one, other))
            yield Difference(link, "mass [kg]", a, b)
            continue
        size = max(one.mass, other.mass)
        yield from _apart(link, ("mass [kg]",), [one.mass], [other.mass], SAME * size)
        if size > 0.0:
            length = max(1e-3, float(np.linalg.norm(one.com)), float(np.linalg.norm(other.com)))
            yield from _apart(link, tuple(f"centre {axis} [m]" for axis in "xyz"), one.com, other.com, SAME * length)
            pairs = [(i, j) for i in range(3) for j in range(i, 3)]
            names = tuple(f"I{'xyz'[i]}{'xyz'[j]} about the centre [kg·m²]" for i, j in pairs)
            tensor, apart = ([body.inertia_com[pair] for pair in pairs] for body in (one, other))
            yield from _apart(link, names, tensor, apart, SAME * float(np.abs([tensor, apart]).max()))
    for joint in dict.fromkeys((*first.tree.joints, *second.tree.joints)):
        for kind, units in ((JointDynamics, _DYNAMICS), (JointLimits, _LIMITS)):
            tables = [robot.dynamics if kind is JointDynamics else robot.limits for robot in (first, second)]
            if any(joint not in table for table in tables):
                if kind is JointDynamics:
                    there = [float(joint in table) for table in tables]
                    yield Difference(joint, "in the tree [0 or 1]", there[0], there[1])
                continue
            values = np.array([[getattr(table[joint], name) for name in units] for table in tables], dtype=float)
            least = SAME * float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
            yield from _apart(joint, tuple(f"{n} [{u}]" for n, u in units.items()), values[0], values[1], least)


_DYNAMICS = {"armature": "kg·m²", "viscous": "N·m·s/rad", "coulomb": "N·m"}
_LIMITS = {"lower": "rad", "upper": "rad", "velocity": "rad/s", "effort": "N·m"}


def _apart(of: str, names: tuple[str, ...], first: object, second: object, least: float) -> Iterator[Difference]:
    for name, one, other in zip(names, np.asarray(first, float), np.asarray(second, float), strict=True):
        if one != other and not abs(one - other) <= least:
            yield Difference(of, name, float(one), float(other))
