"""Contact forces of a robot at rest from its joint torques, their covariance, and the vertical that they indicate.

With f the force of the ground on the foot and τ the actuator torques, the equations of a leg's joints are

    h = τ + Jᵀ f,      h = rigid-body torque at this motion + friction and offsets of the joints,      f = J^-T (h - τ)

(J: Jacobian of the contact for a held trunk; `stadera.body.tree`). A flat foot transmits a moment as well. All vectors
are in the trunk frame: the trunk's own motion enters h only through its angular velocity and specific force.
Accelerations of the joints are neglected. A point foot is a sphere: the contact is at foot - radius * normal, with the
normal of the plane through the feet in stance.

**The vertical without an IMU** is the direction of the total force. At rest the specific force of the trunk is a = g u,
u the vertical, trunk axes, in which the torques are linear, h = H a. So the feet's forces are affine in a, and so is
their sum, which carries the robot's mass M:

    F(a) = F₀ + K a,    F₀ = -Σ J^-T τ,    K = Σ J^-T H;        F(a) = M a,    |a| = g

These are three equations for three unknowns, M and the two angles of u. They are solved by the iteration a ← g F(a) /
|F(a)|, which contracts by about |K| / M, the effect of the legs' own weight on the feet's forces across the vertical,
as a share of the weight. If feet do not slip and joints are at rest, three feet hold the trunk at rest as well, so a
gyro would add nothing. Only an IMU could detect a steady push or pull across the vertical, which tilts F, and an
accelerating ground, which changes its magnitude; both are attributed to weight here. Constant errors of torques have
the same effect, and are in the error bars (`stadera.trunk.standing.estimator`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stadera.body import Body, Motion
from stadera.constants import GRAVITY, NOTHING, SINGULAR
from stadera.inertia import skew
from stadera.logs.recording import Recording
from stadera.robot.model import Robot
from stadera.trunk.ground import ground_normal
from stadera.trunk.measurement import Measurement, meant_stance, measurements_of
from stadera.types import Array, Bools

_CARRIES = 0.03  # least force along the normal on a foot in stance, share of the robot's weight


@dataclass(frozen=True, eq=False)
class Weights:
    """What a robot at rest in a posture carries, linear in the trunk's specific force: it weighs `links @ a`.

    Attributes:
        links: (6, n, 3), change of the wrench (F, μ) of the contacts on the trunk, less the links' own, by the weight
            of each link of the tree but the trunk.
        own: (6, 3), wrench on the trunk's origin that carries all links but the trunk; what the trunk's parameters
            contain of joints outside the legs at their reference position counts as trunk.
    """

    links: Array
    own: Array

    @property
    def moment(self) -> Array:
        """First moment of all links but the trunk, (3,) [kg·m], from h x a."""
        turned = self.own[3:]
        return 0.5 * np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Forces of the ground on the L feet, trunk frame and axes; legs in the robot's order, their J joints outwards.

    Attributes:
        wrenches: (L, 6) [N, N·m], force and moment about the trunk's origin of each contact; NaN for a near-singular
            leg, for which a direction of the force is not determined.
        feet, contact: (L, 3) [m], centres of the feet by forward kinematics, and points of contact.
        stance: (L,) bool, the loaded feet.
        normal: (3,), unit normal of the ground through the feet in stance.
        left: (J,) [N·m], h - τ.
        to_wrench, axis: (J, 6) and (J, 3), wrench by a unit of h - τ, zero for a near-singular leg, and joints' axes.
        position: (n,) [rad], of all joints.
        body: the robot.
    """

    wrenches: Array
    feet: Array
    contact: Array
    stance: Bools
    normal: Array
    left: Array
    to_wrench: Array
    axis: Array
    position: Array
    body: Body

    @property
    def force(self) -> Array:
        """(L, 3) [N]; NaN for a near-singular leg."""
        return self.wrenches[:, :3]

    @cached_property
    def wrench(self) -> Array:
        """(6,) [N, N·m], of all feet in stance: force, and moment about the trunk's origin."""
        return np.asarray(np.where(self.stance[:, None], self.wrenches, 0.0).sum(axis=0))

    def vertical(self, up: Array) -> Array:
        """Each foot's force along the vertical (3,), zero off the ground, (L,) [N]."""
        return np.where(self.stance, np.nan_to_num(self.force) @ up, 0.0)

    def pressure(self, up: Array) -> Array:
        """Centre of pressure (3,) [m] of all feet in stance, in the plane of the contacts' mean height along `up`."""
        load = self.vertical(up)
        contact, total = np.where(load[:, None] != 0.0, self.contact, 0.0), load.sum()
        moment = np.nan_to_num(self.wrenches[:, 3:] - np.cross(self.contact, np.nan_to_num(self.force)))
        own = np.cross(up, np.where(self.stance[:, None], moment, 0.0).sum(axis=0))  # of flat feet
        return np.asarray((load @ contact + own) / total)

    @cached_property
    def weights(self) -> Weights:
        """Of the robot's links in this posture, with the feet in stance."""
        body, q = self.body, np.tile(self.position, (3, 1))
        still, rest = np.zeros_like(q), np.zeros((3, 3))
        felt = self.stance & np.isfinite(self.force).all(axis=1)
        motion = Motion(q, still, still, rest, rest, np.eye(3), self.normal)
        state = body.at(motion, columns=True, contacts=self.contact - self.feet, bears=felt)
        links = (state.columns @ body.parameters[:, :, None])[..., 0].transpose(2, 1, 0)
        m, h = body.lumped[0], body.lumped[1:4]
        return Weights(links, state.inertial.sum(axis=1).T - np.vstack([m * np.eye(3), skew(h)]))


class ContactForceEstimator:
    """Computes the contact forces of successive measurements, neglecting accelerations of the joints.

    Args:
        robot: the model of the legs.

    Attributes:
        leg_mass: [kg], of all leg links.
        body: the robot's tree.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.leg_mass = robot.mass - robot.inertias[robot.trunk].mass
        self.body = Body.of(robot, others=False)
        self._whole = self.body if robot.extra is None else Body.of(robot)
        self._least, self._singular = _CARRIES * robot.mass * GRAVITY, SINGULAR * robot.leg_length**3
        self._last: tuple[Measurement, ContactForces] | None = None

    def at(self, measurement: Measurement) -> ContactForces:
        """The contact forces at a measurement, trunk axes; those of the latest one are kept."""
        if self._last is None or self._last[0] is not measurement:
            self._last = measurement, self._at(measurement)
        return self._last[1]

    def _at(self, m: Measurement) -> ContactForces:
        body, k, q, v = self.body, len(m.extra) // 3, m.joint_position, m.joint_velocity
        if k:
            body, q, v = self._whole, np.append(q, m.extra[:k]), np.append(v, m.extra[k : 2 * k])
        still, rest, J = np.zeros((1, len(q))), np.zeros((1, 3)), body.in_legs
        motion = Motion(q[None], v[None], still, m.angular_velocity[None], rest, m.force_at_origin[None], m.up)
        feet = body.at(motion).feet[0]
        measured = feet if m.foot_position is None else m.foot_position
        stance = np.ones(len(feet), dtype=bool) if m.stance is None else m.stance

        def solved(stance: Bools) -> ContactForces:
            normal = ground_normal(measured, stance, m.up)
            contact = measured - body.radii[:, None] * normal
            state = body.at(motion, contacts=contact - feet)
            left, singular = body.left(state, motion, m.effort[None])[0], np.abs(state.volume[0]) < self._singular
            E = np.where(singular[body.leg_of[J], None], 0.0, state.to_wrench[0, J])
            wrenches = np.add.reduceat(E * left[:, None], body.starts, axis=0)
            wrenches[singular] = np.nan
            axis = state.axis[0, J]
            return ContactForces(wrenches, feet, contact, stance, normal, left, E, axis, q, body)

        forces = solved(stance)
        loaded = stance & (forces.force @ forces.normal > self._least)
        return forces if np.array_equal(loaded, stance) else solved(loaded)


# -- the vertical without an IMU ------------------------------------------------------------------------------------


def vertical_by_forces(
    robot: Robot, position: Array, velocity: Array, effort: Array, stance: Bools | None = None
) -> tuple[Array, Array]:
    """The vertical indicated by the feet's forces, and the mass that they carry, for samples at rest.

    Args:
        robot: the model of the legs.
        position, velocity: (samples, n) [rad, rad/s], joints in the tree's order; velocities are used for friction
            only.
        effort: (samples, n) [N·m].
        stance: (samples, L), legs that may be loaded; None for all.

    Returns:
        Unit vectors (samples, 3), trunk axes, and the robot's mass (samples,) [kg]. Both are meaningless for a robot
        that is not on its feet.
    """
    body, count = Body.of(robot, others=False), len(position)
    J, singular = body.in_legs, SINGULAR * robot.leg_length**3
    torque = (effort - body.friction(velocity, velocity))[:, J]
    q = np.repeat(position, 3, axis=0)  # at rest, with the specific force along each axis
    still, rest = np.zeros_like(q), np.zeros((len(q), 3))
    motion = Motion(q, still, still, rest, rest, np.tile(np.eye(3), (count, 1)), np.zeros(3))
    feet = body.at(motion).feet[::3]
    away = -feet.mean(axis=1)
    away /= np.linalg.norm(away, axis=1, keepdims=True)

    def solved(carrying: Bools) -> tuple[Array, Array, Array]:
        """Vertical, sum of the forces, and each foot's force along the ground's normal."""
        normal = ground_normal(feet, carrying, away)
        state = body.at(motion._replace(normal=np.repeat(normal, 3, axis=0)))
        felt = (carrying & (np.abs(state.volume[::3]) >= singular))[:, body.leg_of[J]]
        E = np.where(felt[..., None], state.to_wrench[::3][:, J, :3], 0.0)
        bears = state.torque[:, J].reshape(count, 3, -1)
        fixed = -np.add.reduceat(E * torque[..., None], body.starts, axis=1)
        slope = np.add.reduceat(np.einsum("nki,njk->nkij", E, bears), body.starts, axis=1)
        up, total = _balanced(fixed.sum(axis=1), slope.sum(axis=1), normal)
        force = fixed + GRAVITY * np.matvec(slope, up[:, None])
        return up, total, np.matvec(force, normal)

    meant = np.ones(feet.shape[:2], dtype=bool) if stance is None else stance
    up, total, load = solved(meant)
    carrying = meant & (load > _CARRIES * robot.mass * GRAVITY)
    if not np.array_equal(carrying, meant):
        up, total, _ = solved(carrying)
    return up, np.linalg.norm(total, axis=1) / GRAVITY


def _balanced(fixed: Array, slope: Array, start: Array, iterations: int = 60) -> tuple[Array, Array]:
    """u (samples, 3) such that F₀ + g K u is along u, and that force, from F₀ (samples, 3) and K (samples, 3, 3)."""
    up, force = start, fixed
    for _ in range(iterations):
        force = fixed + GRAVITY * np.matvec(slope, up)
        size = np.linalg.norm(force, axis=1, keepdims=True)
        before, up = up, np.where(size > 0, force / np.where(size > 0, size, 1.0), up)
        if float(np.abs(up - before).max(initial=0.0)) < NOTHING:
            break
    return up, force


def measurements_without_imu(recording: Recording, robot: Robot, at_once: int = 4096) -> Iterator[Measurement]:
    """Yields a log's samples as if at rest, with the vertical from the feet's forces, computed for `at_once` samples at
    a time. The caller must check for rest.

    Raises:
        RecordingError: the log lacks a joint's velocity or effort.
        UnknownNameError: a joint of the robot is not recorded.
    """
    q, qd, effort = (recording.channel(name, robot.tree.joints) for name in ("position", "velocity", "effort"))
    stance = meant_stance(recording, robot)
    parts = [slice(start, start + at_once) for start in range(0, len(recording), at_once)]
    ups = [
        vertical_by_forces(robot, q[part], qd[part], effort[part], None if stance is None else stance[part])[0]
        for part in parts
    ]
    return measurements_of(recording, robot, vertical=np.concatenate(ups))
