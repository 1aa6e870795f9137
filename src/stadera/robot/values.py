"""Values of a model: whether they are plausible, by wrong units and bodies without inertia, and whether those of two
model files are one robot's: inertial parameters link by link, places, drives and limits joint by joint, feet, IMU.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import isfinite

import numpy as np

from stadera.constants import SAME
from stadera.errors import ModelError
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


@dataclass(frozen=True)
class ModelLimits:
    """Limits beyond which a number is in another unit; the lightest and heaviest quadrupeds weigh 0.2 and 590 kg."""

    # lightest, heaviest: robot [kg]
    lightest: float = 0.1
    heaviest: float = 2000.0
    distance: float = 3.0  # between joints, and from a joint to a centre of mass [m]
    leg: tuple[float, float] = (0.02, 4.0)  # longest and shortest distance from hip to foot [m]
    gyration: float = 3.0  # largest radius of gyration of a link [m]
    angle: float = 12.0 * np.pi  # largest limit of a joint's position [rad]


def check_sense(robot: Robot, limits: ModelLimits | None = None) -> tuple[str, ...]:
    """Returns notes on unusual values. Raises ModelError: a number is impossible for a quadruped; names it and the unit
    it may be in.
    """
    limits = limits or ModelLimits()
    if wrong := next(_impossible(robot, limits), None):
        raise ModelError(f"{robot.source}: {wrong}" if robot.source else wrong)
    large = [
        joint
        for joint in robot.tree.joints
        if any(isfinite(x) and abs(x) > limits.angle for x in (robot.limits[joint].lower, robot.limits[joint].upper))
    ]
    if not large:
        return ()
    beyond = f"position limits beyond {limits.angle:.3g} rad; limits are in rad, not in degrees"
    return (f"joints {', '.join(large)}: {beyond}",)


def _impossible(robot: Robot, limits: ModelLimits) -> Iterator[str]:
    if not limits.lightest < robot.mass < limits.heaviest:
        unit = "grams" if robot.mass > limits.heaviest else "tonnes"
        heaviest = max(robot.tree.links, key=lambda link: robot.inertias[link].mass)
        yield (
            f"the robot weighs {robot.mass:.3g} kg, its heaviest link {heaviest!r} {robot.inertias[heaviest].mass:.3g} "
            f"kg: masses are in kg, not in {unit}"
        )
    millimetres = "distances are in m, not in mm"
    for joint, place in zip(robot.tree.joints, robot.tree.translations, strict=True):
        if (far := float(np.linalg.norm(place))) > limits.distance:
            yield f"joint {joint!r} is {far:.3g} m from the one before: {millimetres}"
    for link in robot.tree.links:
        if (far := float(np.linalg.norm(robot.inertias[link].com))) > limits.distance:
            yield f"the centre of mass of link {link!r} is {far:.3g} m from its joint: {millimetres}"
    for leg in robot.legs:
        steps = [robot.tree.translations[robot.tree.joints.index(joint)] for joint in leg.joints[1:]]
        length = float(sum(np.linalg.norm(step) for step in (*steps, np.asarray(leg.foot_position))))
        if not limits.leg[0] < length < limits.leg[1]:
            yield f"leg {leg.name} is {length:.3g} m long from hip to foot: distances are in m"
    for link in robot.tree.links:
        body = robot.inertias[link]
        size = np.sqrt(max(float(np.trace(body.inertia_com)), 0.0) / (2.0 * body.mass))
        if size > limits.gyration:
            yield (
                f"link {link!r} of {body.mass:.3g} kg has moments of inertia of {np.trace(body.inertia_com):.3g}, "
                f"as a body {2 * size:.3g} m wide: they are in kg·m², not in kg·mm² or g·mm²"
            )
