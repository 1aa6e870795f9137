"""Whether encoders, torques and IMU agree, on average over a log of a robot on its feet.

Three independent sources give the vertical in trunk axes: the accelerometer, along â; the contact forces from the joint
torques, Σ f = m a on average; and the plane through three feet or more from the encoders, up to the ground's slope. The
forces also give the weight, Σ f · â / |a|, the load of each leg, and by their moment the centre of mass. Without an
IMU two sources remain, and â is along the forces themselves. Of these figures `Consistency` has the impossible ones as
`faults`, and how unlikely they are together as `cost`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np

from stadera.checks.finding import Finding
from stadera.checks.limits import CheckLimits
from stadera.checks.residual import Footing, unit
from stadera.constants import GRAVITY
from stadera.robot.kinematics import foot_positions
from stadera.robot.model import Robot
from stadera.robot.stance import usual_configuration
from stadera.trunk.ground import ground_normal
from stadera.types import Array


@dataclass(frozen=True)
class Tilts:
    """Tilt of the trunk about its mean attitude, from the IMU and from the plane through the feet."""

    size: float = 0.0  # from the IMU [rad]
    similarity: float = 1.0  # of the two: 1 the same, 0 unrelated, -1 opposite
    turned: float = 1.0  # the largest similarity after rotating the plane by a multiple of 90° or mirroring it

    @classmethod
    def of(cls, footing: Footing) -> Tilts:
        """From the means of blocks with little acceleration, trunk's x-y; zero if there are too few, or two feet."""
        limits, force, contact = footing.limits, footing.specific_force, footing.contact
        time = footing.blocks.time
        starts = np.flatnonzero(np.diff(np.floor((time - time[0]) / limits.block), prepend=-1.0))
        quiet = np.maximum.reduceat(np.abs(np.linalg.norm(force, axis=1) - GRAVITY), starts) < limits.quiet
        if quiet.sum() < limits.fewest_blocks or contact.shape[1] < 3:
            return cls()
        counts = np.diff(starts, append=len(time))
        a, feet = ((np.add.reduceat(values, starts).T / counts).T[quiet] for values in (force, contact))
        a /= np.linalg.norm(a, axis=1, keepdims=True)
        plane = ground_normal(feet, np.ones(feet.shape[:2], dtype=bool), -unit(feet.mean(axis=1)))
        a, plane = (a - a.mean(axis=0))[:, :2], (plane - plane.mean(axis=0))[:, :2]
        both = a.T @ plane  # [i, j]: the IMU's tilt along i with the plane's along j
        scale = 0.5 * float((a**2).sum() + (plane**2).sum()) or 1.0
        signs = [(s, t) for s in (1, -1) for t in (1, -1)]
        turned = [s * both[0, 0] + t * both[1, 1] for s, t in signs[1:]]
        turned += [s * both[0, 1] + t * both[1, 0] for s, t in signs]
        size = float(np.sqrt((a**2).sum(axis=1).mean()))
        return cls(size, float(both[0, 0] + both[1, 1]) / scale, float(max(turned)) / scale)


@dataclass(frozen=True, eq=False)
class Consistency:
    """What all sensors together say of a robot."""

    weighs: float  # upward part of the total contact force [kg]
    loads: Array  # (L,) [N], of each foot along the accelerometer's vertical
    hangs: bool  # True if the feet carry almost nothing, in total and individually
    cost: float  # sum of squares of the figures, each in units of its usual size
    faults: tuple[str, ...]  # the impossible figures, one clause each
    outlier: str  # the one of three sources of the vertical that disagrees with the other two, as the end of a sentence

    @classmethod
    def of(cls, footing: Footing) -> Consistency:
        """Computes the figures for some instants of a log."""
        a, legs, contact = (x.mean(axis=0) for x in (footing.specific_force, footing.force, footing.contact))
        up, total = a / np.linalg.norm(a), legs.sum(axis=0)
        loads, force, plane, apart = legs @ up, _angle(total, up), 0.0, 0.0
        if len(legs) > 2:  # two feet have no plane
            normal = ground_normal(contact, np.ones(len(legs), dtype=bool), -contact.mean(axis=0))
            plane, apart = _angle(normal, up), _angle(normal, total)
        figures = [*_of_loads(footing, up, legs), *_of_directions(footing, force, plane), _of_centre(footing, a, total)]
        hangs = np.linalg.norm([total, *legs], axis=1) < footing.limits.hanging * footing.weight
        return cls(
            weighs=float(total @ up) / GRAVITY,
            loads=loads,
            hangs=bool(hangs.all()),
            cost=float(sum(np.square(sizes).sum() for sizes, _ in figures)),
            faults=tuple(chain.from_iterable(clauses for _, clauses in figures)),
            outlier=_outlier(footing, force, plane, apart, bool((loads > 0).all())),
        )


Figure = tuple[Array | float, list[str]]
"""A figure in units of its usual size, and clauses that say what of it is impossible."""


def _of_loads(footing: Footing, up: Array, legs: Array) -> Iterator[Figure]:
    """Joints within their limits, the weight, and the load of each foot by its force (L, 3) [N]."""
    robot, limits, weight = footing.robot, footing.limits, footing.weight
    lower, upper = robot.stops.T
    q = footing.blocks.position
    outside = np.maximum(np.maximum(q - upper, lower - q), 0.0).mean(axis=0)
    named = zip(robot.tree.joints, outside, strict=True)
    yield outside / 0.05, [f"joint {j!r} is {x:.2f} rad beyond its limits" for j, x in named if x > limits.outside]
    mass = float(legs.sum(axis=0) @ up) / GRAVITY
    clause = f"the robot would weigh {mass:.3g} kg, the model {robot.mass:.3g} kg"
    possible = limits.lightest < mass / robot.mass < limits.heaviest
    yield (mass / robot.mass - 1.0) / 0.2, [] if possible else [clause]
    loads = legs @ up
    sideways = np.linalg.norm(legs - loads[:, None] * up, axis=1)
    each = [*zip([leg.name for leg in robot.legs], loads, sideways, strict=True)]
    pulls = [(name, -load) for name, load, _ in each if load < -limits.pull * weight]
    yield (
        np.minimum(loads, 0.0) / (0.05 * weight),
        [f"leg {n} would pull at the ground with {f:.3g} N" for n, f in pulls],
    )
    slides = [one for one in each if one[1] >= 0 and one[2] > limits.sliding * one[1] + limits.sliding_floor * weight]
    clauses = [f"leg {name} would push sideways with {f:.3g} N under {load:.3g} N" for name, load, f in slides]
    yield sideways / (0.15 * weight), clauses


def _of_directions(footing: Footing, force: float, plane: float) -> Iterator[Figure]:
    """The forces' direction and the feet's plane, by their angles from the accelerometer's vertical [rad], and how the
    plane tilts.
    """
    limits, imu, tilts = footing.limits, footing.blocks.specific_force is not None, Tilts.of(footing)
    vertical = "the accelerometer's vertical"
    clause = f"the feet's forces are {np.degrees(force):.0f}° off {vertical if imu else 'their mean direction'}"
    yield force / np.radians(3.0), [clause] if force > limits.force_angle else []
    other = vertical if imu else "the direction of their forces"
    clause = f"the feet's plane is {np.degrees(plane):.0f}° off {other}"
    yield plane / np.radians(10.0), [clause] if plane > limits.plane_angle else []
    wrong = imu and tilts.size > limits.tilt and tilts.similarity < limits.unlike and tilts.turned > limits.like
    clause = f"the feet's plane does not tilt as the IMU does, which tilts by {np.degrees(tilts.size):.1f}°"
    yield tilts.size * (1.0 - tilts.similarity) / np.radians(1.5), [clause] if wrong else []


def _of_centre(footing: Footing, a: Array, total: Array) -> Figure:
    """Horizontal distance of the centre of mass from the model's: at rest Σ p x f = c x Σ f, less the same of the
    model, across the vertical.
    """
    robot, limits, up, size = footing.robot, footing.limits, a / np.linalg.norm(a), _size(footing.robot)
    inertial = footing.state.inertial.sum(axis=1).mean(axis=0)
    moment = footing.target.mean(axis=0)[3:] + inertial[3:]
    model = np.cross(robot.inertias[robot.trunk].first_moment, a) + inertial[3:]
    upward = float(total @ up)
    least = upward if abs(upward) > 1e-6 else 1e-6
    off = np.cross(up, moment) / least - np.cross(up, model) / (robot.mass * float(a @ up))
    far = float(np.linalg.norm(off))
    wrong = far > limits.off_centre * size and upward > limits.lightest * footing.weight
    return off / (0.15 * size), [f"the centre of mass would be {100 * far:.0f} cm off the model's"] if wrong else []


def _outlier(footing: Footing, force: float, plane: float, apart: float, loaded: bool) -> str:
    """By the angles of forces and plane from the accelerometer's vertical, and of both from each other [rad]."""
    close, far = footing.limits.close, footing.limits.far
    if footing.blocks.specific_force is None:
        return "; check the joints' names, and the torques' signs and units"
    if apart < close and plane > far:
        return "; the feet's plane and their forces agree, so that it is the IMU's frame that seems wrong"
    if plane < close and force > far:
        return "; IMU and the feet's plane agree, so that it is the torques that seem wrong"
    if max(apart, plane, force) < close and loaded:
        return "; all directions agree, so that it is a unit, the torques' scale, or the model, that seems wrong"
    return "; check the joints' names, the torques' signs and units, and the IMU's frame"


def limp(footing: Footing) -> str:
    """See `motors_off`."""
    joints = footing.body.in_legs
    return motors_off(footing.blocks.effort[:, joints], footing.state.torque[:, joints], footing.limits)


def motors_off(effort: Array, own: Array, limits: CheckLimits) -> str:
    """What to say of torques that do not even carry the legs, of a robot in any state; empty if they do. Both
    (instants, joints) [N·m], `own` those that carry them.
    """
    if (effort**2).sum() >= limits.limp**2 * (own**2).sum():
        return ""
    largest = f"up to {float(np.abs(effort.mean(axis=0)).max()):.2g} N·m in the mean"
    return f"the motors seem to be off: their torques, {largest}, do not even carry the legs"


def hanging(footing: Footing, now: Consistency) -> Finding:
    """Distinguishes a robot in the air from torques that are too small, or of motors that are off.

    In the air the torques only carry the legs; on the ground, in whatever unit, they follow those for an equal share of
    the robot's weight on each foot.
    """
    robot, body, effort = footing.robot, footing.body, footing.blocks.effort[:, footing.body.in_legs]
    share = robot.mass * footing.specific_force / len(robot.legs)
    arm = footing.contact[:, body.leg_of[body.in_legs]] - footing.state.origin[:, body.in_legs]
    pushed = (np.cross(footing.state.axis[:, body.in_legs], arm) * share[:, None]).sum(axis=2)
    taken = footing.state.torque[:, body.in_legs] - pushed
    size = float(np.sqrt((effort**2).sum() * (taken**2).sum())) or 1.0
    factor = float((taken**2).sum() / ((effort * taken).sum() or 1.0))
    if (effort * taken).sum() / size > footing.limits.standing_torques:
        text = (
            f"the torques are those of a robot on its feet, but about {factor:.2g} times too small: of motors before "
            "the gear, or in another unit"
        )
        return Finding("torque_unit", text, "--gear RATIO")
    text = (
        f"the feet carry {now.weighs:.2g} kg of {robot.mass:.3g} kg: the robot is not on its feet but in the "
        "air, which is a log for `stadera identify`"
    )
    return Finding("not_on_feet", limp(footing) or text)


def _size(robot: Robot) -> float:
    """Half the diagonal between the feet in the usual stance [m], at least a quarter of a leg."""
    feet = foot_positions(robot, usual_configuration(robot)[None])[0]
    return max(0.5 * float(np.linalg.norm(np.ptp(feet[:, :2], axis=0))), 0.25 * robot.leg_length)


def _angle(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
