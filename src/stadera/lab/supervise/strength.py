"""Checks whether a robot is strong enough to walk with a load: joint torques on three legs relative to their limits.

A statically stable crawl lifts each leg in turn while the centre of mass is over the triangle of the others. In the
nominal stance on level ground, with the centre of mass over the triangle's incentre c, where its three margins are
equal, vertical forces f_i hold it:

    Σ f_i = m_r g,   Σ f_i p_i = m_r g c  (seen from above)   =>   f_i = m_r g λ_i,   λ: barycentric coordinates of c

and need the torques τ_i = h_i - J_iᵀ f_i u. λ_i is the length of the edge opposite to foot i over the circumference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.constants import GRAVITY
from stadera.lab.control.legs import MeasuredLegs
from stadera.robot.model import Robot
from stadera.robot.stance import standing_configuration
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel


@dataclass(frozen=True)
class Effort:
    """The most heavily loaded joint when the robot stands on three legs."""

    joint: str
    torque: float  # [N·m], positive
    limit: float  # [N·m], positive

    @property
    def share(self) -> float:
        """Torque as a share of the limit; zero for a joint without one."""
        return self.torque / self.limit if np.isfinite(self.limit) else 0.0


def hardest_effort(robot: Robot, trunk: TrunkModel) -> Effort:
    """The joint closest to its torque limit when the robot stands on any three legs with this trunk."""
    legs, q = MeasuredLegs(robot), standing_configuration(robot)
    up, zero = np.array([0.0, 0.0, 1.0]), np.zeros(len(q))
    state = legs.measured(Measurement(0.0, q, zero, zero, np.zeros(3), GRAVITY * up, np.eye(3)))
    contact = state.feet - np.array([[leg.foot_radius] for leg in robot.legs]) * up
    lifting = state.jacobians(contact)[:, 2, :]  # decrease in torques per unit of vertical force
    efforts = []
    for swing in range(len(robot.legs)):
        standing = [k for k in range(len(robot.legs)) if k != swing]
        triangle = contact[standing, :2]
        opposite = np.linalg.norm(np.roll(triangle, -1, axis=0) - np.roll(triangle, 1, axis=0), axis=1)
        forces = (trunk.mass + legs.leg_mass) * GRAVITY * opposite / opposite.sum()
        for k, force in zip(standing, forces, strict=True):
            torques = np.abs(state.bias[k] - force * lifting[k]).tolist()
            efforts += [
                Effort(joint, torque, robot.limits[joint].effort)
                for joint, torque in zip(robot.legs[k].joints, torques, strict=True)
            ]
    return max(efforts, key=lambda effort: effort.share)
