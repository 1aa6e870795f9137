"""What is wrong with a log, with the evidence and the way to mend it."""

from __future__ import annotations

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
    "torque_signs",
    "torque_unit",
    "joint_order",
    "joint_signs",
)
"""Causes that leave nothing to weigh or to identify by."""


@dataclass(frozen=True)
class Finding:
    """Something wrong with a log.

    Attributes:
        cause: in one word: one of FATAL, or dropout, stuck, orientation, not_on_feet, contradiction.
        message: the fault and the evidence for it, one sentence.
        option: of the commands, that mends it, such as "--units deg"; empty where there is none but `--fix`.
        mend: what `--fix` does; None where it cannot be mended.
    """

    cause: str
    message: str
    option: str = ""
    mend: Mend | None = None

    @property
    def fatal(self) -> bool:
        """Whether nothing can be weighed or identified by such a log."""
        return self.cause in FATAL

    @property
    def remedy(self) -> str:
        """The option to add, as the end of a sentence; empty where there is none."""
        options = [self.option] if self.option else []
        if self.mend is not None:
            options.append("--fix")
        return f"; add {' or '.join(options)}" if options else ""

    def __str__(self) -> str:
        return f"{self.message}{self.remedy}"
