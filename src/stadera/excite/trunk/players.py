"""Scripts that play a weighing routine on a robot: Unitree's sport mode, Spot's body control, a ROS 2 topic.

Each is one Python file with the motion in it, which needs nothing of this package. It moves slowly into the motion,
limits the rate of every value, and on any fault or interruption returns to the stance
and stops. A new interface is a template in `players/` and an entry here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from stadera.errors import IdentificationError, UnknownNameError
from stadera.excite.trunk.planted import AXES

if TYPE_CHECKING:
    from stadera.excite.trunk.result import Routine


@dataclass(frozen=True)
class Interface:
    """What a robot's own body control takes.

    Attributes:
        summary: one line on what plays the motion.
        axes: coordinates of the trunk that it takes.
        rate: of commands [Hz].
    """

    summary: str
    axes: tuple[str, ...]
    rate: float


_TURNS = ("roll", "pitch", "yaw")

INTERFACES: Mapping[str, Interface] = MappingProxyType(
    {
        "unitree": Interface("sport mode of a Go2 or B2 by unitree_sdk2py", (*_TURNS, "z"), 20.0),
        "spot": Interface("body control of a Spot by bosdyn-client", (*_TURNS, "z"), 10.0),
        "ros2": Interface("geometry_msgs/Pose on the topic body_pose", AXES, 50.0),
    }
)
"""By name."""


def interface_named(name: str) -> Interface:
    """The interface of that name. Raises UnknownNameError: there is none."""
    if name not in INTERFACES:
        raise UnknownNameError("interface", name, INTERFACES)
    return INTERFACES[name]


def player(routine: Routine, name: str) -> str:
    """The text of a script that plays a routine over the interface of that name.

    Raises:
        UnknownNameError: no such interface.
        IdentificationError: the motion has a coordinate that the interface does not take.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    interface = interface_named(name)
    reference = routine.path.sample(interface.rate)
    moving = [axis for axis, peak in zip(AXES, np.abs(reference.position).max(axis=0), strict=True) if peak > 0.0]
    if left := [axis for axis in moving if axis not in interface.axes]:
        raise IdentificationError(
            f"{name} does not move {', '.join(left)}; design with axes {', '.join(interface.axes)}"
        )
    columns = [AXES.index(axis) for axis in interface.axes]
    speed = np.abs(reference.motion.velocity[:, columns]).max(axis=0)
    folder = Path(__file__).with_name("players")
    environment = Environment(loader=FileSystemLoader(folder), undefined=StrictUndefined, keep_trailing_newline=True)
    rows = ["    (" + ", ".join(f"{v:.4f}" for v in row) + ")," for row in reference.position[:, columns]]
    return environment.get_template(f"{name}.py.j2").render(
        robot=routine.robot.name,
        seconds=routine.settings.seconds,
        rate=interface.rate,
        axes=interface.axes,
        fastest=", ".join(f"{1.2 * v + 0.01:.3f}" for v in speed),
        poses="\n".join(rows),
    )
