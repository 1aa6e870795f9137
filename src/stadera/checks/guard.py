"""Checks made on a log by every command before anything else: detection of faults, and their correction with `fix`.

Units and signs are checked for any motion. Checks that need a robot on its feet are made chunk by chunk during weighing
(`stadera.weigh.reading`), because a log may start before the robot stands up, or end in a fall.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from stadera.checks.diagnosis import diagnose
from stadera.checks.finding import Finding
from stadera.checks.limits import CheckLimits
from stadera.checks.units import limit_findings, unit_findings
from stadera.errors import UntrustedError
from stadera.logs.mend import changed
from stadera.logs.reader import stream
from stadera.logs.recording import Recording
from stadera.logs.topics import LogFile
from stadera.robot.model import Robot


@dataclass(frozen=True, eq=False)
class Guard:
    """Checks logs of a robot for the joints needed in them."""

    robot: Robot
    joints: Sequence[str]
    on_feet: bool = True  # True if the robot stands or walks; False if its trunk is held, legs in the air
    imu_frame: str | None = None  # frame of the IMU's values; None for the log's own, else the model's
    rounds: int = 4  # of detection and correction at most; a wrong unit hides other faults until it is corrected

    def units(self, log: LogFile | Recording) -> tuple[Finding, ...]:
        """Faults of units and signs in a log's first chunk."""
        first = self._first(log)
        found = () if first is None else unit_findings(first, self.robot)
        if first is None or found or self.on_feet:
            return found
        return tuple(limit_findings(first, self.robot, CheckLimits()))

    def findings(self, log: LogFile | Recording) -> tuple[Finding, ...]:
        """All faults in a log's first chunk. Raises RecordingError: the log cannot be read, or lacks a joint.
        UnknownNameError: no such frame.
        """
        if not self.on_feet:
            return self.units(log)
        first = self._first(log)
        return () if first is None else diagnose(first, self.robot, self.imu_frame)

    def mended(self, log: LogFile | Recording) -> LogFile | Recording:
        """The log with all unambiguous faults corrected, and a note on each; raises as `findings`."""
        for _ in range(self.rounds):
            mends = [finding.mend for finding in self.findings(log) if finding.mend is not None]
            if not mends:
                break
            if isinstance(log, Recording):
                log = changed(log, mends)
            else:
                log = replace(log, reading=replace(log.reading, changes=(*log.reading.changes, *mends)))
        return log

    def admitted(self, log: LogFile | Recording, *, fix: bool, force: bool) -> LogFile | Recording:
        """The log to use: corrected with `fix`, and its units and signs checked unless a result is forced. Raises
        UntrustedError: they are wrong; names the option that corrects them. Also raises as `findings`.
        """
        log = self.mended(log) if fix else log
        wrong = () if force else [finding for finding in self.units(log) if finding.fatal]
        if wrong:
            raise UntrustedError(f"{log.source}: {wrong[0]}")
        return log

    def _first(self, log: LogFile | Recording) -> Recording | None:
        first = next(stream(log, joints=self.joints), None)
        return first if first is not None and len(first) > 1 else None
