"""Whether a log can be weighed by: its findings, and whether weighing goes through."""

from __future__ import annotations

from dataclasses import dataclass

from stadera.checks import Finding, Guard
from stadera.errors import StaderaError
from stadera.logs.reader import Log, as_log
from stadera.robot.model import Robot
from stadera.trust import Trust
from stadera.types import Progress
from stadera.weigh.weigh import weigh


@dataclass(frozen=True)
class Inspection:
    """What is wrong with a log.

    Attributes:
        findings: of its first chunk, in which most faults show.
        refusal: why weighing by it fails, one line; empty where it does not.
        trust: of the weighing; None where it was refused, or where the robot is in the air.
    """

    findings: tuple[Finding, ...]
    refusal: str = ""
    trust: Trust | None = None

    @property
    def sound(self) -> bool:
        """Whether nothing was found, and weighing goes through."""
        return not self.findings and self.trust is not None and self.trust.verdict == "good"


def inspected(
    robot: Robot, log: Log, imu_frame: str | None = None, *, fix: bool = False, progress: Progress | None = None
) -> Inspection:
    """Checks a log, and weighs by it unless the robot is in the air.

    Args:
        robot: its model.
        log: as `stadera.weigh` takes it.
        imu_frame, fix, progress: as of `stadera.weigh`.

    Raises:
        RecordingError: the log cannot be read.
    """
    guard = Guard(robot, robot.tree.joints, imu_frame=imu_frame)
    source = as_log(log)
    if fix:
        source = guard.mended(source)
    findings = guard.findings(source)
    if any(finding.cause == "not_on_feet" for finding in findings):
        return Inspection(findings)
    try:
        return Inspection(findings, trust=weigh(robot, source, imu_frame=imu_frame, progress=progress).trust)
    except StaderaError as error:
        return Inspection(findings, str(error))
