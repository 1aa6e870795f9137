"""What a weighing is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stadera.errors import IdentificationError, UnknownNameError
from stadera.estimate.registry import METHODS
from stadera.recording.topics import LogFile


@dataclass(frozen=True)
class WeighSettings:
    """How to weigh.

    Attributes:
        method: of finding the centre of mass, a name of `stadera.estimate.registry.METHODS`; None for "contact", or
            "poses" where the log has no IMU.
        tare: a range of the log's time [s], or another log, in which the robot stands without its payload.
        imu_frame: in which the IMU's values are; None for the log's own, else the model's.
        stiffness: of the trunk controller about the trunk's axes [N·m/rad], for the method "orientation".

    Raises:
        UnknownNameError: no such method.
        IdentificationError: the method "orientation" without the stiffness, a stiffness that is not positive, a range
            of time that is none.
    """

    method: str | None = None
    tare: tuple[float, float] | Path | LogFile | None = None
    imu_frame: str | None = None
    stiffness: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.method is not None and self.method not in METHODS:
            raise UnknownNameError("method", self.method, METHODS)
        if self.method == "orientation" and self.stiffness is None:
            raise IdentificationError(
                "the method 'orientation' weighs by how far the trunk controller's springs give way: it needs their "
                "--stiffness KX,KY,KZ [N·m/rad]; without it use 'contact'"
            )
        if self.stiffness is not None and not (np.isfinite(self.stiffness).all() and min(self.stiffness) > 0):
            raise IdentificationError(f"a stiffness must be three positive numbers, got {self.stiffness}")
        if isinstance(self.tare, tuple) and not self.tare[0] < self.tare[1]:
            raise IdentificationError(f"a tare's range needs a beginning before its end, got {self.tare} s")
