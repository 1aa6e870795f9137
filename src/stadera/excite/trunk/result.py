"""Result of designing a weighing routine: the motion, and the error bars to expect from it.

Each player is one Python file with the motion in it, which needs nothing of this package. It moves slowly into the
motion, limits the rate of every value, and on any fault or interruption returns to the stance and stops. A new
interface is a template in `players/` and an entry here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from stadera.errors import IdentificationError, UnknownNameError
from stadera.excite.sinusoids import Sinusoids
from stadera.excite.trunk.planted import AXES, PayloadBars, Planted
from stadera.files import filled, save_text
from stadera.results import Result, data_frame, finite_or_none
from stadera.robot.model import Robot
from stadera.types import Array

if TYPE_CHECKING:
    from stadera.excite.trunk.design import RoutineSettings


@dataclass(frozen=True, eq=False, repr=False)
class Routine(Result):
    """A weighing routine: the robot does it without and with the load, which is weighed by the two logs."""

    robot: Robot  # the robot
    settings: RoutineSettings  # as requested
    path: Sinusoids  # of the trunk, in the coordinates `AXES`
    planted: Planted  # the motion at the table's rate, feet in place
    torque: Array  # (n,) largest torque of each joint [N·m], bare and with the heaviest load
    expected: PayloadBars  # error bars of a payload of `load` [kg] to expect from a log without and one with it
    load: float  # [kg]

    report = "stadera.report.excite.trunk"

    @property
    def peaks(self) -> Array:
        """Largest value of each of `AXES`, (6,) [rad, m]."""
        return np.asarray(np.abs(self.planted.pose).max(axis=0))

    @property
    def columns(self) -> dict[str, Array]:
        """The table to be played: time [s], the trunk's pose relative to the stance [rad, m], joints [rad, rad/s]."""
        planted, motion = self.planted, self.planted.motion
        trunk = {f"trunk.{axis}": planted.pose[:, k] for k, axis in enumerate(AXES)}
        joints = {}
        for k, joint in enumerate(self.robot.tree.joints):
            joints[f"{joint}.position"] = motion.position[:, k]
            joints[f"{joint}.velocity"] = motion.velocity[:, k]
        return {"time": planted.time, **trunk, **joints}

    def save_table(self, path: str | PathLike[str]) -> None:
        """Writes `columns` as .csv or .parquet, completely or not at all. Raises RecordingError: another suffix.
        StaderaError: the path cannot be written.
        """
        from stadera.logs.frames import write_columns

        write_columns(self.columns, path)

    def save_player(self, path: str | PathLike[str], interface: str) -> None:
        """Writes a script that plays the motion on a robot, see `stadera.excite.trunk.result.player`. Raises
        UnknownNameError: no such interface. StaderaError: the path cannot be written.
        """
        save_text(path, player(self, interface))

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        motion = self.planted.motion
        limits = [self.robot.limits[joint] for joint in self.robot.tree.joints]
        names = ("origins", "amplitudes", "frequencies", "phases", "starts")
        return {
            "robot": self.robot.name,
            "kind": "weighing routine",
            "duration": self.settings.seconds,
            "rate": self.settings.rate,
            "seed": self.settings.seed,
            "load": self.load,
            "expected": {"mass_std": self.expected.mass, "scale": self.expected.scale, "com_std": [*self.expected.com]},
            "peaks": dict(zip(AXES, self.peaks.tolist(), strict=True)),
            "joints": {
                joint: {
                    "position": [float(motion.position[:, k].min()), float(motion.position[:, k].max())],
                    "velocity": float(np.abs(motion.velocity[:, k]).max()),
                    "torque": float(self.torque[k]),
                    "torque_limit": finite_or_none(limits[k].effort),
                }
                for k, joint in enumerate(self.robot.tree.joints)
            },
            "sinusoids": {name: getattr(self.path, name).tolist() for name in names} | {"fade": self.path.fade},
            "units": {"duration": "s", "rate": "Hz", "load": "kg", "mass_std": "kg", "com_std": "m", "peaks": "rad, m"},
        }

    def to_dataframe(self) -> Any:
        """`columns` as a pandas DataFrame. Raises MissingExtraError: pandas is not installed."""
        return data_frame(self.columns)

    def __repr__(self) -> str:
        from stadera.report.excite.trunk import promise

        return f"Weighing routine of {self.robot.name}, {self.settings.seconds:g} s: {promise(self)}"


@dataclass(frozen=True)
class Interface:
    """What a robot's own body control takes."""

    axes: tuple[str, ...]  # coordinates of the trunk that it takes
    rate: float  # of commands [Hz]


_TURNS = ("roll", "pitch", "yaw")

INTERFACES: Mapping[str, Interface] = MappingProxyType(
    {"unitree": Interface((*_TURNS, "z"), 20.0), "spot": Interface((*_TURNS, "z"), 10.0), "ros2": Interface(AXES, 50.0)}
)
"""By name: sport mode of a Go2 or B2 by unitree_sdk2py, body control of a Spot by bosdyn-client, geometry_msgs/Pose on
the topic body_pose.
"""


def interface_named(name: str) -> Interface:
    """The interface of that name. Raises UnknownNameError: there is none."""
    if name not in INTERFACES:
        raise UnknownNameError("interface", name, INTERFACES)
    return INTERFACES[name]


def player(routine: Routine, name: str) -> str:
    """The text of a script that plays a routine over the interface of that name. Raises UnknownNameError: no such
    interface. IdentificationError: the motion has a coordinate that the interface does not take.
    """
    interface = interface_named(name)
    reference = routine.path.sample(interface.rate)
    moving = [axis for axis, peak in zip(AXES, np.abs(reference.position).max(axis=0), strict=True) if peak > 0.0]
    if left := [axis for axis in moving if axis not in interface.axes]:
        raise IdentificationError(
            f"{name} does not move {', '.join(left)}; design with axes {', '.join(interface.axes)}"
        )
    columns = [AXES.index(axis) for axis in interface.axes]
    speed = np.abs(reference.velocity[:, columns]).max(axis=0)
    rows = ["    (" + ", ".join(f"{v:.4f}" for v in row) + ")," for row in reference.position[:, columns]]
    return filled(
        Path(__file__).with_name("players") / f"{name}.py.j2",
        robot=routine.robot.name,
        seconds=routine.settings.seconds,
        rate=interface.rate,
        axes=interface.axes,
        fastest=", ".join(f"{1.2 * v + 0.01:.3f}" for v in speed),
        poses="\n".join(rows),
    )
