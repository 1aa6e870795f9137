"""The options that several commands share, declared once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from stadera.logs.topics import LogFile

RobotName = Annotated[
    str, typer.Option("--robot", metavar="R", help="A robot's name, or a path to a URDF or MJCF.", show_default=False)
]
JsonFile = Annotated[Path | None, typer.Option("--json", metavar="F", help="Write the result as JSON.")]
ReportFile = Annotated[
    Path | None, typer.Option("--report", metavar="F.html", help="Write a report to open in a browser.")
]
Force = Annotated[
    bool, typer.Option("--force", help="Give a result that is not to be trusted all the same, every figure marked.")
]
JointTopic = Annotated[
    str | None, typer.Option("--joint-topic", metavar="TOPIC", help="Of a bag with several JointState topics.")
]
ImuTopic = Annotated[str | None, typer.Option("--imu-topic", metavar="TOPIC", help="Of a bag with several Imu topics.")]


def log_file(path: Path, joint_topic: str | None, imu_topic: str | None) -> LogFile:
    """A log with the topics asked for."""
    from stadera.logs.topics import LogFile, Topics

    return LogFile(path, Topics(joint_topic, imu_topic))
