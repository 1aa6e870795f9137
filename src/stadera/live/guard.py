"""Checks the first seconds of a stream as every command checks a log: units, signs, order of legs, feet on the ground.

Samples are used at once. If the check then finds that they cannot be weighed, what was learnt is discarded, the state
says what is wrong and which option corrects it, and each further stretch is checked until one is sound: a robot may lie
when the session begins.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from stadera.checks import FATAL, Finding, diagnose
from stadera.errors import RecordingError
from stadera.logs.join import concatenate
from stadera.logs.mend import Change, changed
from stadera.logs.recording import Recording
from stadera.robot.model import Robot

_REFUSED = (*FATAL, "contradiction", "not_on_feet")
"""Causes with which nothing is weighed."""


@dataclass(frozen=True)
class Checked:
    """Result of checking a stretch: why nothing can be weighed, one sentence with the option that corrects it, empty if
    it can; other findings and corrections made; and whether what was learnt so far is to be discarded.
    """

    wrong: str = ""
    notes: tuple[str, ...] = ()
    anew: bool = False


class StreamGuard:
    """Checks a stream, in stretches of `seconds` [s], after `changes` of all samples; `fix` corrects unambiguous
    faults. `wrong` is that of the last stretch, see `Checked`.
    """

    def __init__(
        self, robot: Robot, imu_frame: str | None, seconds: float, fix: bool = False, changes: Sequence[Change] = ()
    ) -> None:
        self._robot, self._frame, self._seconds, self._fix = robot, imu_frame, seconds, fix
        self._changes, self._parts, self._done = list(changes), list[Recording](), False
        self.wrong = ""

    def corrected(self, recording: Recording) -> Recording:
        """The samples after all changes."""
        return changed(recording, self._changes, first=False)

    def restart(self) -> None:
        """Announces that the next samples do not continue the previous ones."""
        self._parts.clear()

    def check(self, recording: Recording) -> Checked | None:
        """Takes in corrected samples; the result once a stretch is complete, until one is sound."""
        if self._done:
            return None
        self._parts.append(recording)
        if float(recording.time[-1] - self._parts[0].time[0]) < self._seconds:
            return None
        parts, self._parts = tuple(self._parts), []
        try:
            found = diagnose(concatenate(parts), self._robot, self._frame)
        except RecordingError:  # stretches that do not fit together
            return None
        return self._judged(found)

    def _judged(self, found: Sequence[Finding]) -> Checked:
        mends = [finding.mend for finding in found if finding.mend is not None] if self._fix else []
        if mends:
            self._changes += mends
            return Checked(self.wrong, tuple(mend.text for mend in mends), anew=True)
        refused = [finding for finding in found if finding.cause in _REFUSED]
        before, self.wrong = self.wrong, f"samples that can be weighed: {_said(refused[0])}" if refused else ""
        self._done = not refused
        notes = tuple(str(finding) for finding in found if finding not in refused)
        return Checked(self.wrong, notes, anew=bool(refused or before))


def _said(finding: Finding) -> str:
    """The finding with the option that corrects it; messages have no columns to be mapped."""
    if finding.option.startswith("--columns"):
        fix = "" if finding.mend is None else " or add --fix"
        return f"{finding.message}; correct it where the messages are sent{fix}"
    return str(finding)
