"""Options shared by several commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stadera.cli.gate import GatedCommand

if TYPE_CHECKING:
    from stadera.limits import Limits
    from stadera.logs.reading import Reading
    from stadera.logs.topics import LogFile, Topics

RobotName = Annotated[
    str, typer.Option("--robot", metavar="R", help="A robot's name, or a path to a URDF or MJCF.", show_default=False)
]
RobotOfLog = Annotated[
    str | None,
    typer.Option(
        "--robot", metavar="R", help="A robot's name, or a path to a URDF or MJCF [default: as the log says]."
    ),
]
JsonFile = Annotated[Path | None, typer.Option("--json", metavar="F", help="Write the result as JSON.")]
ReportFile = Annotated[
    Path | None,
    typer.Option("--report", metavar="F.html", help="Write an HTML report; F.pdf is printed by Chromium."),
]
FigureFiles = Annotated[
    list[str] | None,
    typer.Option(
        "--figure",
        metavar="[NAME=]F.pdf",
        help="Draw a figure (.pdf, .png or .svg), the main one or the named one; repeatable.",
    ),
]
LatexFile = Annotated[Path | None, typer.Option("--latex", metavar="F.tex", help="Write the tables as LaTeX.")]
Force = Annotated[
    bool, typer.Option("--force", help="Give a result even if it is not to be trusted, every figure marked.")
]
JointTopic = Annotated[
    str | None, typer.Option("--joint-topic", metavar="TOPIC", help="Topic to read, if a log has several of joints.")
]
ImuTopic = Annotated[
    str | None, typer.Option("--imu-topic", metavar="TOPIC", help="Topic to read, if a log has several IMUs.")
]

View = Annotated[bool, typer.Option("--view", help="Show the robot and its estimates in Rerun.")]
RrdFile = Annotated[Path | None, typer.Option("--rrd", metavar="F.rrd", help="Write a recording for Rerun.")]


Columns = Annotated[
    str | None,
    typer.Option(
        metavar="MAP.toml|PRESET",
        help="Map of a table's columns, or a preset [default: by their names]. "
        "`stadera inspect LOG --columns` writes a map.",
    ),
]
Units = Annotated[
    str | None,
    typer.Option(
        metavar="deg,ms,...", help="Units of the log: deg, deg/s, gyro=deg/s, g, ms ...; 200Hz if it has no time."
    ),
]
PdGains = Annotated[
    str | None,
    typer.Option(
        "--pd", metavar="KP,KD", help="Compute torques from desired positions; hip, thigh, calf: KP,KD/KP,KD/..."
    ),
]
GearRatio = Annotated[
    str | None,
    typer.Option("--gear", metavar="RATIO", help="Torques are the motors': times this; or N,N,N for hip, thigh, calf."),
]
Fix = Annotated[
    bool, typer.Option("--fix", help="Correct unambiguous faults of the log (units, signs, orders), with a note.")
]
LimitValues = Annotated[
    list[str] | None,
    typer.Option(
        "--limit",
        metavar="NAME=VALUE",
        help="Raise a limit for reading files that an error names: unpacked, seconds, columns ...; repeatable.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers", metavar="N", min=0, help="Processes on this machine; 0: this one [default: one per core]."
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="tcp://HOST:8786", help="A Dask scheduler whose workers are used."),
]


def check_workers(workers: int | None, scheduler: str | None) -> None:
    """Raises BadParameter if both are given."""
    if scheduler is not None and workers is not None:
        raise typer.BadParameter("a scheduler has its own workers", param_hint="--workers")


TEMPLATE = "-"
"""Value of `--columns` if none is given: write a map of the columns."""


class ColumnsMayStandAlone(GatedCommand):
    """A command whose option `--columns` needs no value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Replaces `--columns` without a value by `--columns -`."""
        given: list[str] = []
        for argument, follower in zip(args, [*args[1:], "--"], strict=True):
            given += [argument, TEMPLATE] if argument == "--columns" and follower.startswith("-") else [argument]
        return super().parse_args(ctx, given)


def limits_of(given: Sequence[str] | None) -> Limits:
    """Parses all `--limit` options. Raises as `Limits.parse`."""
    from stadera.limits import Limits

    return Limits.parse(given or ())


@dataclass(frozen=True)
class LogOptions:
    """Instructions for reading logs, parsed once for all logs of the command."""

    topics: Topics
    reading: Reading

    @classmethod
    def of(
        cls,
        joint_topic: str | None = None,
        imu_topic: str | None = None,
        columns: str | None = None,
        units: str | None = None,
        pd: str | None = None,
        limit: Sequence[str] | None = None,
        gear: str | None = None,
    ) -> LogOptions:
        """Parses the options' texts; raises as `Reading.of`."""
        from stadera.logs.reading import Reading
        from stadera.logs.topics import Topics

        return cls(Topics(joint_topic, imu_topic), Reading.of(columns, units, pd, limits_of(limit), gear))

    def log(self, path: Path) -> LogFile:
        """The log at a path, to be read with these instructions."""
        from stadera.logs.topics import LogFile

        return LogFile(path, self.topics, self.reading)

    def robot(self, given: str | None, path: Path) -> str:
        """The robot given, else the one that a log's metadata name, else the only one with its joints, which is shown.

        Raises:
            RecordingError: neither; lists those that have the joints.
        """
        from stadera.cli.terminal import progress, show
        from stadera.errors import RecordingError
        from stadera.fleet.metadata import robot_named_in
        from stadera.logs.reader import read_head
        from stadera.robot.guess import guessed

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
