"""Settings of an identification."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from stadera.body import FRICTION_TERMS, FrictionModel
from stadera.errors import IdentificationError, UnknownNameError, require_positive
from stadera.identify.prior import PriorWidth
from stadera.identify.solutions import KindSpread, SolverSettings
from stadera.identify.varying import VaryingSettings

METHODS: tuple[str, ...] = ("consistent", "null-space")


@dataclass(frozen=True)
class TrustSettings:
    """Size of the residuals of a good fit, and limits beyond which a fit is doubtful or bad."""

    # a, share of Coulomb friction that the friction law does not explain, since a drive's friction depends on load,
    # position and temperature. On 24 joints of a real Go2 and Aliengo in the air the whole residual is 0.09 to 0.42 of
    # it.
    friction: float = 0.3
    # b, share of the torque's root mean square: ripple and nonlinearity of torques computed from currents. Assumed; it
    # matters where there is no friction.
    torque: float = 0.05
    # doubtful, bad: misfit of a joint above which the fit is doubtful or bad [1]: residuals 1.7 and 5.5 times the
    # stated size
    doubtful: float = 3.0
    bad: float = 30.0
    # probability, under the prior, of values as far from the model's, below which the result is doubtful
    far: float = 1e-6
    # factor by which the cost must fall with a torque's sign reversed for the sign to count as wrong
    reversed_gain: float = 2.0
    outlier: float = 6.0  # error of a sample above which it is an outlier, in RMSE of its joint [1]
    # share of outliers above which a warning is given [1]; of Gaussian errors, 2e-9 exceed six times their size
    outliers: float = 2e-3
    turning: float = 0.1  # root mean square of the IMU's angular velocity above which the trunk is not held [rad/s]
    # standard deviations by which held-out squared errors exceed those of CAD with friction, above which they are
    # worse; matters: share of the error by which they are at least
    worse: float = 2.0
    matters: float = 0.02
    fewest: int = 200  # number of moving samples below which a warning is given

    def __post_init__(self) -> None:
        require_positive("trust setting", self, self.__dataclass_fields__)


@dataclass(frozen=True)
class LagSettings:
    """Settings for estimating the torques' lag, see `stadera.identify.lag`."""

    # earliest, latest: ends of the search [s]. Commands of a real Go2 and Aliengo: 10 to 16 ms; measured torques may be
    # written down late.
    earliest: float = -0.020
    latest: float = 0.040
    usual: float = 0.015  # standard deviation of lags before the log tells [s]: those real ones
    step: float = 0.0025  # of the search [s]; a parabola interpolates the lag between steps
    significant: float = 2.0  # standard deviations below which a lag is not significant [1]
    resolution: float = 5e-4  # smaller lags are ignored [s], since deviations of friction from its model can cause them
    sliding: float = 0.1  # velocity above which a joint slides [rad/s]
    # time around a sample within which the joint must slide, times the cut-off [1]: further away a filtered step has
    # settled to 5 %
    reach: float = 0.6
    # standard deviation of what remains of the lag [s], which each part of a log tells besides: halves of the real Go2,
    # Aliengo and of a Mini Cheetah (twice) in the air differ by 6.2, 0.6, 0.3 and 0.3 ms, by √2 times what one is off
    remains: float = 0.0025

    def __post_init__(self) -> None:
        require_positive(
            "lag setting", self, ("latest", "usual", "step", "significant", "resolution", "sliding", "reach", "remains")
        )
        if not -1.0 <= self.earliest <= 0.0:
            raise IdentificationError(f"lag setting 'earliest' lies between -1 and 0 s, got {self.earliest}")


@dataclass(frozen=True)
class SignalSettings:
    """Settings for filtering signals and selecting samples."""

    # lowest cut-off chosen for signals [Hz]; a lower one would smear the steps of Coulomb friction into other effects
    lowest_cutoff: float = 15.0
    lag_cutoff: float = 25.0  # highest cut-off for estimating the torque lag [Hz], see `stadera.identify.lag`
    # cut-off of a part as a share of the log's highest one; sampling rates vary where samples are lost
    any_part: float = 0.98
    # the paper's limit [rad/s]; the velocity of a slower joint does not determine its friction
    drop_below: float = 0.01
    # travel within which a joint stays that does not move [rad]: gears wind up and play by up to a degree, and encoders
    # have a tenth of that as noise
    travel: float = 0.02
    lag: LagSettings = field(default_factory=LagSettings)  # estimation of the torque lag

    def __post_init__(self) -> None:
        require_positive("signal setting", self, ("lowest_cutoff", "lag_cutoff", "any_part", "drop_below", "travel"))


@dataclass(frozen=True)
class IdentifySettings:
    """Settings for identifying legs.

    Attributes:
        legs: names of the legs; None for all.
        method: "consistent" (physically possible parameters only) or "null-space" (the paper's eq. 5).
        friction: the joint terms to identify; the others stay at the model's values.
        cutoff_hz: of the low-pass filter [Hz]; None for no filter; "auto" to choose it from the motion.
        torque_lag: delay of the torques relative to their stamps [s]; None to estimate it.
        up: the vertical in trunk axes; None to take it from an IMU in the log, or else to assume a level trunk.
        split: share of each log, from its beginning, used for training; the rest is used for validation. 1.0 uses all.
        width: plausible distance of the truth from the model's values.
        spread: spread between the drives of the legs; None to identify each leg separately.
        most_carried: share of the robot's weight above which a foot counts as loaded. Feet of a standing or walking
            robot carry a quarter on average; for real legs in the air the estimate is at most 0.01.
        varying: how friction varies with position and load, and when it is taken to build up after a reversal; None for
            constant friction.
        trust: limits for a doubtful or bad fit.
        signals: cut-offs and selection of samples.
        solver: settings of the small problem to which the rows are reduced.

    Raises:
        UnknownNameError: no such method.
        IdentificationError: a setting is out of its range.
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
    varying: VaryingSettings | None = field(default_factory=VaryingSettings)
    trust: TrustSettings = field(default_factory=TrustSettings)
    signals: SignalSettings = field(default_factory=SignalSettings)
    solver: SolverSettings = field(default_factory=SolverSettings)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise UnknownNameError("method", self.method, METHODS)
        if not 0.0 < self.split <= 1.0:
            raise IdentificationError(f"split must lie above 0 and at most at 1, got {self.split:g}")
        if self.up is not None and (len(self.up) != 3 or not np.isfinite(self.up).all() or not any(self.up)):
            raise IdentificationError(f"the vertical needs three finite numbers, not all zero; got {self.up!r}")
