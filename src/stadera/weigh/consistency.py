"""Whether encoders, torques and IMU tell of the same robot, on average over a log of one that is on its feet.

Three witnesses speak of the vertical in trunk axes, and none of them needs the others: the accelerometer, along â; the
ground's forces that the torques say, Σ f = m a on average; the plane through the feet that the encoders say, up to the
ground's slope. The forces tell besides what the robot weighs, Σ f · â / |a|, what each leg carries, and by their moment
where the centre of mass is. Without an IMU two witnesses are left, and â is along the forces themselves. A `Picture`
holds these figures, `faults` says which of them are impossible, `cost` how unlikely they are together.

Legs' accelerations are left out: over steps they cancel, and at rest there are none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.contact import ground_normal
from stadera.estimate.vertical import vertical_by_forces
from stadera.regressors.motion import STANDARD_GRAVITY
from stadera.robot.kinematics import foot_positions, forward_kinematics, joint_axes, point_jacobians
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration

Array = NDArray[np.float64]

BLOCK = 0.25
"""s, over which is averaged before tilts are compared."""

_LIGHTEST, _HEAVIEST = 0.6, 2.2  # of the robot's mass, that it may seem to weigh
_HANGING = 0.15  # of its mass, below which it is not on its feet
_FORCE_ANGLE, _PLANE_ANGLE = np.radians(10.0), np.radians(30.0)
_PULL = 0.08  # of the weight, that a leg may seem to pull at the ground with on average
_SLIDING = (1.5, 0.1)  # of a leg's load, and of the weight, that it may push sideways with
_OFF_CENTRE = 0.35  # of the feet's rectangle, that the centre of mass may be off the model's
_OUTSIDE = 0.1  # rad, beyond a joint's limit on average
_QUIET, _FEWEST_BLOCKS = 1.0, 4  # m/s² off gravity at most in a block whose tilt counts, and how many it takes
_TILT, _UNLIKE, _LIKE = np.radians(1.5), 0.3, 0.7  # tilt that tells, likeness that is too little, and enough


@dataclass(frozen=True, eq=False)
class Sensed:
    """What the sensors said, evenly thinned out; joints in the tree's order.

    Attributes:
        time: (samples,) [s].
        position: (samples, n) [rad]. effort: (samples, n) [N·m].
        specific_force: (samples, 3) [m/s²], trunk axes; None without an IMU.
    """

    time: Array
    position: Array
    effort: Array
    specific_force: Array | None


@dataclass(frozen=True, eq=False)
class Picture:
    """The figures that the sensors give together, trunk axes.

    Attributes:
        robot: that was believed in.
        carried: size of all forces on the feet together [N], whatever their direction.
        weighs: what of it is upwards [kg].
        loads: (4,) [N], by each foot, along the accelerometer's vertical.
        sideways: (4,) [N], across it.
        force_angle: between forces and accelerometer [rad].
        plane_angle: between the feet's plane and the accelerometer [rad].
        plane_force_angle: between the feet's plane and the forces [rad].
        off_centre: (3,) [m], of the centre of mass from the model's, level.
        outside: (n,) [rad], beyond the joints' limits, on average.
        tilt: how much the IMU tilts about its mean [rad].
        alike: how much the feet's plane tilts as it does: 1 the same, 0 otherwise, -1 the other way round.
        alike_turned: the most of that, were the plane turned by a multiple of 90° or mirrored.
        size: of the feet's rectangle in the nominal stance, half its diagonal [m].
        imu: whether there is one; else the forces' direction is taken for the accelerometer's.
    """

    robot: Robot
    carried: float
    weighs: float
    loads: Array
    sideways: Array
    force_angle: float
    plane_angle: float
    plane_force_angle: float
    off_centre: Array
    outside: Array
    tilt: float
    alike: float
    alike_turned: float
    size: float
    imu: bool = True

    @property
    def weight(self) -> float:
        """The model's [N]."""
        return self.robot.mass * STANDARD_GRAVITY

    @property
    def hangs(self) -> bool:
        """Whether the feet carry next to nothing, all together and each."""
        each = np.hypot(self.loads, self.sideways)
        return self.carried < _HANGING * self.weight and bool((each < _HANGING * self.weight).all())

    @property
    def cost(self) -> float:
        """How unlikely: squares of the figures in units in which one is usual."""
        mass = (self.weighs / self.robot.mass - 1.0) / 0.2
        tilt = self.tilt * (1.0 - self.alike) / np.radians(1.5)
        terms = [
            np.array([mass, tilt, self.force_angle / np.radians(3.0), self.plane_angle / np.radians(10.0)]),
            self.off_centre / (0.15 * self.size),
            np.minimum(self.loads, 0.0) / (0.05 * self.weight),
            self.sideways / (0.15 * self.weight),
            self.outside / 0.05,
        ]
        return float(sum(term @ term for term in terms))

    def faults(self) -> Iterator[str]:
        """What is impossible, one clause each."""
        robot = self.robot
        for joint, beyond in zip(robot.tree.joints, self.outside, strict=True):
            if beyond > _OUTSIDE:
                yield f"joint {joint!r} is {beyond:.2f} rad beyond its limits"
        if not _LIGHTEST < self.weighs / robot.mass < _HEAVIEST:
            yield f"the robot would weigh {self.weighs:.3g} kg, the model {robot.mass:.3g} kg"
        for leg, load in zip(robot.legs, self.loads, strict=True):
            if load < -_PULL * self.weight:
                yield f"leg {leg.name} would pull at the ground with {-load:.3g} N"
        share, floor = _SLIDING
        for leg, load, across in zip(robot.legs, self.loads, self.sideways, strict=True):
            if load >= 0 and across > share * load + floor * self.weight:
                yield f"leg {leg.name} would push sideways with {across:.3g} N under {load:.3g} N"
        if self.force_angle > _FORCE_ANGLE:
            yield f"the feet's forces are {np.degrees(self.force_angle):.0f}° off the accelerometer's vertical"
        if self.plane_angle > _PLANE_ANGLE:
            other = "the accelerometer's vertical" if self.imu else "the direction of their forces"
            yield f"the feet's plane is {np.degrees(self.plane_angle):.0f}° off {other}"
        if self.imu and self.tilt > _TILT and self.alike < _UNLIKE and self.alike_turned > _LIKE:
            yield f"the feet's plane does not tilt as the IMU does, which tilts by {np.degrees(self.tilt):.1f}°"
        off = float(np.linalg.norm(self.off_centre))
        if off > _OFF_CENTRE * self.size and self.weighs > _LIGHTEST * robot.mass:
            yield f"the centre of mass would be {100 * off:.0f} cm off the model's"


class Painter:
    """Makes pictures of what sensors said, for one robot."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        joints = robot.tree.joints
        self._lower = np.array([robot.limits[joint].lower for joint in joints])
        self._upper = np.array([robot.limits[joint].upper for joint in joints])
        feet = foot_positions(robot, standing_configuration(robot)[None])[0]
        self._size = 0.5 * float(np.linalg.norm(np.ptp(feet[:, :2], axis=0)))
        trunk = robot.inertias[robot.trunk]
        tree = robot.tree
        self._joints = np.array([[joints.index(joint) for joint in leg.joints] for leg in robot.legs])
        self._links = np.array([[tree.links.index(link) for link in leg.links] for leg in robot.legs])
        self._masses = np.array([[robot.inertias[link].mass for link in leg.links] for leg in robot.legs])
        self._coms = np.array([[robot.inertias[link].com for link in leg.links] for leg in robot.legs])
        self._radii = np.array([leg.foot_radius for leg in robot.legs])
        self._share = float(trunk.mass / robot.mass)
        self._com = np.asarray(trunk.com)

    def paint(self, sensed: Sensed) -> Picture:
        """The figures of what was sensed."""
        a = self._by_forces(sensed) if sensed.specific_force is None else sensed.specific_force
        force, contact = self._forces(sensed, a)
        mean_a = a.mean(axis=0)
        up = mean_a / np.linalg.norm(mean_a)
        legs = force.mean(axis=0)
        total = legs.sum(axis=0)
        loads = legs @ up
        weight = float(total @ up)
        moment = np.cross(contact, force).sum(axis=1).mean(axis=0)
        # at rest Σ p x f = c x Σ f; what is across the vertical, from the model's trunk in the middle of its legs
        centre = np.cross(up, moment) / (weight if abs(weight) > 1e-6 else 1e-6)
        middle = contact.mean(axis=(0, 1))
        model = self._share * self._com + (1.0 - self._share) * middle
        off = (centre - model) - up * ((centre - model) @ up)
        normal = _plane(contact)
        tilt, alike, turned = _tilts(sensed.time, a, contact)
        beyond = np.maximum(np.maximum(sensed.position - self._upper, self._lower - sensed.position), 0.0)
        return Picture(
            robot=self.robot,
            carried=float(np.linalg.norm(total)),
            weighs=weight / STANDARD_GRAVITY,
            loads=loads,
            sideways=np.linalg.norm(legs - loads[:, None] * up, axis=1),
            force_angle=_angle(total, up),
            plane_angle=_angle(normal, up),
            plane_force_angle=_angle(normal, total),
            off_centre=off,
            outside=beyond.mean(axis=0),
            tilt=tilt,
            alike=alike,
            alike_turned=turned,
            size=self._size,
            imu=sensed.specific_force is not None,
        )

    def _by_forces(self, sensed: Sensed) -> Array:
        """What an accelerometer would have read if the feet's forces were along the vertical, (samples, 3)."""
        still = np.zeros_like(sensed.position)
        return STANDARD_GRAVITY * vertical_by_forces(self.robot, sensed.position, still, sensed.effort)[0]

    def _forces(self, sensed: Sensed, a: Array) -> tuple[Array, Array]:
        """Forces on the feet [N] and contacts [m], trunk frame, (samples, 4, 3), at rest in the specific force a.

        A joint bears the links below it, h_j = s_j · Σ (c_l - o_j) x m_l a, and f = J^-T (h - τ).
        """
        rotations, origins = forward_kinematics(self.robot.tree, sensed.position)
        axes, places = joint_axes(self.robot, sensed.position)  # (samples, 4, 3, joints)
        bears = np.zeros((len(a), 4, 3))
        for leg in range(4):
            for k, link in enumerate(self._links[leg]):
                com = origins[:, link] + rotations[:, link] @ self._coms[leg, k]
                for j in range(k + 1):
                    arm = com - places[:, leg, :, j]
                    bears[:, leg, j] += self._masses[leg, k] * (axes[:, leg, :, j] * np.cross(arm, a)).sum(axis=1)
        feet = foot_positions(self.robot, sensed.position)
        down = a / np.linalg.norm(a, axis=1, keepdims=True)
        contact = feet - self._radii[:, None] * down[:, None, :]
        transposed = np.swapaxes(point_jacobians(axes, places, contact), -1, -2)
        torque = bears - sensed.effort[:, self._joints]
        # a leg so stretched that a direction is not felt: least squares, which puts nothing there
        return np.asarray((np.linalg.pinv(transposed, rcond=1e-3) @ torque[..., None])[..., 0]), contact


def _angle(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _plane(contact: Array) -> Array:
    """Unit normal (3,) of the plane through the feet's mean places, on the trunk's side."""
    feet = contact.mean(axis=0)
    return np.asarray(ground_normal(feet, np.ones(4, dtype=bool), -feet.mean(axis=0)))


def _tilts(time: Array, specific_force: Array, contact: Array) -> tuple[float, float, float]:
    """How much the accelerometer tilts [rad], how alike the feet's plane does, and were it turned or mirrored at most.

    By the means of blocks in which the trunk is hardly accelerated, trunk's x-y; no tilt where there are too few.
    """
    block = blocks_of(time)
    size = np.linalg.norm(specific_force, axis=1)
    loud = np.zeros(block[-1] + 1)
    np.maximum.at(loud, block, np.abs(size - STANDARD_GRAVITY))
    quiet = loud < _QUIET
    if quiet.sum() < _FEWEST_BLOCKS:
        return 0.0, 1.0, 1.0
    a = block_means(specific_force, block)[quiet]
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    feet = block_means(contact.reshape(len(contact), 12), block)[quiet].reshape(-1, 4, 3)
    plane = ground_normal(feet, np.ones((len(feet), 4), dtype=bool), -feet.mean(axis=1))
    a, plane = (a - a.mean(axis=0))[:, :2], (plane - plane.mean(axis=0))[:, :2]
    both = a.T @ plane  # [i, j]: the IMU's tilt along i with the plane's along j
    size_of_both = 0.5 * float((a**2).sum() + (plane**2).sum()) or 1.0
    signs = [(s, t) for s in (1, -1) for t in (1, -1)]
    turned = [s * both[0, 0] + t * both[1, 1] for s, t in signs[1:]]
    turned += [s * both[0, 1] + t * both[1, 0] for s, t in signs]
    alike = float(both[0, 0] + both[1, 1])
    return float(np.sqrt((a**2).sum(axis=1).mean())), alike / size_of_both, float(max(turned)) / size_of_both


def blocks_of(time: Array) -> NDArray[np.int64]:
    """(samples,), the number of the block that each sample is in, counted from 0."""
    return np.unique(np.floor((time - time[0]) / BLOCK).astype(np.int64), return_inverse=True)[1].astype(np.int64)


def block_means(values: Array, block: NDArray[np.int64]) -> Array:
    """Means over blocks of values (samples, k), (blocks, k)."""
    sums = np.column_stack([np.bincount(block, column) for column in values.T])
    return np.asarray(sums / np.bincount(block)[:, None])
