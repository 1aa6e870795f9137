"""Joints outside the legs: held where they are in the model, or swung."""

import numpy as np
import pinocchio as pin

from stadera.lab.control.reference import eased
from stadera.lab.pinocchio import pinocchio_model
from stadera.robot.model import Robot
from stadera.types import Array


class Arms:
    """Motion of the joints of a whole robot that belong to no leg: x(t) = e(t) A sin(2π f t), each with its own f.

    `first` is the first of them in the tree; `amplitude` A [rad] is zero for a torso's.
    """

    bandwidth = 25.0  # natural frequency of their tracking, damped critically [rad/s]
    slowest, fastest = 0.25, 0.6  # of the swinging [Hz]
    torso = 0.2  # share of the robot's mass beyond a joint from which it is a torso's, which does not swing
    ease = 1.0  # time in which the motion grows [s]

    def __init__(self, robot: Robot, amplitude: float = 0.0) -> None:
        tree = robot.tree
        self.first = sum(len(leg.joints) for leg in robot.legs)
        count = len(tree.joints) - self.first
        masses = [robot.inertias[link].mass for link in tree.links[1:]]
        carried = [sum(m for k, m in enumerate(masses) if self.first + j in tree.ancestors(k)) for j in range(count)]
        swinging = np.array(carried) < self.torso * robot.mass
        self._amplitude = amplitude * swinging
        # the golden ratio spreads the frequencies evenly, and no two joints alike
        share = (np.arange(count) * 0.5 * (np.sqrt(5.0) - 1.0)) % 1.0
        self._omega = 2.0 * np.pi * (self.slowest + share * (self.fastest - self.slowest))

    def at(self, time: float) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations at a time [s], (k,) each."""
        late, w, amplitude = max(time, 0.0), self._omega, self._amplitude
        e, e_1, e_2 = eased(min(late, self.ease), self.ease)
        s, c = amplitude * np.sin(w * late), amplitude * w * np.cos(w * late)
        return e * s, e * c + e_1 * s, -e * w * w * s + 2.0 * e_1 * c + e_2 * s

    def accelerations(self, time: float, position: Array, velocity: Array) -> Array:
        """Accelerations (k,) that return to the motion, from what is measured (k,)."""
        q, v, a = self.at(time)
        w = self.bandwidth
        return np.asarray(a + w * w * (q - position) + 2.0 * w * (v - velocity))


class ArmTorques:
    """Torques of the arms of a robot whose legs another controller moves: inverse dynamics on a trunk as measured."""

    def __init__(self, robot: Robot, arms: Arms) -> None:
        self.arms, self._model = arms, pinocchio_model(robot)
        self._model.gravity = pin.Motion.Zero()
        self._data = self._model.createData()

    def at(
        self, time: float, position: Array, velocity: Array, angular_velocity: Array, specific_force: Array
    ) -> Array:
        """Torques (k,) [N·m], from all joints' positions and velocities (n,) and the trunk's motion, in its axes."""
        first, model = self.arms.first, self._model
        q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        q[7:], v[3:6], v[6:], a[:3] = position, angular_velocity, velocity, specific_force
        a[6 + first :] = self.arms.accelerations(time, position[first:], velocity[first:])
        return np.asarray(pin.rnea(model, self._data, q, v, a)[6 + first :])
