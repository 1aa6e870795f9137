"""Bounds on a leg's excitation: limits of position, velocity and torque, and clearance from all other bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from stadera.body import FrictionModel, JointMotion, JointTorqueRegressor
from stadera.constants import ROUNDING
from stadera.errors import IdentificationError
from stadera.excite.clearance import Clearance, ClearanceMap
from stadera.excite.sinusoids import Sinusoids
from stadera.robot.model import JointLimits, Robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array


@dataclass(frozen=True)
class Margins:
    """Margins between an excitation and the leg's limits."""

    position: float = 0.05  # distance from each joint limit [rad]
    reach: float = 1.0  # largest distance of a joint from the rest pose [rad]
    velocity: float = 0.7  # share of the joint's velocity limit that may be used
    effort: float = 0.7  # share of the joint's effort limit that may be used by the torque predicted by the prior model
    distance: float = 0.01  # least distance between the leg and all other bodies [m]

    def __post_init__(self) -> None:
        if not (self.position >= 0 and self.distance >= 0 and self.reach > 0):
            raise IdentificationError(f"margins must not be negative, the reach positive; got {self}")
        if not (0 < self.velocity <= 1 and 0 < self.effort <= 1):
            raise IdentificationError(f"shares of velocity and effort limits lie between 0 and 1; got {self}")


@dataclass(frozen=True, eq=False)
class LegBounds:
    """Bounds on one leg's joints with the trunk held level; margins are already subtracted."""

    robot: Robot
    leg: str
    rest: Array  # (n,) [rad], the pose at the start and the end
    lower: Array  # (n,) [rad]; the rest pose is within
    upper: Array  # (n,) [rad]
    velocity: Array  # (n,) [rad/s], infinite if the model states none
    effort: Array  # (n,) [N·m], infinite if the model states none
    clearance: Clearance  # from trunk, other legs, the leg itself and the ground

    @classmethod
    def of(
        cls,
        robot: Robot,
        leg: str,
        rest: ArrayLike | None = None,
        margins: Margins | None = None,
        ground: float | None = None,
    ) -> LegBounds:
        """Computes the bounds of a robot's leg around a rest pose (n,) [rad], None for the nominal stance, above a
        level ground at a height in the trunk frame [m], None for none.

        Raises:
            UnknownNameError: no such leg.
            IdentificationError: the rest pose is outside the joints' limits, or too close to the ground.
            ModelError: no rest pose is given, and the robot has no nominal stance.
        """
        margins = margins or Margins()
        joints = robot.leg(leg).joints
        indices = [robot.tree.joints.index(joint) for joint in joints]
        pose = standing_configuration(robot)[indices] if rest is None else np.asarray(rest, dtype=float)
        limits = [robot.limits[joint] for joint in joints]
        _check_within(joints, pose, limits)
        lower, upper, velocity, effort = np.array([[x.lower, x.upper, x.velocity, x.effort] for x in limits]).T
        return cls(
            robot,
            robot.leg(leg).name,
            pose,
            np.minimum(pose, np.maximum(lower + margins.position, pose - margins.reach)),
            np.maximum(pose, np.minimum(upper - margins.position, pose + margins.reach)),
            margins.velocity * velocity,
            margins.effort * effort,
            Clearance.of(robot, leg, pose, margins.distance, ground),
        )

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the leg's joints."""
        return self.robot.leg(self.leg).joints

    @cached_property
    def _model(self) -> tuple[JointTorqueRegressor, dict[str, float]]:
        leg = self.robot.leg(self.leg)
        regressor = JointTorqueRegressor(self.robot.leg_tree(self.leg), FrictionModel.full())
        bodies = {link: self.robot.inertias[link].to_dict() for link in leg.links}
        joints = {joint: vars(self.robot.dynamics[joint]) for joint in leg.joints}
        return regressor, {f"{of}.{name}": v for of, terms in (bodies | joints).items() for name, v in terms.items()}

    def torque(self, motion: JointMotion) -> Array:
        """Torque of the motion predicted by the prior model, friction included, (samples, n) [N·m]."""
        regressor, values = self._model
        return regressor.predict(motion, values)

    def gravity_torque(self, position: Array) -> Array:
        """Torque that holds poses (samples, n), predicted by the prior model, (samples, n) [N·m]."""
        still = np.zeros_like(position)
        return self.torque(JointMotion(position, still, still))

    @cached_property
    def clearance_map(self) -> ClearanceMap:
        """The clearance, tabulated over the position bounds."""
        return ClearanceMap.of(self.clearance, self.lower, self.upper)

    def excess(self, motion: JointMotion) -> float:
        """Largest violation of the bounds, ≤ 0 within, as a share of the range, the velocity or the effort bound."""
        q = motion.position
        span = np.maximum(self.upper - self.lower, 1e-9)
        over = max(float(((q - self.upper) / span).max()), float(((self.lower - q) / span).max()))
        over = max(over, float((np.abs(motion.velocity) / self.velocity).max()) - 1.0)
        return max(over, float((np.abs(self.torque(motion)) / self.effort).max()) - 1.0)


def _check_within(joints: Sequence[str], pose: Array, limits: Sequence[JointLimits]) -> None:
    for joint, angle, limit in zip(joints, pose, limits, strict=True):
        if not limit.lower <= angle <= limit.upper:
            raise IdentificationError(
                f"rest pose of joint {joint!r}, {angle:.4g} rad, lies outside its limits "
                f"{limit.lower:.4g} to {limit.upper:.4g} rad"
            )


def fitting_factor(motion: Sinusoids, bounds: LegBounds, step: float = 0.99, rate: float = 100.0) -> float:
    """Factor by which the motion must be scaled towards the rest pose to satisfy the bounds, 1 if it does: the first
    power of `step` that fits at samples of `rate` [Hz].

    Raises:
        IdentificationError: the rest pose itself violates the bounds.
    """
    factor = 1.0
    while not _fits(motion.drawn_in(factor), bounds, rate):
        factor *= step
        if factor < 0.01:
            raise IdentificationError(f"leg {bounds.leg}: the rest pose itself is out of bounds")
    return factor


def _fits(motion: Sinusoids, bounds: LegBounds, rate: float) -> bool:
    """True if the motion satisfies the bounds. The cheapest tests come first."""
    samples = motion.sample(rate).motion
    if bounds.excess(samples) > ROUNDING:
        return False
    return all(bounds.clearance.slack(samples.position[::every]).min() >= -ROUNDING for every in (20, 2))
