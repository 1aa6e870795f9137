"""The options that choose among a bag's topics, for every command that reads logs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from stadera.recording.topics import LogFile

JointTopic = Annotated[
    str | None,
    typer.Option("--joint-topic", metavar="TOPIC", help="Of a bag with several JointState topics."),
]
ImuTopic = Annotated[str | None, typer.Option("--imu-topic", metavar="TOPIC", help="Of a bag with several Imu topics.")]


def log_file(path: Path, joint_topic: str | None, imu_topic: str | None) -> LogFile:
    """A log with the topics asked for."""
    from stadera.recording.topics import LogFile, Topics

    return LogFile(path, Topics(joint_topic, imu_topic))
