"""Where the trunk is to be while it crawls: the planned centre of mass, less its lever from the trunk.

With p(t) the planned centre of mass seen from above, R(t) the planned rotation, z(t) the planned height of the trunk's
origin, and c the whole robot's centre of mass in trunk axes (the legs' part as measured),

    b_xy = p - (R c)_xy,      b_z = z.

c reckons with the trunk that was believed when the plan was made. A new belief therefore moves nothing; the next plan
begins with the new centre of mass, wherever that is, and moves it over the supports.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stadera.control.planner_com import ComPlan, SupportPhase, plan_com
from stadera.control.reference import Move, TrunkPose
from stadera.control.trunk import TrunkController
from stadera.estimate.measurement import Measurement
from stadera.robot.kinematics import foot_jacobians
from stadera.robot.stance import standing_configuration

Array = NDArray[np.float64]

_OUTDATED = 0.004  # m, that the believed centre of mass may have moved in the trunk since the plan
_STRETCHED = 0.35  # of |det J|, as a share of what it is in the nominal stance, below which a leg is stretched out


class BodyReference:
    """A `Reference` for the trunk controller, and the plan behind it.

    Args:
        controller: after its first update.

    Attributes:
        plan: of the centre of mass.
    """

    def __init__(self, controller: TrunkController) -> None:
        self._controller = controller
        here = controller.reference
        self._legs, self._room = np.zeros(3), np.ones(4)
        self._nominal = _determinants(
            foot_jacobians(controller.robot, standing_configuration(controller.robot)[None])[0]
        )
        self._mass, self._moment = controller.belief.mass, controller.belief.moment
        pose = TrunkPose(np.array([0.0, 0.0, here.position[2]]), here.rotation)
        self._pose = Move(pose, pose, controller.time, 1.0)
        self.plan = ComPlan.standing(controller.time, here.position[:2])

    def see(self, measurement: Measurement) -> None:
        """Takes in where the legs are; before each use of a new measurement."""
        state = self._controller.legs.at(measurement)
        self._legs, self._room = state.moment, _determinants(state.jacobians(state.feet)) / self._nominal

    def stretched(self, leg: int) -> bool:
        """Whether a leg is nearly straight, so that its foot gets no farther."""
        return bool(self._room[leg] < _STRETCHED)

    def begin(self) -> None:
        """Holds the trunk where the controller wants it now, after the first measurement was seen."""
        here = self._controller.reference
        self.plan = ComPlan.standing(self._controller.time, (here.position + here.rotation @ self._lever())[:2])

    def _lever(self) -> Array:
        """c, with the belief of the plan."""
        return np.asarray((self._moment + self._legs) / (self._mass + self._controller.legs.mass))

    @property
    def outdated(self) -> bool:
        """Whether the belief has changed by so much since the plan that the centre of mass is elsewhere."""
        belief = self._controller.belief
        lever = (belief.moment + self._legs) / (belief.mass + self._controller.legs.mass)
        off = lever - self._lever()
        return bool(off @ off > _OUTDATED**2)

    @property
    def com(self) -> Array:
        """Where the robot's centre of mass is believed to be now, (3,) [m], odometry frame."""
        controller, belief = self._controller, self._controller.belief
        lever = (belief.moment + self._legs) / (belief.mass + controller.legs.mass)
        return np.asarray(controller.position + controller.rotation @ lever)

    def at(self, time: float) -> TrunkPose:
        """Where to be at a time [s]."""
        (position, velocity, acceleration), pose = self.plan.at(time), self._pose.at(time)
        lever = self._lever()
        arm, turning = pose.rotation @ lever, pose.rotation @ np.cross(pose.angular_velocity, lever)
        return TrunkPose(
            np.array([*(position - arm[:2]), pose.position[2]]),
            pose.rotation,
            np.array([*(velocity - turning[:2]), pose.velocity[2]]),
            pose.angular_velocity,
            np.array([*acceleration, pose.acceleration[2]]),
        )

    def replan(self, time: float, phases: Sequence[SupportPhase], ground: float, margin: float, rest: float) -> None:
        """Plans the centre of mass anew, with the belief of now, from where the reference is.

        Args:
            ground: [m], height of the feet.
            margin: [m], and
            rest: as for `plan_com`.

        Raises:
            PlanError: there is no such plan.
        """
        now = self.at(time)
        self._mass, self._moment = self._controller.belief.mass, self._controller.belief.moment.copy()
        com = now.position + now.rotation @ self._lever()
        start = self.plan.at(time).copy()
        start[0] = com[:2]
        self.plan = plan_com(time, start, phases, float(com[2]) - ground, margin, rest)

    def pose(self, time: float, rotation: Array, height: float, duration: float) -> None:
        """Turns the trunk to a rotation (3, 3) and lifts its origin to a height [m] within a duration [s]."""
        goal = TrunkPose(np.array([0.0, 0.0, height]), rotation)
        self._pose = Move(self._pose.at(time), goal, time, duration)


def _determinants(jacobians: Array) -> Array:
    return np.asarray(np.abs(np.linalg.det(jacobians)))
