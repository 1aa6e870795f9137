"""Feet and their forces at the instants of a log, computed once for all checks.

Fault hypotheses exchange legs, turn signs of joints or rotate the IMU, so most of what they change a leg to has been
computed for another hypothesis before: `Known` keeps it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from stadera.body.statics import LegModel
from stadera.checks.instants import Instants
from stadera.constants import GRAVITY
from stadera.robot.model import Robot
from stadera.trunk.standing.vertical import vertical_by_forces
from stadera.types import Array

Result = TypeVar("Result")


class LegStates(NamedTuple):
    """State of legs at some instants, trunk frame; components first and instants last."""

    contact: Array  # (3, 4, instants) [m], points of contact
    speed: Array  # (3, 4, instants) [m/s], of the points of contact relative to the trunk
    torque: Array  # (4, 3, instants) [N·m], required by the legs' weight, by joint
    to_force: Array  # (3, 4, 3, instants) [1/m], J^-T
    moment: Array  # (3, 4, instants) [kg·m], first moments


_LEG_AXIS = (1, 1, 0, 1, 1)
"""Axis of the legs in each of `LegStates`."""


class Known:
    """What was computed for other hypotheses on the same instants."""

    def __init__(self) -> None:
        self.legs: dict[tuple[int, bytes, bytes, bytes], LegStates] = {}
        self._poses: dict[tuple[Any, ...], LegStates] = {}
        self._found: dict[tuple[Any, ...], Any] = {}

    def states(self, model: LegModel, position: Array, rate: Array, specific_force: Array) -> LegStates:
        """The legs' states, each leg's from what they follow from; all four are computed if one is not known. The model
        is of one robot, the same at each call; position and rate are (instants, 4, 3) [rad, rad/s], by leg, the
        specific force (instants, 3) [m/s²], trunk axes.
        """
        felt = specific_force.tobytes()
        keys = tuple((k, position[:, k].tobytes(), rate[:, k].tobytes(), felt) for k in range(4))
        if keys in self._poses:
            return self._poses[keys]
        if all(key in self.legs for key in keys):
            columns = zip(*(self.legs[key] for key in keys), strict=True)
            return LegStates(*(np.concatenate(legs, axis) for legs, axis in zip(columns, _LEG_AXIS, strict=True)))
        found = self._poses[keys] = _states(model, position, rate, specific_force)
        for k, key in enumerate(keys):
            own = slice(k, k + 1)
            self.legs[key] = LegStates(
                *(x[:, own] if axis else x[own] for x, axis in zip(found, _LEG_AXIS, strict=True))
            )
        return found

    def once(self, make: Callable[..., Result], *given: NDArray[Any] | float) -> Result:
        """The result of a function of arrays and numbers, computed at the first call with these."""
        key = (make, *(x.tobytes() if isinstance(x, np.ndarray) else x for x in given))
        if key not in self._found:
            self._found[key] = make(*given)
        return cast(Result, self._found[key])


def _states(legs: LegModel, position: Array, rate: Array, specific_force: Array) -> LegStates:
    statics = legs.statics(position, _unit(specific_force))
    speed = (statics.jacobian * rate.transpose(1, 2, 0)).sum(axis=2)
    return LegStates(statics.contact, speed, statics.torque(specific_force), statics.to_force, statics.moment)


@dataclass(frozen=True, eq=False)
class Footing:
    """Kinematics and forces of the legs from encoders and torques, trunk frame; legs in the robot's order, joints of
    `blocks` in the tree's.

    The forces are those of legs at rest under the actual specific force (`LegModel.forces_at_rest`): the effect of the
    legs' accelerations cancels over steps, and is zero at rest. `known` is what was computed for the same instants
    under other hypotheses.
    """

    robot: Robot
    blocks: Instants
    known: Known = field(default_factory=Known)

    def under(self, change: Callable[[Instants], Instants]) -> Self:
        """The footing at the same instants, of changed values."""
        return replace(self, blocks=change(self.blocks))

    @property
    def legs(self) -> LegModel:
        """The model of the legs."""
        return LegModel.of(self.robot)

    @cached_property
    def specific_force(self) -> Array:
        """(instants, 3) [m/s²]; without an IMU along the total contact force."""
        b = self.blocks
        if b.specific_force is not None:
            return b.specific_force
        still = np.zeros_like(b.position)
        return GRAVITY * vertical_by_forces(self.robot, b.position, still, b.effort)[0]

    @cached_property
    def up(self) -> Array:
        """(instants, 3), unit vectors along the specific force."""
        return _unit(self.specific_force)

    @cached_property
    def states(self) -> LegStates:
        """State of the legs."""
        columns, b = self.legs.columns, self.blocks
        return self.known.states(self.legs, b.position[:, columns], b.rate[:, columns], self.specific_force)

    @cached_property
    def forces(self) -> Array:
        """Force of the ground on the feet, (3, 4, instants) [N]."""
        effort = self.blocks.effort[:, self.legs.columns].transpose(1, 2, 0)
        return np.asarray((self.states.to_force * (self.states.torque - effort)).sum(axis=2))

    @property
    def force(self) -> Array:
        """Force of the ground on the feet, (instants, 4, 3) [N]."""
        return self.forces.transpose(2, 1, 0)

    @property
    def contact(self) -> Array:
        """Contact points, (instants, 4, 3) [m]."""
        return self.states.contact.transpose(2, 1, 0)


def _unit(vectors: Array) -> Array:
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(size > 0, size, 1.0))
