"""Inspection of a log for weighing: its faults, and whether `weigh` accepts it."""

from dataclasses import dataclass

from stadera.checks import Finding, Guard
from stadera.errors import StaderaError
from stadera.logs.reader import Log, as_log
from stadera.robot.model import Robot
from stadera.trust import Trust
from stadera.types import Progress
from stadera.weigh.extra_joints import with_extra_joints
from stadera.weigh.weigh import weigh


@dataclass(frozen=True)
class Inspection:
    """Result of inspecting a log: faults of its first chunk, in which most show, and notes on joints that belong to no
    leg.
    """

    findings: tuple[Finding, ...]
    refusal: str = ""  # why weighing fails, one line; empty if it succeeds
    trust: Trust | None = None  # of the weighing; None if it was refused, or if the robot is in the air
    notes: tuple[str, ...] = ()

    @property
    def sound(self) -> bool:
        """True if no fault was found and weighing succeeds."""
        return not self.findings and self.trust is not None and self.trust.verdict == "good"


def inspected(
    robot: Robot, log: Log, imu_frame: str | None = None, *, fix: bool = False, progress: Progress | None = None
) -> Inspection:
    """Checks a log, and weighs from it unless the robot is in the air. Arguments as in `stadera.weigh`. Raises
    RecordingError: the log cannot be read.
    """
    notes = with_extra_joints(robot, as_log(log))[2]
    guard = Guard(robot, robot.tree.joints, imu_frame=imu_frame)
    source = as_log(log)
    if fix:
        source = guard.mended(source)
    findings = guard.findings(source)
    if any(finding.cause == "not_on_feet" for finding in findings):
        return Inspection(findings, notes=notes)
    try:
        trust = weigh(robot, source, imu_frame=imu_frame, progress=progress).trust
        return Inspection(findings, trust=trust, notes=notes)
    except StaderaError as error:
        return Inspection(findings, str(error), notes=notes)
