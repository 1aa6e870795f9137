"""Plausibility checks on a model's numbers: wrong units, joint limits without range, bodies without inertia."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError
from stadera.robot.model import JointLimits, Robot


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
    where = f"{robot.source}: " if robot.source else ""
    for wrong in (*_masses(robot, limits), *_distances(robot, limits), *_inertias(robot, limits)):
        raise ModelError(f"{where}{wrong}")
    return tuple(_angles(robot, limits))


def _masses(robot: Robot, limits: ModelLimits) -> Iterator[str]:
    if not limits.lightest < robot.mass < limits.heaviest:
        unit = "grams" if robot.mass > limits.heaviest else "tonnes"
        heaviest = max(robot.tree.links, key=lambda link: robot.inertias[link].mass)
        yield (
            f"the robot weighs {robot.mass:.3g} kg, its heaviest link {heaviest!r} {robot.inertias[heaviest].mass:.3g} "
            f"kg: masses are in kg, not in {unit}"
        )


def _distances(robot: Robot, limits: ModelLimits) -> Iterator[str]:
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


def _inertias(robot: Robot, limits: ModelLimits) -> Iterator[str]:
    for link in robot.tree.links:
        body = robot.inertias[link]
        size = np.sqrt(max(float(np.trace(body.inertia_com)), 0.0) / (2.0 * body.mass))
        if size > limits.gyration:
            yield (
                f"link {link!r} of {body.mass:.3g} kg has moments of inertia of {np.trace(body.inertia_com):.3g}, "
                f"as a body {2 * size:.3g} m wide: they are in kg·m², not in kg·mm² or g·mm²"
            )


def _angles(robot: Robot, limits: ModelLimits) -> Iterator[str]:
    def stated(found: JointLimits) -> float:
        return max((abs(x) for x in (found.lower, found.upper) if np.isfinite(x)), default=0.0)

    large = [joint for joint in robot.tree.joints if limits.angle < stated(robot.limits[joint])]
    if large:
        names = ", ".join(large)
        yield f"joints {names}: position limits beyond {limits.angle:.3g} rad; limits are in rad, not in degrees"
