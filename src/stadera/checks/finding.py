"""A fault found in a log, with its evidence and remedy."""

from dataclasses import dataclass

from stadera.logs.mend import Mend

FATAL = (
    "no_torque",
    "time_unit",
    "position_unit",
    "velocity_unit",
    "velocity_order",
    "gyro_unit",
    "imu_gravity",
    "imu_frame",
    "imu_late",
    "torque_signs",
    "torque_unit",
    "joint_order",
    "joint_signs",
)
"""Causes that make a log unusable for weighing and identification."""


@dataclass(frozen=True)
class Finding:
    """A fault of a log."""

    # one word: one of FATAL, or dropout, pushing, torque_order, torque_step, limb_torques, no_gyro, not_on_feet,
    # contradiction; or stuck, velocity, position, effort, of part of a log
    cause: str
    message: str  # the fault and the evidence for it, one sentence
    # command-line option that corrects it, such as "--units deg"; empty if there is none besides `--fix`
    option: str = ""
    mend: Mend | None = None  # correction applied by `--fix`; None if there is none
    spans: tuple[
        tuple[float, float], ...
    ] = ()  # begin and end of each part of the log that has it [s]; none: all of it
    at: float | None = None  # about when it begins [s]; None if that is not known
    lasting: bool = False  # True if it affects everything after it, by a change of geometry that error bars cover

    @property
    def fatal(self) -> bool:
        """True if such a log cannot be used for weighing or identification."""
        return self.cause in FATAL

    @property
    def remedy(self) -> str:
        """The option to add, as the end of a sentence; empty if there is none."""
        options = [self.option] if self.option else []
        if self.mend is not None:
            options.append("--fix")
        return f"; add {' or '.join(options)}" if options else ""

    def said(self, since: float = 0.0) -> str:
        """The message with the times, in seconds since the log's beginning [s], and the remedy."""
        when = ""
        if self.spans:
            begin, end = self.spans[0][0] - since, self.spans[-1][1] - since
            when = f", {'from' if len(self.spans) > 1 else 'at'} {begin:.2f} to {end:.2f} s"
        elif self.at is not None:
            when = f", at about {self.at - since:.1f} s"
        return f"{self.message}{when}{self.remedy}"

    def __str__(self) -> str:
        return f"{self.message}{self.remedy}"
