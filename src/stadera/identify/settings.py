"""What an identification is asked to do."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from stadera.errors import IdentificationError, UnknownNameError, require_positive
from stadera.identify.pooling import KindSpread
from stadera.identify.prior import PriorWidth
from stadera.legs import FRICTION_TERMS, FrictionModel

METHODS: tuple[str, ...] = ("consistent", "null-space")


@dataclass(frozen=True)
class TrustSettings:
    """What a good fit leaves, and from where on a fit is not good.

    Attributes:
        friction: a, share of Coulomb friction that the friction law does not explain: drives' friction depends on load,
            position and temperature. On 24 joints of a real Go2 and Aliengo in the air the whole residual is 0.09 to
            0.42 of it.
        torque: b, share of the torque's root mean square: ripple and nonlinearity of torques that are
            computed from currents. Assumed; it matters where there is no friction.
        doubtful, bad: misfit of a joint above which the fit is so [1]: residuals 1.7 and 5.5 times the stated size.
        far: probability that values are as far from the model's, by the prior, below which the result is doubtful.
        reversed_gain: factor by which the cost falls if a torque's sign is taken to be reversed.
    """

    friction: float = 0.3
    torque: float = 0.05
    doubtful: float = 3.0
    bad: float = 30.0
    far: float = 1e-6
    reversed_gain: float = 2.0

    def __post_init__(self) -> None:
        require_positive("trust setting", self, self.__dataclass_fields__)


@dataclass(frozen=True)
class SignalSettings:
    """How signals are filtered and chosen.

    Attributes:
        lowest_cutoff: [Hz], below which no cut-off is chosen for signals: Coulomb friction's steps, smeared out, would
            pass for another effect.
        lag_cutoff: [Hz], for the torque lag, which shows best in fast changes.
        any_part: share of a log's highest cut-off that every part of it allows: where samples are lost, rates differ.
        drop_below: [rad/s], the paper's: slower than this a joint's friction is not determined by its velocity.
    """

    lowest_cutoff: float = 15.0
    lag_cutoff: float = 25.0
    any_part: float = 0.98
    drop_below: float = 0.01

    def __post_init__(self) -> None:
        require_positive("signal setting", self, self.__dataclass_fields__)


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
        most_carried: share of the robot's weight above which a foot counts as on the ground. A foot of a robot that
            stands or walks carries a quarter on average; of legs in the air, real ones, it seems to be 0.01 at most.
        trust: when a fit is doubtful or bad.
        signals: cut-offs, and which samples count.

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
    spread: KindSpread | None = field(default_factory=KindSpread)
    most_carried: float = 0.1
    trust: TrustSettings = field(default_factory=TrustSettings)
    signals: SignalSettings = field(default_factory=SignalSettings)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise UnknownNameError("method", self.method, METHODS)
        if not 0.0 < self.split <= 1.0:
            raise IdentificationError(f"split must lie above 0 and at most at 1, got {self.split:g}")
        if self.up is not None and (len(self.up) != 3 or not np.isfinite(self.up).all() or not any(self.up)):
            raise IdentificationError(f"the vertical needs three finite numbers, not all zero; got {self.up!r}")
