"""Checks whether encoders, torques and IMU agree, on average over a log of a robot on its feet.

Three independent sources give the vertical in trunk axes: the accelerometer, along â; the contact forces from the joint
torques, Σ f = m a on average; and the plane through the feet from the encoders, up to the ground's slope. The forces
also give the robot's weight, Σ f · â / |a|, the load of each leg, and by their moment the centre of mass. Without an
IMU two sources remain, and â is along the forces themselves. `Consistency` holds these figures, its `faults` are the
impossible ones, and its `cost` measures how unlikely they are together.

The legs' accelerations are neglected: their effect cancels over steps, and is zero at rest.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from stadera.body.statics import nominal_feet
from stadera.checks.footing import Footing
from stadera.checks.limits import CheckLimits
from stadera.constants import GRAVITY
from stadera.robot.model import Robot
from stadera.trunk.standing.contact import ground_normal
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
    def of(cls, time: Array, specific_force: Array, contact: Array, limits: CheckLimits) -> Self:
        """Computed from the means of blocks with little acceleration, trunk's x-y; zero if there are too few."""
        block = blocks_of(time, limits.block)
        deviation = np.zeros(block[-1] + 1)
        np.maximum.at(deviation, block, np.abs(np.linalg.norm(specific_force, axis=1) - GRAVITY))
        quiet = deviation < limits.quiet
        if quiet.sum() < limits.fewest_blocks:
            return cls()
        a = block_means(specific_force, block)[quiet]
        a /= np.linalg.norm(a, axis=1, keepdims=True)
        feet = block_means(contact.reshape(len(contact), 12), block)[quiet].reshape(-1, 4, 3)
        plane = ground_normal(feet, np.ones((len(feet), 4), dtype=bool), -feet.mean(axis=1))
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
    loads: Array  # (4,) [N], of each foot along the accelerometer's vertical
    sideways: Array  # (4,) [N], across it
    force_angle: float  # between forces and accelerometer [rad]
    plane_angle: float  # between the feet's plane and the accelerometer [rad]
    plane_force_angle: float  # between the feet's plane and the forces [rad]
    off_centre: Array  # (3,) [m], horizontal distance of the centre of mass from the model's
    outside: Array  # (n,) [rad], mean angle beyond the joints' limits
    tilts: Tilts  # of IMU and feet's plane
    size: float  # half the diagonal between the feet in the nominal stance [m]
    imu: bool = True  # False if there is none, and the forces' direction replaces the accelerometer's

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
        yield from self._joint_faults()
        yield from self._load_faults()
        yield from self._direction_faults()
        off = float(np.linalg.norm(self.off_centre))
        if off > self.limits.off_centre * self.size and self.weighs > self.limits.lightest * self.robot.mass:
            yield f"the centre of mass would be {100 * off:.0f} cm off the model's"

    def _joint_faults(self) -> Iterator[str]:
        for joint, beyond in zip(self.robot.tree.joints, self.outside, strict=True):
            if beyond > self.limits.outside:
                yield f"joint {joint!r} is {beyond:.2f} rad beyond its limits"

    def _load_faults(self) -> Iterator[str]:
        robot, limits = self.robot, self.limits
        if not limits.lightest < self.weighs / robot.mass < limits.heaviest:
            yield f"the robot would weigh {self.weighs:.3g} kg, the model {robot.mass:.3g} kg"
        for leg, load in zip(robot.legs, self.loads, strict=True):
            if load < -limits.pull * self.weight:
                yield f"leg {leg.name} would pull at the ground with {-load:.3g} N"
        for leg, load, across in zip(robot.legs, self.loads, self.sideways, strict=True):
            if load >= 0 and across > limits.sliding * load + limits.sliding_floor * self.weight:
                yield f"leg {leg.name} would push sideways with {across:.3g} N under {load:.3g} N"

    def _direction_faults(self) -> Iterator[str]:
        if self.force_angle > self.limits.force_angle:
            yield f"the feet's forces are {np.degrees(self.force_angle):.0f}° off the accelerometer's vertical"
        if self.plane_angle > self.limits.plane_angle:
            other = "the accelerometer's vertical" if self.imu else "the direction of their forces"
            yield f"the feet's plane is {np.degrees(self.plane_angle):.0f}° off {other}"
        if self.imu and self.tilts.contradict(self.limits):
            yield f"the feet's plane does not tilt as the IMU does, which tilts by {np.degrees(self.tilts.size):.1f}°"


class ConsistencyModel:
    """Evaluates the consistency of one robot's logs."""

    def __init__(self, robot: Robot, limits: CheckLimits) -> None:
        self.robot, self.limits = robot, limits
        joints = robot.tree.joints
        self._lower = np.array([robot.limits[joint].lower for joint in joints])
        self._upper = np.array([robot.limits[joint].upper for joint in joints])
        feet = nominal_feet(robot)
        self._size = 0.5 * float(np.linalg.norm(np.ptp(feet[:, :2], axis=0)))
        trunk = robot.inertias[robot.trunk]
        self._share = float(trunk.mass / robot.mass)
        self._com = np.asarray(trunk.com)

    def evaluate(self, footing: Footing) -> Consistency:
        """Computes the figures for some instants of a log."""
        blocks, a = footing.blocks, footing.specific_force
        mean_a = a.mean(axis=0)
        up = mean_a / np.linalg.norm(mean_a)
        legs = footing.force.mean(axis=0)
        total = legs.sum(axis=0)
        loads = legs @ up
        weight = float(total @ up)
        moment = np.cross(footing.contact, footing.force).sum(axis=1).mean(axis=0)
        # at rest Σ p x f = c x Σ f; across the vertical, relative to the model's trunk in the middle of its legs
        centre = np.cross(up, moment) / (weight if abs(weight) > 1e-6 else 1e-6)
        middle = footing.contact.mean(axis=(0, 1))
        model = self._share * self._com + (1.0 - self._share) * middle
        off = (centre - model) - up * ((centre - model) @ up)
        normal = _plane(footing.contact)
        beyond = np.maximum(np.maximum(blocks.position - self._upper, self._lower - blocks.position), 0.0)
        return Consistency(
            robot=self.robot,
            limits=self.limits,
            carried=float(np.linalg.norm(total)),
            weighs=weight / GRAVITY,
            loads=loads,
            sideways=np.linalg.norm(legs - loads[:, None] * up, axis=1),
            force_angle=_angle(total, up),
            plane_angle=_angle(normal, up),
            plane_force_angle=_angle(normal, total),
            off_centre=off,
            outside=beyond.mean(axis=0),
            tilts=Tilts.of(blocks.time, a, footing.contact, self.limits),
            size=self._size,
            imu=blocks.specific_force is not None,
        )


def _angle(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _plane(contact: Array) -> Array:
    """Unit normal (3,) of the plane through the feet's mean positions, on the trunk's side."""
    feet = contact.mean(axis=0)
    return np.asarray(ground_normal(feet, np.ones(4, dtype=bool), -feet.mean(axis=0)))


def blocks_of(time: Array, length: float) -> NDArray[np.int64]:
    """Index, from 0, of the block of this length [s] that contains each sample, (samples,)."""
    return np.unique(np.floor((time - time[0]) / length).astype(np.int64), return_inverse=True)[1].astype(np.int64)


def block_means(values: Array, block: NDArray[np.int64]) -> Array:
    """Means over blocks of values (samples, k), (blocks, k)."""
    sums = np.column_stack([np.bincount(block, column) for column in values.T])
    return np.asarray(sums / np.bincount(block)[:, None])
