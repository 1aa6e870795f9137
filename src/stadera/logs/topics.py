"""A log on disk with instructions for reading it: topics, and how to interpret columns if the log does not state it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import resources
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from stadera.errors import RecordingError
from stadera.joint_words import by_part
from stadera.limits import DEFAULTS, Limits
from stadera.logs.units import Units
from stadera.types import Array

if TYPE_CHECKING:
    from stadera.logs.foreign.column_map import ColumnMap
    from stadera.logs.mend import Change, Gear


DESIRED: tuple[str, ...] = ("position_desired", "velocity_desired", "effort_desired")
"""Columns of a flat table used by this law, `<joint>.position_desired` and so on; the last two may be absent."""
PD_DOUBT = (
    "joint torques are not measured but made of the controller's commands (--pd): what drives lose to friction and "
    "saturation counts as torque of the joint"
)


@dataclass(frozen=True)
class PdGains:
    """Gains of the joints' position controllers: one pair or three, from 0 and not all kp 0, else RecordingError."""

    kp: tuple[float, ...]  # [N·m/rad], one for all joints, or one each for hip, thigh and calf (HAA, HFE, KFE)
    kd: tuple[float, ...]  # [N·m·s/rad], as many

    def __post_init__(self) -> None:
        if len(self.kp) not in (1, 3) or len(self.kd) != len(self.kp):
            raise RecordingError("gains are one pair kp,kd or three, for hip, thigh and calf: kp,kd/kp,kd/kp,kd")
        if not all(isfinite(gain) and gain >= 0 for gain in (*self.kp, *self.kd)) or not any(self.kp):
            raise RecordingError(f"gains need to be at least 0 and some kp above, got {self}")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parses gains from "20,0.5" or, for hip, thigh and calf, "20,0.5/30,1/40,1.5". Raises RecordingError: another
        format.
        """
        try:
            pairs = [(float(kp), float(kd)) for kp, kd in (pair.split(",") for pair in text.split("/"))]
        except ValueError:
            raise RecordingError(
                f"{text!r} is not a pair of gains kp,kd [N·m/rad, N·m·s/rad], nor three with / between for hip, thigh "
                "and calf"
            ) from None
        return cls(tuple(kp for kp, _ in pairs), tuple(kd for _, kd in pairs))

    def effort(self, position: Array, velocity: Array, joints: Sequence[str], desired: dict[str, Array]) -> Array:
        """τ = kp (q_d - q) + kd (q̇_d - q̇) + τ_d, (samples, n) [N·m]: the torque commanded by the controller.
        `desired` is (samples, n) by name in `DESIRED`; q̇_d and τ_d are 0 if absent. Raises as `by_part`.
        """
        pairs = by_part(list(zip(self.kp, self.kd, strict=True)), joints, "one pair kp,kd")
        kp, kd = np.array(pairs).T
        zero = np.zeros(1)
        target, rate, feedforward = (desired.get(name, zero) for name in DESIRED)
        return np.asarray(kp * (target - position) + kd * (rate - velocity) + feedforward)

    def __str__(self) -> str:
        return "/".join(f"{kp:g},{kd:g}" for kp, kd in zip(self.kp, self.kd, strict=True))


@dataclass(frozen=True)
class ReadOptions:
    """Interpretation of a log's columns."""

    columns: ColumnMap | None = None  # assignment of columns; None to recognise them by their names
    units: Units = field(default_factory=Units)  # of the columns, if neither their names nor the map states them
    pd: PdGains | None = None  # gains for computing efforts from desired positions; None to use recorded efforts
    limits: Limits = DEFAULTS  # for reading
    changes: tuple[Change, ...] = ()  # applied to what is read, in order: gear ratios, corrections of faults
    # joints of no leg, an arm's or a lidar's, to read besides the requested ones if they are recorded
    others: tuple[str, ...] = ()
    orders: tuple[tuple[str, ...], ...] = ()  # lists of names that the log has, any of which may be that of its joints

    @classmethod
    def of(
        cls,
        columns: str | Path | ColumnMap | None = None,
        units: str | Units | None = None,
        pd: str | PdGains | None = None,
        limits: Limits = DEFAULTS,
        gear: str | Gear | None = None,
    ) -> ReadOptions:
        """Parses the options' texts: a preset's name or a map's path, "deg,ms", "20,0.5", gear ratios "6.33".
        RecordingError for an invalid one, UnknownNameError for an unknown unit.
        """
        if isinstance(columns, str | Path):
            from stadera.logs.foreign.column_map import column_map

            columns = column_map(columns)
        if isinstance(gear, str):
            from stadera.logs.mend import Gear

            gear = Gear.parse(gear)
        return cls(
            columns,
            Units.parse(units) if isinstance(units, str) else units or Units(),
            PdGains.parse(pd) if isinstance(pd, str) else pd,
            limits,
            () if gear is None else (gear,),
        )

    def refuse_time(self, source: str) -> None:
        """Raises RecordingError, for messages, which are stamped, if a unit of time or a rate is requested."""
        if asked := self.units.of_time:
            raise RecordingError(f"{source}: messages have stamps: leave out --units {asked}, which is for tables")


AS_RECORDED = ReadOptions()
"""Interprets columns by their names, in SI units unless the names state others."""


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
    reading: ReadOptions = AS_RECORDED

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", Path(self.path))
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

    __str__ = __fspath__
