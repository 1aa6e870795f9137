"""Contact forces from joint torques, sample by sample: f = J_c^-T (h - τ) for each leg.

With f the force of the ground on the foot and τ the actuator torques, the equations of a leg's joints are

    h = τ + J_cᵀ f,      h = rigid-body torque at this motion + friction and offsets of the joints

(J_c: Jacobian of the contact point for a held trunk). A leg has three joints, so J_c is square and the paper's
pseudo-inverse is an inverse. All vectors are in the trunk frame: the trunk's own motion enters h only through its
angular velocity and specific force. Accelerations of the joints are neglected; `stadera.body` includes
them.

The foot is a sphere: the contact is at foot - radius * normal, with the normal of the plane through the feet in stance.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from stadera.body.friction import JointFriction
from stadera.body.instant import inverse_transposed
from stadera.body.statics import LegModel
from stadera.constants import GRAVITY
from stadera.errors import UnknownNameError
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.standing.contact import ContactForces, ground_normal
from stadera.trunk.standing.legs import MeasuredLegs
from stadera.trunk.standing.noise import ForceNoise
from stadera.types import Bools

JacobianOf = Literal["feet", "encoders"]

CARRIES = 0.03
"""Least force along the normal on a foot in stance, as a share of the robot's weight."""


class ContactForceEstimator:
    """Computes the contact forces of successive measurements, neglecting accelerations of the joints.

    Args:
        robot: the model of the legs.
        noise: of torques and feet; None for the default shares of the effort limits.
        legs: shared with other users of the same measurements; None for a new one.
        jacobian: at the "feet" as measured or by the "encoders"; the two differ only if the measurement contains foot
            positions.

    Raises:
        UnknownNameError: another kind of Jacobian.
    """

    def __init__(
        self,
        robot: Robot,
        noise: ForceNoise | None = None,
        legs: MeasuredLegs | None = None,
        jacobian: JacobianOf = "feet",
    ) -> None:
        if jacobian not in ("feet", "encoders"):
            raise UnknownNameError("Jacobian of the contacts", jacobian, ("feet", "encoders"))
        self.robot, self.legs = robot, legs or MeasuredLegs(robot)
        self.noise = noise or ForceNoise.of(robot)
        self.jacobian = jacobian
        self._radii = np.array([[leg.foot_radius] for leg in robot.legs])
        self._least = CARRIES * robot.mass * GRAVITY
        self._friction, self._least_volume = JointFriction.of(robot), LegModel.of(robot).least_volume
        self._everyone = np.ones(4, dtype=bool)

    def at(self, measurement: Measurement) -> ContactForces:
        """The contact forces at a measurement, trunk axes."""
        m, state, columns = measurement, self.legs.at(measurement), self.legs.columns
        torque = state.bias + self._friction.torque(m.joint_velocity[columns]) - m.effort[columns]
        feet = state.feet if m.foot_position is None else m.foot_position
        stance = self._everyone if m.stance is None else m.stance

        def solved(stance: Bools) -> ContactForces:
            normal = ground_normal(feet, stance, m.up)
            below = self._radii * normal
            contact = feet - below
            jacobian = state.jacobians(contact if self.jacobian == "feet" else state.feet - below)
            by_torque = inverse_transposed(jacobian, self._least_volume)
            force = np.matvec(by_torque, torque)
            moves = self.jacobian == "feet"
            return ContactForces(force, contact, stance, normal, jacobian, by_torque, state.axes, self.noise, moves)

        forces = solved(stance)
        loaded = stance & (forces.force @ forces.normal > self._least)
        return forces if loaded.tolist() == stance.tolist() else solved(loaded)
