"""Reference of the trunk during a crawl: the planned centre of mass minus its lever from the trunk.

With p(t) the planned centre of mass seen from above, R(t) the planned rotation, z(t) the planned height of the trunk's
origin, and c the whole robot's centre of mass in trunk axes (the legs' part as measured),

    b_xy = p - (R c)_xy,      b_z = z.

c uses the model of the trunk with which the plan was made. So a new model does not move the reference; the next plan
starts at the new centre of mass and moves it over the supports. Plans use the controller's target model, so that each
new model causes one new plan only.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stadera.constants import GRAVITY
from stadera.lab.control.com_plan import ComPlan, SupportPhase, plan_com
from stadera.lab.control.legs import foot_jacobians
from stadera.lab.control.reference import Move, TrunkPose
from stadera.lab.control.steps import CrawlSettings
from stadera.lab.control.support import GroundPlane, SupportPolygon, facing
from stadera.lab.control.trunk import TrunkController
from stadera.robot.stance import standing_configuration
from stadera.trunk.measurement import Measurement
from stadera.types import Array


class BodyReference:
    """A `TrunkReference`, which holds the trunk at the controller's reference until the first `replan`: `plan` of the
    centre of mass, `normal` (3,) of the ground, to which the trunk is parallel.
    """

    def __init__(self, controller: TrunkController, settings: CrawlSettings, measurement: Measurement) -> None:
        self._controller, self._settings = controller, settings
        self._nominal = _determinants(
            foot_jacobians(controller.robot, standing_configuration(controller.robot)[None])[0]
        )
        self._mass, self._moment = controller.trunk.target_mass, controller.trunk.target_moment
        self.see(measurement)
        here = controller.reference
        self.plan = ComPlan.standing(controller.time, (here.position + here.rotation @ self._lever())[:2])
        pose = TrunkPose(np.array([0.0, 0.0, here.position[2]]), here.rotation)
        self._pose = Move(pose, pose, controller.time, 1.0)
        plane = GroundPlane.of(controller.feet)
        self.normal, self._height = plane.normal, float(controller.position[2] - plane.at(controller.position))

    def see(self, measurement: Measurement) -> None:
        """Updates the pose of the legs; must be called before each use of a new measurement."""
        state = self._controller.legs.measured(measurement)
        self._legs, self._room = state.moment, _determinants(state.jacobians(state.feet)) / self._nominal

    def stretched(self, leg: int) -> bool:
        """True if a leg is nearly extended, so that its foot cannot reach farther."""
        return bool(self._room[leg] < self._settings.stretched)

    def _lever(self) -> Array:
        """c, with the trunk model of the plan."""
        return np.asarray((self._moment + self._legs) / (self._mass + self._controller.legs.leg_mass))

    def _current_lever(self) -> Array:
        """c, with the present trunk model."""
        trunk = self._controller.trunk
        return np.asarray((trunk.target_moment + self._legs) / (trunk.target_mass + self._controller.legs.leg_mass))

    @property
    def moved(self) -> float:
        """Horizontal distance of the modelled centre of mass from the plan's [m]."""
        away = self._controller.rotation @ (self._current_lever() - self._lever())
        return float(np.hypot(away[0], away[1]))

    @property
    def com(self) -> Array:
        """The robot's modelled centre of mass now, (3,) [m], odometry frame."""
        return np.asarray(self._controller.position + self._controller.rotation @ self._current_lever())

    @property
    def _ground(self) -> float:
        """Height of the feet in stance [m]."""
        controller = self._controller
        return float(controller.feet[controller.stance, 2].mean())

    def least_margin(self, support: SupportPolygon, begin: float, end: float) -> float:
        """Least margin [m] of the planned centre of mass and zero-moment point in a polygon, over a time range [s]."""
        tau2 = (float(self.com[2]) - self._ground) / GRAVITY
        states = np.array([self.plan.at(time) for time in np.linspace(begin, end, self._settings.looks)])
        points = np.concatenate([states[:, 0], states[:, 0] - tau2 * states[:, 2]])
        return float(np.min(support.distances - points @ support.normals.T))

    def at(self, time: float) -> TrunkPose:
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

    def replan(self, time: float, phases: Sequence[SupportPhase], margin: float, rest: float) -> None:
        """Plans the centre of mass again, with the present trunk model from the present reference; see `plan_com`."""
        now = self.at(time)
        trunk = self._controller.trunk
        self._mass, self._moment = trunk.target_mass, trunk.target_moment
        com = now.position + now.rotation @ self._lever()
        start = self.plan.at(time).copy()
        start[0] = com[:2]
        self.plan = plan_com(time, start, phases, float(com[2]) - self._ground, margin, rest)

    def follow_ground(self, time: float, heading: float, duration: float) -> None:
        """Turns the trunk parallel to the ground under the feet, with a heading [rad], and moves it to its height at
        the place where it is going, within a duration [s]. Each call follows half of a change of inclination.
        """
        plane = GroundPlane.of(self._controller.feet)
        normal = self.normal + self._settings.follows * (plane.normal - self.normal)
        self.normal = normal / np.linalg.norm(normal)
        way = self.plan.at(time + duration)[0] - self.plan.at(time)[0]
        height = plane.at(self.at(time).position[:2] + way) + self._height
        goal = TrunkPose(np.array([0.0, 0.0, height]), facing(self.normal, heading))
        self._pose = Move(self._pose.at(time), goal, time, duration)


def _determinants(jacobians: Array) -> Array:
    return np.asarray(np.abs(np.linalg.det(jacobians)))
