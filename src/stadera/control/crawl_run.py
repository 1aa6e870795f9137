"""Watches a walking robot with the truth: how far its centre of mass is inside its support, and whether it fell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.control.planner_support import PlanError, SupportPolygon
from stadera.control.stand import TestBed
from stadera.control.trunk import ControlError
from stadera.robot.dynamics import LegDynamics
from stadera.sim.plant import Plant, SimulationError

Array = NDArray[np.float64]

_TOPPLED = np.deg2rad(45.0)
_LOWEST = 0.3  # of the trunk's height over the ground at the start, below which the robot lies
_CARRIES = 0.01  # share of the weight that a foot of the support polygon carries at least


@dataclass(frozen=True)
class Fall:
    """A fall: when [s], and how."""

    time: float
    how: str


class WalkJudge:
    """Judges a walk by the plant's truth, every so many periods.

    Args:
        plant: reset, on its feet.
        every: periods from one look to the next.

    Attributes:
        fall: None while it has not fallen.
    """

    def __init__(self, plant: Plant, every: int = 10) -> None:
        self.plant, self.every = plant, every
        self.fall: Fall | None = None
        self._legs = LegDynamics(plant.robot)
        self._rows: list[tuple[float, float, float, Array]] = []
        self._height = self._clearance()
        self._periods = 0

    @property
    def times(self) -> Array:
        """[s], of the looks so far."""
        return np.array([row[0] for row in self._rows])

    @property
    def margins(self) -> Array:
        """[m], of the true centre of mass; NaN with fewer than three feet that carry."""
        return np.array([row[1] for row in self._rows])

    @property
    def tilts(self) -> Array:
        """[rad], from the ground's normal."""
        return np.array([row[2] for row in self._rows])

    @property
    def positions(self) -> Array:
        """[m], of the trunk's origin, world."""
        return np.array([row[3] for row in self._rows]).reshape(-1, 3)

    def look(self) -> None:
        """Looks at the plant, if it is time to."""
        self._periods += 1
        if self._periods % self.every:
            return
        state = self.plant.state
        tilt = float(np.arccos(np.clip(state.rotation[:, 2] @ self.plant.terrain.normal, -1.0, 1.0)))
        self._rows.append((state.time, self.margin(), tilt, state.position))
        if self.plant.trunk_on_ground or self._clearance() < _LOWEST * self._height:
            self.fall = self.fall or Fall(state.time, "the trunk touched the ground")
        elif tilt > _TOPPLED:
            self.fall = self.fall or Fall(state.time, f"the trunk tilted by more than {np.rad2deg(_TOPPLED):.0f}°")

    def _clearance(self) -> float:
        """Of the trunk's origin over the ground [m]."""
        return float(self.plant.terrain.clearance(self.plant.state.position))

    def com(self) -> Array:
        """The whole robot's true centre of mass with its load, (3,) [m], world."""
        state, trunk = self.plant.state, self.plant.truth()
        zero = np.zeros(3)
        legs = self._legs.at(state.joint_position, np.zeros(len(state.joint_position)), zero, zero)
        mass = trunk.mass + self._legs.leg_mass
        return np.asarray(state.position + state.rotation @ ((trunk.first_moment + legs.moment) / mass))

    def margin(self) -> float:
        """Of the true centre of mass inside the feet that carry now [m]; NaN with fewer than three of them."""
        state = self.plant.state
        carry = state.foot_force @ self.plant.terrain.normal > _CARRIES * self.plant.robot.mass * 9.81
        if carry.sum() < 3:
            return float("nan")
        try:
            return SupportPolygon.of(state.contact_point[carry]).margin(self.com())
        except PlanError:
            return float("nan")


def walk(bed: TestBed, seconds: float, judge: WalkJudge) -> Fall | None:
    """Steps the test-bed until that much time [s] has passed or the robot has fallen; returns how it fell, if it did.

    A controller or a simulation that breaks down counts as a fall.
    """
    for _ in range(round(seconds / bed.plant.timestep)):
        try:
            bed.step()
        except (ControlError, PlanError, SimulationError) as error:
            judge.fall = judge.fall or Fall(bed.plant.time, str(error))
        judge.look()
        if judge.fall is not None:
            break
    return judge.fall
