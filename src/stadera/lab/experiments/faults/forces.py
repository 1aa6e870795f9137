"""External forces other than a load, relative to the robot's weight, applied in the simulation of the log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

from stadera.constants import GRAVITY
from stadera.lab.plant import OutsideForce, Tray
from stadera.robot.model import Robot

_ALIKE = "a vertical force at one place is what a weight at that place does to a robot that is hardly accelerated"


@dataclass(frozen=True)
class Force:
    """An external force."""

    make: Callable[[Robot, float], OutsideForce]  # makes the force for a robot and a start time [s]
    hidden: str = ""  # why a log cannot distinguish it from a load, if so; empty otherwise


def _acting(
    share: float,
    direction: tuple[float, float, float],
    place: tuple[float, float],
    lasts: float,
    gives: float,
    robot: Robot,
    begin: float,
) -> OutsideForce:
    """A force of this share of the weight for `lasts` [s] at a place on the back, in half sizes of the tray. Over a
    distance `gives`, in half lengths of the tray, it drops to zero or doubles; 0 for a constant one.
    """
    tray, size = Tray.of(robot), share * robot.mass * GRAVITY
    x, y = tray.centre[:2] + tray.half_size[:2] * place
    stiffness = size / (gives * float(tray.half_size[0])) if gives else 0.0
    at = (float(x), float(y), float(tray.top))
    return OutsideForce(size, direction, at, begin, begin + lasts, stiffness)


_EVER = float("inf")

FORCES: Mapping[str, Force] = MappingProxyType(
    {
        "a person pushes from the side": Force(partial(_acting, 0.10, (0.0, 1.0, 0.0), (0.0, -1.0), 1.5, 0.0)),
        "a person pushes from behind": Force(partial(_acting, 0.10, (1.0, 0.0, 0.0), (-1.0, 0.0), _EVER, 0.0)),
        "a person carries a tenth": Force(partial(_acting, 0.10, (0.0, 0.0, 1.0), (1.0, 0.0), _EVER, 0.0), _ALIKE),
        "a rope to the rear": Force(partial(_acting, 0.10, (-1.0, 0.0, 0.3), (-1.0, 0.0), _EVER, 2.0)),
        "leaning on a wall": Force(partial(_acting, 0.08, (0.0, 1.0, 0.0), (0.0, -1.0), _EVER, 0.1)),
    }
)
"""By name."""
