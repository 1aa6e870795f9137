"""The path of a log together with the topics to read from it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from stadera.errors import RecordingError
from stadera.logs.reading import AS_RECORDED, Reading

if TYPE_CHECKING:
    from stadera.logs.recording import Recording


EXAMPLES: tuple[str, ...] = ("go2_legs_in_air", "aliengo_legs_in_air", "aliengo_steps", "go2_trot")
"""Real logs in the package, their names accepted if no file has them; `logs/data/README.md` states their sources."""


def example(name: str) -> Path:
    """Path of a log included in the package."""
    return Path(str(resources.files("stadera.logs") / "data" / f"{name}.parquet"))


@dataclass(frozen=True)
class Topics:
    """The topics of sensor_msgs/JointState and Imu to read, of logs with topics; None for the only one of its type."""

    joint: str | None = None
    imu: str | None = None

    def refuse(self, source: str, kind: str) -> None:
        """Raises RecordingError, for logs without topics, if a topic is requested."""
        for option, topic in (("--joint-topic", self.joint), ("--imu-topic", self.imu)):
            if topic is not None:
                raise RecordingError(f"{source}: {option} {topic}: a {kind} has no topics; only bags have")


@dataclass(frozen=True)
class LogFile(PathLike[str]):
    """A log on disk with instructions for reading it; accepted wherever a log's path is.

    Attributes:
        path: of the file or folder, or a name from `EXAMPLES` if there is no such file.
        topics: to read, for bags and for tables converted from them.
        reading: assignment and units of its columns.
    """

    path: Path
    topics: Topics = field(default_factory=Topics)
    reading: Reading = AS_RECORDED

    def __post_init__(self) -> None:
        if str(self.path) in EXAMPLES and not self.path.exists():
            object.__setattr__(self, "path", example(str(self.path)))

    @classmethod
    def of(cls, log: str | PathLike[str]) -> LogFile:
        """Makes a LogFile with unspecified topics from a plain path; returns a LogFile unchanged."""
        return log if isinstance(log, LogFile) else cls(Path(log))

    @property
    def source(self) -> str:
        """The path, for messages."""
        return str(self.path)

    @property
    def name(self) -> str:
        """The path's last part."""
        return self.path.name

    def __fspath__(self) -> str:
        return str(self.path)

    def __str__(self) -> str:
        return str(self.path)


@dataclass
class FirstChunk:
    """The first chunk of a log, and those after it until a reader takes them."""

    first: Recording | None
    rest: Iterator[Recording] | None


@dataclass(frozen=True)
class OpenedLog(LogFile):
    """A log on disk whose first chunk (by joints read; `stadera.logs.stream` fills it) is kept in memory until someone
    reads on, so that checks made on it before do not read it again. Chunks of fewer rows are cut from it, so they are
    full where the file has rows with blank cells.
    """

    beginnings: dict[tuple[str, ...] | None, FirstChunk] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @classmethod
    def at(cls, log: LogFile) -> OpenedLog:
        """The same log with nothing read yet."""
        return cls(log.path, log.topics, log.reading)
