"""Options shared by several commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, is_dataclass
from functools import cached_property, wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from stadera.cli import parse
from stadera.cli.terminal import progress, show
from stadera.errors import RecordingError

if TYPE_CHECKING:
    from stadera.fleet.pool import Pool
    from stadera.limits import Limits
    from stadera.logs.topics import LogFile, ReadOptions, Topics
    from stadera.robot import Robot
    from stadera.trunk.memory import Memory
    from stadera.weigh.settings import Watch


def option(metavar: str, help_: str, *names: str, **settings: Any) -> Any:
    """An option with a value; `names` where it is not its parameter's."""
    return typer.Option(*names, metavar=metavar, help=help_, **settings)


def flag(help_: str, *names: str, **settings: Any) -> Any:
    """An option without a value."""
    return typer.Option(*names, help=help_, **settings)


def argument(metavar: str, help_: str) -> Any:
    """An argument by its place."""
    return typer.Argument(metavar=metavar, help=help_)


def refuse(why: str, given: Mapping[str, object]) -> None:
    """Raises BadParameter for the first of these options, by their names, that was given: it would do nothing."""
    for name, value in given.items():
        if value is not None and value is not False:
            raise typer.BadParameter(why, param_hint=name)


RobotName = Annotated[str, option("R", "A robot's name, or a path to a URDF, xacro or MJCF.", "--robot")]
RobotOfLog = Annotated[
    str | None, option("R", "A robot's name, or a path to a URDF, xacro or MJCF [default: as the log says].", "--robot")
]
LegsFile = Annotated[
    Path | None, option("F.json", "Links, friction, rotor inertia, torque offsets from `identify --json`.", "--legs")
]
Method = Annotated[
    str | None,
    option(
        "walking|standing|contact|orientation|poses|combined|FILE.py:NAME",
        "walking: any motion; FILE.py:NAME: your own estimator; others: at rest, standing, poses and combined without "
        "an IMU too [default: walking with an IMU and 50 samples a second, else standing].",
    ),
]
Feet = Annotated[
    str | None, option("A,B,...", "Links or frames of the feet, one a leg, where the model does not tell.", "--feet")
]
Tare = Annotated[str | None, option("T0:T1|LOG", "Time [s] in LOG, or another log, without the payload.")]
Weight = Annotated[
    str | None, option("KG[±KG]", "The robot's mass on a scale, at the tare, else at the log's beginning.")
]
Stiffness = Annotated[str | None, option("KX,KY,KZ", "Stiffness of the trunk controller [N·m/rad], for 'orientation'.")]
ImuFrame = Annotated[
    str | None, option("NAME", "Frame of the IMU's values [default: the log's own, else the model's].")
]
JointTopic = Annotated[str | None, option("TOPIC", "Topic to read, if several have joints.", "--joint-topic")]
ImuTopic = Annotated[str | None, option("TOPIC", "Topic to read, if there are several IMUs.")]
MemoryFile = Annotated[
    Path | None,
    option("F.json", "The robot as known from earlier logs; read if it is there, and written anew.", "--memory"),
]
JsonFile = Annotated[Path | None, option("F", "Write the result as JSON.", "--json")]
ReportFile = Annotated[Path | None, option("F.html", "Write an HTML report; F.pdf is printed by Chromium.", "--report")]
Force = Annotated[bool, flag("Give a result even if it is not to be trusted, every figure marked.", "--force")]
Units = Annotated[
    str | None, option("deg,ms,...", "Units of the log: deg, deg/s, gyro=deg/s, g, ms ...; 200Hz if it has no time.")
]
GearRatio = Annotated[
    str | None, option("RATIO", "Torques are the motors': times this; or N,N,N for hip, thigh, calf.", "--gear")
]
Fix = Annotated[bool, flag("Correct unambiguous faults of the log (units, signs, orders), with a note.", "--fix")]
LimitValues = Annotated[
    list[str] | None,
    option(
        "NAME=VALUE",
        "Raise a limit for reading files that an error names: unpacked, seconds, columns ...; repeatable.",
        "--limit",
    ),
]


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """The command with each parameter that is a dataclass of options replaced by the options of that dataclass."""
    parameters = list(signature(command, eval_str=True).parameters.values())
    groups = {p.name: cast(type[Any], p.annotation) for p in parameters if is_dataclass(p.annotation)}
    single = {p.name: p.replace(kind=Parameter.KEYWORD_ONLY) for p in parameters if p.name not in groups}
    of_group = {name: signature(group, eval_str=True).parameters for name, group in groups.items()}
    options = single | {
        p.name: p.replace(kind=Parameter.KEYWORD_ONLY) for group in of_group.values() for p in group.values()
    }

    @wraps(command)
    def run(**given: Any) -> None:
        made = {name: group(**{key: given.pop(key) for key in of_group[name]}) for name, group in groups.items()}
        command(**given, **made)

    run.__signature__ = Signature(list(options.values()))  # type: ignore[attr-defined]
    run.__annotations__ = {name: option.annotation for name, option in options.items()}
    return run


@dataclass(frozen=True)
class PoolOptions:
    """Options for the processes that do the work."""

    workers: Annotated[
        int | None, option("N", "Processes on this machine; 0: this one [default: one per core].", "--workers", min=0)
    ] = None
    scheduler: Annotated[
        str | None, option("tcp://HOST:8786", "A Dask scheduler whose workers are used.", "--scheduler")
    ] = None

    def pool(self, **settings: Any) -> Pool:
        """The pool, with other settings of it. Raises BadParameter if both are given."""
        if self.scheduler is not None and self.workers is not None:
            raise typer.BadParameter("a scheduler has its own workers", param_hint="--workers")
        from stadera.fleet.pool import Pool

        return Pool(self.workers, self.scheduler, **settings)


@dataclass(frozen=True)
class ModelOptions:
    """Options for understanding a robot's model."""

    feet: Feet = None
    trunk: Annotated[str | None, option("LINK", "Link of the trunk, where a URDF does not tell.")] = None

    def load(self, robot: str, limits: Limits) -> Robot:
        """The robot of a name or file; raises as `load_robot`."""
        from stadera.robot import load_robot

        return load_robot(robot, limits, parse.names(self.feet) or (), self.trunk)


def limits_of(given: Sequence[str] | None) -> Limits:
    """Parses all `--limit` options. Raises as `Limits.parse`."""
    from stadera.limits import Limits

    return Limits.parse(given or ())


@dataclass(frozen=True)
class LogOptions:
    """Options for reading logs, the same for all logs of the command."""

    joint_topic: JointTopic = None
    imu_topic: ImuTopic = None
    columns: Annotated[
        str | None,
        option(
            "MAP.toml|PRESET",
            "Map of a table's columns, or a preset [default: by their names]. "
            "`stadera inspect LOG --columns` writes a map.",
        ),
    ] = None
    units: Units = None
    pd: Annotated[
        str | None, option("KP,KD", "Compute torques from desired positions; hip, thigh, calf: KP,KD/KP,KD/...", "--pd")
    ] = None
    gear: GearRatio = None
    fix: Fix = False
    limit: LimitValues = None

    @cached_property
    def topics(self) -> Topics:
        """The topics to read."""
        from stadera.logs.topics import Topics

        return Topics(self.joint_topic, self.imu_topic)

    @cached_property
    def reading(self) -> ReadOptions:
        """The other options, parsed; raises as `ReadOptions.of`."""
        from stadera.logs.topics import ReadOptions

        return ReadOptions.of(self.columns, self.units, self.pd, limits_of(self.limit), self.gear)

    def log(self, path: Path) -> LogFile:
        """The log at a path, to be read with these instructions."""
        from stadera.logs.topics import LogFile

        return LogFile(path, self.topics, self.reading)

    def tare(self, given: str | None) -> tuple[float, float] | LogFile | None:
        """The range of time, or the log, of a `--tare`. Raises BadParameter."""
        found = None if given is None else parse.tare(given)
        return self.log(found) if isinstance(found, Path) else found

    def robot(self, given: str | None, path: Path) -> str:
        """The robot given, else the one that a log's metadata name, else the only one with its joints, which is shown.
        Raises RecordingError: neither; lists those that have the joints.
        """
        from stadera.fleet.jobs import robot_named_in
        from stadera.logs.reader import read_head
        from stadera.robot.load import guessed

        if given is not None:
            return given
        head = read_head(self.log(path))
        try:
            return robot_named_in(path)
        except RecordingError:
            with progress() as watch:
                name = guessed(head.joints, str(path), watch)
        show(f"robot {name}, by the joints of {path}")
        return name


@dataclass(frozen=True)
class RobotOptions(ModelOptions):
    """Options for the robot that is weighed."""

    weight: Weight = None
    memory: MemoryFile = None
    at: Annotated[
        str | None,
        option("LINK", "Link or frame on which the payload is, such as a hand's [default: the likeliest place]."),
    ] = None
    legs: LegsFile = None
    force: Force = False
    imu_frame: ImuFrame = None
    view: Annotated[bool, flag("Show the robot and its estimates in Rerun.", "--view")] = False
    rrd: Annotated[Path | None, option("F.rrd", "Write a recording for Rerun.", "--rrd")] = None

    @property
    def on_scale(self) -> tuple[float, float] | None:
        """The weight, parsed: mass and standard deviation [kg]. Raises BadParameter."""
        return None if self.weight is None else parse.weight(self.weight)

    def model(self, name: str, limits: Limits) -> Robot:
        """Loads the robot, with identified legs if given; with `force` also if these are not to be trusted."""
        from stadera.identify.schema import with_identified_legs

        robot = self.load(name, limits)
        return robot if self.legs is None else with_identified_legs(robot, self.legs, self.force)

    @contextmanager
    def watching(self, robot: Robot) -> Iterator[Watch | None]:
        """Yields a viewer's `watch`, None if none was requested; the file is complete when the block ends without an
        error.
        """
        if not self.view and self.rrd is None:
            yield None
            return
        from stadera.files import written_together
        from stadera.live.view import Viewer

        with (
            written_together([] if self.rrd is None else [self.rrd]) as drafts,
            Viewer(robot, spawn=self.view, save=drafts[0] if drafts else None) as viewer,
        ):
            yield viewer.watch


def remembered(path: Path | None, robot: Robot) -> Memory | None:
    """The memory in a file, see `Memory.read`; None if none is asked for."""
    from stadera.trunk.memory import Memory

    return None if path is None else Memory.read(path, robot)
