"""Evaluates a run from ground truth: falls of any robot, height of the trunk, and margin of the centre of mass."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from stadera.constants import GRAVITY, ROUNDING
from stadera.lab.control.com_plan import PlanError, SupportPolygon
from stadera.lab.control.legs import LegDynamics
from stadera.lab.plant.plant import Plant
from stadera.types import Array, Bools


@dataclass(frozen=True)
class FallLimits:
    """Criteria for a fall, and for a supporting foot."""

    tilt: float = float(np.deg2rad(45.0))  # of the trunk above which the robot has toppled [rad]
    # share of the trunk's initial height above the ground below which the robot has fallen; it also has if its trunk or
    # a hip touches the ground
    lowest: float = 0.3
    # tilt up to which knees may touch the ground [rad]
    kneeling: float = float(np.deg2rad(20.0))
    carries: float = 0.01  # least share of the weight on a foot of the support polygon


@dataclass(frozen=True)
class Fall:
    """A fall: its time [s], and its description."""

    time: float
    how: str


class Falls:
    """Tells from the truth of a plant on its feet when the robot has fallen; `fall` is None while it has not."""

    limits = FallLimits()

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.fall: Fall | None = None
        self._height = self.height()

    def look(self) -> None:
        """Evaluates the plant."""
        if self.fall is None and (how := self._fallen(self.height(), self.tilt())):
            self.fall = Fall(self.plant.time, how)

    def height(self) -> float:
        """Height of the trunk's origin above the ground [m]."""
        return float(self.plant.terrain.clearance(self.plant.state.position))

    def tilt(self) -> float:
        """Tilt of the trunk from the ground's normal [rad]."""
        return float(np.arccos(np.clip(self.plant.state.rotation[:, 2] @ self.plant.terrain.normal, -1.0, 1.0)))

    def _fallen(self, height: float, tilt: float) -> str:
        touching, limits = self.plant.on_ground, self.limits
        if touching and not (touching.endswith("knee") and tilt <= limits.kneeling):
            return f"the {touching} touched the ground"
        if height < limits.lowest * self._height:
            return "the trunk is on the ground"
        return f"the trunk tilted by more than {np.rad2deg(limits.tilt):.0f}°" if tilt > limits.tilt else ""


class WalkMonitor(Falls):
    """Evaluates a walk from the truth of a plant on its feet, every tenth period."""

    every = 10  # periods between two evaluations

    def __init__(self, plant: Plant) -> None:
        super().__init__(plant)
        self._legs = LegDynamics(plant.robot)
        self._effort = np.array([plant.robot.limits[joint].effort for joint in plant.robot.tree.joints])
        self._periods, self._rows = 0, list[tuple[float, float, Array, float, Bools]]()

    @property
    def history(self) -> dict[str, Any]:
        """Of all k evaluations: time (k,) [s], margin (k,) [m] of the true centre of mass, position (k, 3) [m] of the
        trunk's origin in the world, its height (k,) [m] above the ground, and limited (k, n) bool, joints at their
        torque limit.
        """
        names = ("time", "margin", "position", "height", "limited")
        return dict(zip(names, map(np.array, zip(*self._rows, strict=True)), strict=True))

    def look(self) -> None:
        """Evaluates the plant, if it is due."""
        self._periods += 1
        if self._periods % self.every == 0:
            state = self.plant.state
            self._rows.append((state.time, self.margin(), state.position, self.height(), self.at_limit()))
            super().look()

    def at_limit(self) -> Bools:
        """Joints at their torque limit now, (n,) bool."""
        return np.asarray(np.abs(self.plant.effort) >= (1.0 - ROUNDING) * self._effort)

    def com(self) -> Array:
        """True centre of mass of the whole robot with its load, (3,) [m], world."""
        state, trunk = self.plant.state, self.plant.truth()
        zero = np.zeros(3)
        legs = self._legs.at(state.joint_position, np.zeros(len(state.joint_position)), zero, zero)
        mass = trunk.mass + self._legs.leg_mass
        return np.asarray(state.position + state.rotation @ ((trunk.first_moment + legs.moment) / mass))

    def carrying(self) -> Bools:
        """Loaded feet now, which form the support polygon, (4,) bool."""
        least = self.limits.carries * self.plant.robot.mass * GRAVITY
        return np.asarray(self.plant.state.foot_force @ self.plant.terrain.normal > least)

    def margin(self) -> float:
        """Margin of the true centre of mass in the polygon of the loaded feet [m]; NaN with fewer than three."""
        state, carry = self.plant.state, self.carrying()
        if carry.sum() < 3:
            return float("nan")
        try:
            return SupportPolygon.of(state.contact_point[carry]).margin(self.com())
        except PlanError:
            return float("nan")
