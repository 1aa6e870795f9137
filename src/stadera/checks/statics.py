"""Whether encoders, torques and IMU agree, on average over a log of a robot on its feet.

Three independent sources give the vertical in trunk axes: the accelerometer, along â; the contact forces from the joint
torques, Σ f = m a on average; and the plane through three feet or more from the encoders, up to the ground's slope. The
forces also give the weight, Σ f · â / |a|, the load of each leg, and by their moment the centre of mass. Without an
IMU two sources remain, and â is along the forces themselves. `Consistency` holds these figures, its `faults` are the
impossible ones, and its `cost` measures how unlikely they are together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.body import Motion
from stadera.checks.finding import Finding
from stadera.checks.limits import CheckLimits
from stadera.checks.residual import Footing, body_of, unit
from stadera.constants import GRAVITY
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

    def contradict(self, limits: CheckLimits) -> bool:
        """True if the plane tilts like the IMU only after rotating or mirroring it."""
        return self.size > limits.tilt and self.similarity < limits.unlike and self.turned > limits.like

    @classmethod
    def of(cls, footing: Footing) -> Tilts:
        """From the means of blocks with little acceleration, trunk's x-y; zero if there are too few, or two feet."""
        limits, force, contact = footing.limits, footing.specific_force, footing.contact
        block = blocks_of(footing.blocks.time, limits.block)
        deviation = np.zeros(block[-1] + 1)
        np.maximum.at(deviation, block, np.abs(np.linalg.norm(force, axis=1) - GRAVITY))
        quiet = deviation < limits.quiet
        if quiet.sum() < limits.fewest_blocks or contact.shape[1] < 3:
            return cls()
        a = block_means(force, block)[quiet]
        a /= np.linalg.norm(a, axis=1, keepdims=True)
        feet = block_means(contact.reshape(len(contact), -1), block)[quiet].reshape(-1, *contact.shape[1:])
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
    """Figures computed from all sensors together, trunk axes."""

    robot: Robot  # the model
    limits: CheckLimits  # beyond which a figure is impossible
    carried: float  # magnitude of the total contact force [N], in any direction
    weighs: float  # upward part of it [kg]
    loads: Array  # (L,) [N], of each foot along the accelerometer's vertical
    sideways: Array  # (L,) [N], across it
    force_angle: float  # between forces and accelerometer [rad]
    # plane_angle, plane_force_angle: between the feet's plane and accelerometer or forces [rad]; 0 of two feet
    plane_angle: float
    plane_force_angle: float
    off_centre: Array  # (3,) [m], horizontal distance of the centre of mass from the model's
    outside: Array  # (n,) [rad], mean angle beyond the joints' limits
    tilts: Tilts  # of IMU and feet's plane
    size: float  # half the diagonal between the feet in the nominal stance, at least a quarter of a leg [m]
    imu: bool = True  # False if there is none, and the forces' direction replaces the accelerometer's

    @classmethod
    def of(cls, footing: Footing) -> Consistency:
        """Computes the figures for some instants of a log."""
        robot, blocks, a = footing.robot, footing.blocks, footing.specific_force.mean(axis=0)
        up = a / np.linalg.norm(a)
        legs = footing.force.mean(axis=0)
        total, loads = legs.sum(axis=0), legs @ up
        weight = float(total @ up)
        # at rest Σ p x f = c x Σ f; across the vertical, less the same of the model
        inertial = footing.state.inertial.sum(axis=1).mean(axis=0)
        moment = footing.target.mean(axis=0)[3:] + inertial[3:]
        model = np.cross(robot.inertias[robot.trunk].first_moment, a) + inertial[3:]
        least = 1e-6 if abs(weight) <= 1e-6 else weight
        off = np.cross(up, moment) / least - np.cross(up, model) / (robot.mass * float(a @ up))
        contact = footing.contact.mean(axis=0)
        normal = ground_normal(contact, np.ones(len(legs), dtype=bool), -contact.mean(axis=0))
        limits = [robot.limits[joint] for joint in robot.tree.joints]
        lower, upper = np.array([(x.lower, x.upper) for x in limits]).T
        beyond = np.maximum(np.maximum(blocks.position - upper, lower - blocks.position), 0.0)
        return cls(
            robot=robot,
            limits=footing.limits,
            carried=float(np.linalg.norm(total)),
            weighs=weight / GRAVITY,
            loads=loads,
            sideways=np.linalg.norm(legs - loads[:, None] * up, axis=1),
            force_angle=_angle(total, up),
            plane_angle=_angle(normal, up) if len(legs) > 2 else 0.0,
            plane_force_angle=_angle(normal, total) if len(legs) > 2 else 0.0,
            off_centre=off,
            outside=beyond.mean(axis=0),
            tilts=Tilts.of(footing),
            size=_size(robot),
            imu=blocks.specific_force is not None,
        )

    @property
    def weight(self) -> float:
        """Weight of the model [N]."""
        return self.robot.mass * GRAVITY

    @property
    def hangs(self) -> bool:
        """True if the feet carry almost nothing, in total and individually."""
        least = self.limits.hanging * self.weight
        return self.carried < least and bool((np.hypot(self.loads, self.sideways) < least).all())

    @property
    def cost(self) -> float:
        """Sum of squares of the figures, each in units of its usual size."""
        mass = (self.weighs / self.robot.mass - 1.0) / 0.2
        tilt = self.tilts.size * (1.0 - self.tilts.similarity) / np.radians(1.5)
        terms = [
            np.array([mass, tilt, self.force_angle / np.radians(3.0), self.plane_angle / np.radians(10.0)]),
            self.off_centre / (0.15 * self.size),
            np.minimum(self.loads, 0.0) / (0.05 * self.weight),
            self.sideways / (0.15 * self.weight),
            self.outside / 0.05,
        ]
        return float(sum(term @ term for term in terms))

    def faults(self) -> Iterator[str]:
        """Yields the impossible figures, one clause each."""
        robot, limits = self.robot, self.limits
        for joint, beyond in zip(robot.tree.joints, self.outside, strict=True):
            if beyond > limits.outside:
                yield f"joint {joint!r} is {beyond:.2f} rad beyond its limits"
        if not limits.lightest < self.weighs / robot.mass < limits.heaviest:
            yield f"the robot would weigh {self.weighs:.3g} kg, the model {robot.mass:.3g} kg"
        for leg, load in zip(robot.legs, self.loads, strict=True):
            if load < -limits.pull * self.weight:
                yield f"leg {leg.name} would pull at the ground with {-load:.3g} N"
        for leg, load, across in zip(robot.legs, self.loads, self.sideways, strict=True):
            if load >= 0 and across > limits.sliding * load + limits.sliding_floor * self.weight:
                yield f"leg {leg.name} would push sideways with {across:.3g} N under {load:.3g} N"
        if self.force_angle > limits.force_angle:
            yield f"the feet's forces are {np.degrees(self.force_angle):.0f}° off the accelerometer's vertical"
        if self.plane_angle > limits.plane_angle:
            other = "the accelerometer's vertical" if self.imu else "the direction of their forces"
            yield f"the feet's plane is {np.degrees(self.plane_angle):.0f}° off {other}"
        if self.imu and self.tilts.contradict(limits):
            yield f"the feet's plane does not tilt as the IMU does, which tilts by {np.degrees(self.tilts.size):.1f}°"
        off = float(np.linalg.norm(self.off_centre))
        if off > limits.off_centre * self.size and self.weighs > limits.lightest * robot.mass:
            yield f"the centre of mass would be {100 * off:.0f} cm off the model's"

    @property
    def outlier(self) -> str:
        """Names the one of three sources of the vertical that disagrees with the other two."""
        close, far = self.limits.close, self.limits.far
        if not self.imu:
            return "; check the joints' names, and the torques' signs and units"
        if self.plane_force_angle < close and self.plane_angle > far:
            return "; the feet's plane and their forces agree, so that it is the IMU's frame that seems wrong"
        if self.plane_angle < close and self.force_angle > far:
            return "; IMU and the feet's plane agree, so that it is the torques that seem wrong"
        if max(self.plane_force_angle, self.plane_angle, self.force_angle) < close and (self.loads > 0).all():
            return "; all directions agree, so that it is the torques' unit or scale, or the model, that seems wrong"
        return "; check the joints' names, the torques' signs and units, and the IMU's frame"


def hanging(footing: Footing, now: Consistency) -> Finding:
    """Distinguishes a robot in the air from torques that are too small.

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
    return Finding(
        "not_on_feet",
        f"the feet carry {now.weighs:.2g} kg of {robot.mass:.3g} kg: the robot is not on its feet but in the "
        "air, which is a log for `stadera identify`",
    )


def _size(robot: Robot) -> float:
    body, still, none = body_of(robot), np.zeros((1, len(robot.tree.joints))), np.zeros((1, 3))
    q = usual_configuration(robot)[None]
    feet = body.at(Motion(q, still, still, none, none, none, np.array([0.0, 0.0, 1.0]))).feet[0]
    return max(0.5 * float(np.linalg.norm(np.ptp(feet[:, :2], axis=0))), 0.25 * robot.leg_length)


def _angle(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def blocks_of(time: Array, length: float) -> NDArray[np.int64]:
    """Index, from 0, of the block of this length [s] that contains each sample, (samples,)."""
    return np.unique(np.floor((time - time[0]) / length).astype(np.int64), return_inverse=True)[1].astype(np.int64)


def block_means(values: Array, block: NDArray[np.int64]) -> Array:
    """Means over blocks of values (samples, k), (blocks, k)."""
    sums = np.column_stack([np.bincount(block, column) for column in values.T])
    return np.asarray(sums / np.bincount(block)[:, None])
