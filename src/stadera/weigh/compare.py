"""Several estimators on several logs: each weighs each log, and what they say stands side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any, ClassVar

from stadera.errors import StaderaError
from stadera.logs.reader import Log, as_log, as_logs
from stadera.results import Result, data_frame
from stadera.robot.load import load_robot
from stadera.robot.model import Robot
from stadera.types import Progress
from stadera.weigh.result import Weighing
from stadera.weigh.settings import IN_MOTION, check_choice
from stadera.weigh.weigh import weigh


@dataclass(frozen=True, eq=False)
class MethodResult:
    """One method on one log: its weighing, or why there is none."""

    log: str
    method: str
    weighing: Weighing | None
    refusal: str = ""

    @property
    def label(self) -> str:
        """The method's name, of an own one without its folder."""
        return self.method.rpartition("/")[2]


@dataclass(frozen=True, eq=False)
class Comparison(Result):
    """Result of `compare`: one entry for each log and method, by log."""

    report: ClassVar[str] = "stadera.report.weigh.comparison"
    robot: Robot
    entries: tuple[MethodResult, ...]

    def to_dict(self) -> dict[str, Any]:
        """Robot and entries: log, method, refusal (null if weighed), and the weighing as `weigh --json` has it."""
        return {
            "robot": self.robot.name,
            "entries": [
                {
                    "log": each.log,
                    "method": each.method,
                    "refusal": each.refusal or None,
                    "weighing": None if each.weighing is None else each.weighing.to_dict(),
                }
                for each in self.entries
            ],
        }

    def to_dataframe(self) -> Any:
        """One row for each entry. Raises MissingExtraError: pandas is not installed."""
        rows = [_row(each) for each in self.entries]
        return data_frame({name: [row[name] for row in rows] for name in rows[0]})


def compare(
    robot: Robot | str | PathLike[str],
    logs: Log | Sequence[Log],
    methods: Sequence[str] = (IN_MOTION,),
    tare: tuple[float, float] | Log | None = None,
    *,
    weight: float | tuple[float, float] | None = None,
    imu_frame: str | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Weighs each log by each method.

    A log that a method refuses is an entry with the reason; a result that is not to be trusted as well.

    Args:
        robot: a robot, its name, or the path of its model file.
        methods: names as of `stadera.weigh.weigh`, FILE.py:Name among them.
        tare: range of each log's time [s], or another log, without payload.
        weight: of the robot on a scale, for the method "walking" alone.

    Raises:
        UnknownNameError, IdentificationError: no such method. ModelError: no such robot. RecordingError: no log given.
    """
    for method in methods:
        check_choice(method, None)
    model, entries = load_robot(robot), []
    for log in as_logs(logs):
        for method in methods:
            on_scale = weight if method == IN_MOTION else None
            source = as_log(log)
            name = source.name
            try:
                found = weigh(model, log, tare, method, imu_frame=imu_frame, weight=on_scale, progress=progress)
                entries.append(MethodResult(name, method, found))
            except StaderaError as error:
                entries.append(MethodResult(name, method, None, str(error).removeprefix(f"{source.source}: ")))
    return Comparison(model, tuple(entries))


def _row(each: MethodResult) -> dict[str, Any]:
    found, nan = each.weighing, float("nan")
    row: dict[str, Any] = {"log": each.log, "method": each.method, "refusal": each.refusal}
    row["verdict"] = "" if found is None else found.trust.verdict
    row["mass"], row["mass_std"] = (nan, nan) if found is None else (found.mass, found.mass_std)
    for k, axis in enumerate("xyz"):
        row[f"com_{axis}"] = nan if found is None else float(found.com[k])
        row[f"com_{axis}_std"] = nan if found is None else float(found.com_std[k])
    payload = None if found is None else found.payload
    row["payload_mass"] = nan if payload is None else payload.mass
    row["payload_mass_std"] = nan if payload is None else payload.mass_std
    return row
