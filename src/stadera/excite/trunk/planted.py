"""Motion and torques of a robot whose trunk moves while its feet stay where they are.

With the trunk at p and rotation R (world, in which the robot stands at the origin with R = 1), a foot that is at r_0 in
the world is at r = Rᵀ (r_0 - p) in trunk axes; the joints follow by Newton's method on all samples at once. The trunk's
specific force is a = Rᵀ (p̈ + g e_z), and with roll φ, pitch θ and yaw ψ, R = R_z(ψ) R_y(θ) R_x(φ),

    ω = (φ̇ - ψ̇ sin θ,  θ̇ cos φ + ψ̇ cos θ sin φ,  ψ̇ cos θ cos φ - θ̇ sin φ)

The contacts together carry the wrench that trunk and links need, G f = w; of all such forces those of least norm are
taken, f = Gᵀ (G Gᵀ)⁻¹ w. Torques are then τ = h - Jᵀ f, see `stadera.body.tree`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from stadera.body import Body, Motion, State
from stadera.constants import GRAVITY
from stadera.errors import IdentificationError
from stadera.excite.sinusoids import Sinusoids
from stadera.inertia import InertialParameters, skews
from stadera.robot.kinematics import leg_kinematics
from stadera.robot.model import Robot
from stadera.robot.stance import StanceSettings, reached, standing_configuration
from stadera.trunk.wrench import TRUNK_MAP, trunk_signals
from stadera.types import Array

AXES = ("roll", "pitch", "yaw", "x", "y", "z")
"""Coordinates of the trunk's motion [rad, m], in this order."""

_SOLVED = 1e-7  # error of a foot that stays where it is [m, 1]
_EVERY = 4  # samples between two at which the joints are solved for; a spline gives those between


@dataclass(frozen=True, eq=False)
class Planted:
    """A standing robot in motion, N samples of n joints and L legs.

    Attributes:
        robot: the robot.
        time: (N,) [s].
        pose: (N, 6) [rad, m], coordinates `AXES` of the trunk relative to the stance.
        motion: of its joints and trunk.
    """

    robot: Robot
    time: Array
    pose: Array
    motion: Motion

    @classmethod
    def of(cls, robot: Robot, path: Sinusoids, rate: float) -> Planted:
        """The robot's motion for a path of the trunk with the coordinates `AXES`, sampled at `rate` [Hz].

        Raises:
            IdentificationError: a foot cannot stay where it is.
            ModelError: the robot has no nominal stance.
        """
        reference = path.sample(rate)
        time, pose = reference.time, reference.motion.position
        slope, curve = reference.motion.velocity, reference.motion.acceleration
        turn = Rotation.from_euler("ZYX", pose[:, [2, 1, 0]]).as_matrix()
        (sin_roll, sin_pitch, _), (cos_roll, cos_pitch, _) = np.sin(pose[:, :3]).T, np.cos(pose[:, :3]).T
        roll, pitch, yaw = slope[:, :3].T
        omega = np.column_stack(
            [
                roll - yaw * sin_pitch,
                pitch * cos_roll + yaw * cos_pitch * sin_roll,
                yaw * cos_pitch * cos_roll - pitch * sin_roll,
            ]
        )
        alpha = make_interp_spline(time, omega, 5)(time, 1)
        force = np.einsum("nji,nj->ni", turn, curve[:, 3:] + [0.0, 0.0, GRAVITY])
        coarse = np.unique(np.append(np.arange(0, len(time), _EVERY), len(time) - 1))
        angles = make_interp_spline(time[coarse], _joints(robot, turn[coarse], pose[coarse, 3:]), 5)
        q, rate_of_q, more = (np.asarray(angles(time, order)) for order in range(3))
        return cls(robot, time, pose, Motion(q, rate_of_q, more, omega, alpha, force, turn[:, 2]))

    @cached_property
    def _body(self) -> Body:
        return Body.of(self.robot, others=False)

    @cached_property
    def _state(self) -> State:
        return self._body.at(self.motion)

    @cached_property
    def contacts(self) -> Array:
        """Points of contact, (N, L, 3) [m], trunk axes."""
        return np.asarray(self._state.feet - self._body.radii[:, None] * self.motion.normal[:, None])

    def torques(self, trunk: InertialParameters) -> tuple[Array, Array]:
        """Joint torques (N, n) [N·m] and contact forces (N, L, 3) [N], trunk axes, with a trunk that may carry a load.

        Friction and rotors are those of the robot's model.
        """
        body, state, motion = self._body, self._state, self.motion
        signals = trunk_signals(motion.specific_force.T, motion.angular_velocity.T, motion.angular_acceleration.T)
        own = np.einsum("ckn,k->nc", (TRUNK_MAP @ signals).reshape(6, 10, -1), trunk.vector)
        wrench = own + state.inertial.sum(axis=1)
        # of each contact, force above moment about the trunk's origin: [1 0 ; [p]x 1]
        whole = np.tile(np.eye(6), (*self.contacts.shape[:2], 1, 1))
        whole[:, :, 3:, :3] = skews(self.contacts)
        G = np.concatenate([whole[:, leg, :, :size] for leg, size in enumerate(body.sizes)], axis=2)
        found = np.einsum("nck,nc->nk", G, np.linalg.solve(G @ G.transpose(0, 2, 1), wrench[..., None])[..., 0])
        torque = state.torque + body.friction(motion.velocity, motion.velocity)
        force, at = np.empty((len(wrench), len(body.legs), 3)), 0
        for k, (leg, size) in enumerate(zip(body.legs, body.sizes, strict=True)):
            own_force, at = found[:, at : at + size], at + size
            axis, arm = state.axis[:, leg], self.contacts[:, k, None] - state.origin[:, leg]
            rows = np.concatenate([np.cross(axis, arm), axis], axis=2)[:, :, :size]
            torque[:, leg] -= np.einsum("njc,nc->nj", rows, own_force)
            force[:, k] = own_force[:, :3]
        return torque, force


def _joints(robot: Robot, turn: Array, shift: Array) -> Array:
    """Joint angles (N, n) that keep the feet where they are in the stance, for poses (N, 3, 3) and (N, 3) [m]."""
    out, settings = np.tile(standing_configuration(robot), (len(turn), 1)), StanceSettings()
    for leg in robot.legs:
        tree, own = robot.leg_tree(leg.name), [robot.tree.joints.index(joint) for joint in leg.joints]
        sole, foot, _ = leg_kinematics(tree, leg, out[:1, own])
        foot = np.einsum("nji,nj->ni", turn, foot - shift)
        out[:, own], left = reached(tree, leg, out[:, own], foot, turn.transpose(0, 2, 1) @ sole, settings)
        if left > _SOLVED:
            raise IdentificationError(f"{leg.name} of {robot.name} cannot keep its foot in place: {left:.2g} m away")
    return out
