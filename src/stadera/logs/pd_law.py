"""Computes joint torques from a position controller's commands, for logs without measured ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Self

import numpy as np

from stadera.errors import RecordingError
from stadera.joint_words import by_part
from stadera.types import Array

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
