"""What an identification is asked to do."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from stadera.errors import IdentificationError, UnknownNameError
from stadera.identify.pooling import Spread
from stadera.identify.prior import PriorWidth
from stadera.regressors import FRICTION_TERMS, FrictionModel

METHODS: tuple[str, ...] = ("consistent", "null-space")


@dataclass(frozen=True)
class IdentifySettings:
    """How legs are identified.

    Attributes:
        legs: names of the legs; None for all.
        method: "consistent" (only what a real robot can have) or "null-space" (the paper's eq. 5).
        friction: the joint terms to identify; the others stay at the model's values.
        cutoff_hz: of the low-pass filter [Hz]; None for no filter; "auto" to take it from the motion.
        torque_lag: how much later than its stamp a torque acts [s]; None to estimate it.
        up: the vertical in trunk axes; None to take it from an IMU in the log, else the trunk is taken as level.
        split: the share of each log, from its beginning, to identify on; the rest validates. 1.0 keeps nothing back.
        width: how far from the model's values the truth may lie.
        spread: how alike the drives of the legs are, None to identify each leg by itself.

    Raises:
        UnknownNameError: a method that is none.
        IdentificationError: a setting out of its range.
    """

    legs: tuple[str, ...] | None = None
    method: str = "consistent"
    friction: FrictionModel = field(default_factory=lambda: FrictionModel(FRICTION_TERMS))
    cutoff_hz: float | Literal["auto"] | None = "auto"
    torque_lag: float | None = None
    up: tuple[float, float, float] | None = None
    split: float = 0.5
    width: PriorWidth = field(default_factory=PriorWidth)
    spread: Spread | None = field(default_factory=Spread)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise UnknownNameError("method", self.method, METHODS)
        if not 0.0 < self.split <= 1.0:
            raise IdentificationError(f"split must lie above 0 and at most at 1, got {self.split:g}")
        if self.up is not None and (len(self.up) != 3 or not np.isfinite(self.up).all() or not any(self.up)):
            raise IdentificationError(f"the vertical needs three finite numbers, not all zero; got {self.up!r}")
