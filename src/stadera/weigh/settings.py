"""Settings of weighing, and what a user names: a method, a weight, a tare."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from stadera.checks.limits import WindowLimits
from stadera.errors import IdentificationError, positive, require_positive
from stadera.logs import LogFile
from stadera.logs.recording import Recording
from stadera.trunk.registry import method_of
from stadera.trunk.settings import TrunkSettings
from stadera.types import Array
from stadera.weigh.against_model import AgreementLimits

if TYPE_CHECKING:
    from stadera.trunk.estimator import TrunkEstimator
    from stadera.trunk.samples import Samples

Source = LogFile | Recording
Watch = Callable[["Samples", "TrunkEstimator"], None]
"""Called with samples (IMU values in trunk axes) and the estimator, after it has processed them."""
IN_MOTION = "walking"
"""Name in `METHODS` of the library's method for any motion."""


@dataclass(frozen=True)
class WeighSettings:
    """Settings of weighing a log.

    Attributes:
        least_rate: lowest sampling rate for weighing in motion [Hz]; slower logs do not resolve the motion.
        jitter: factor by which steps may exceed the longest one that `least_rate` allows, for rounded time stamps [1].
        entry: interval of the timeline in motion [s].
        ahead: samples passed to the estimator at once.
        log_gap: gap inserted between the tare's log and the other log [s].
        sound: number of successive consistent windows that cannot be a coincidence, in a log with contradictions
            elsewhere.
        trunk: settings of the estimator for motion, see `TrunkSettings`.
        stale: time between the last sample used and the end of the log above which a change of the load may have been
            missed [s].
        windows: criteria for signals that contradict each other in part of a log, see `WindowLimits`.
        model: when a difference of the trunk from its model is doubtful, see `AgreementLimits`.
        window: length of the windows in which encoders, torques and IMU are compared in such a log [s].
        tare_change: change of the load within the tare's time above which there is no tare, share of the robot's mass
            [1]; the beginning of a simulated trot with real errors looks like one of 4 %.
        contradicted: odds of another place above which the one that the owner names is doubted [1].
    """

    least_rate: float = 50.0
    jitter: float = 1.02
    entry: float = 0.1
    ahead: int = 512
    log_gap: float = 10.0
    sound: int = 4
    trunk: TrunkSettings = field(default_factory=TrunkSettings)
    stale: float = 1.0
    windows: WindowLimits = field(default_factory=WindowLimits)
    model: AgreementLimits = field(default_factory=AgreementLimits)
    window: float = 0.5
    tare_change: float = 0.05
    contradicted: float = 1000.0

    def __post_init__(self) -> None:
        numbers = [f.name for f in fields(self) if f.name not in ("trunk", "windows", "model")]
        require_positive("weighing setting", self, numbers)

    def too_slow(self, time: Array) -> str:
        """What samples at times (n,) [s] lack to weigh by a robot in motion, a clause; empty if nothing."""
        step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        if step * self.least_rate <= self.jitter:
            return ""
        needed = f"{self.least_rate:.3g} are needed"
        return f"{1 / step:.3g} samples a second, of which weighing in motion sees too little; {needed}"


def check_choice(method: str | None, stiffness: tuple[float, float, float] | None) -> None:
    """Checks a method (None if it is still to be chosen) and its stiffness.

    Raises:
        UnknownNameError, IdentificationError: as `stadera.trunk.registry.method_of`.
        IdentificationError: the method "orientation" without a stiffness, another method with one, or a stiffness that
            is not positive.
    """
    if method is not None:
        method_of(method)
    if stiffness is not None and not (np.isfinite(stiffness).all() and min(stiffness) > 0):
        raise IdentificationError(f"a stiffness must be three positive numbers, got {stiffness}")
    if method == "orientation" and stiffness is None:
        raise IdentificationError(
            "the method 'orientation' weighs by how far the trunk controller's springs give way: it needs their "
            "--stiffness KX,KY,KZ [N·m/rad], which `stadera weigh` takes; without it use 'contact'"
        )
    if method != "orientation" and stiffness is not None:
        raise IdentificationError(
            f"a stiffness is used by the method 'orientation' alone, not by {method or 'the one chosen without a name'}"
        )


def weight_std(mass: float) -> float:
    """Standard deviation of a mass on a bathroom scale [kg]: 0.2 % and 50 g. IdentificationError: it is no mass."""
    positive("a robot's weight on a scale", mass, "kg", IdentificationError)
    return float(np.hypot(0.05, 0.002 * mass))


@dataclass(frozen=True)
class TestWeight:
    """A payload that its owner knows: mass and its standard deviation [kg], place (3,) and its deviation [m], trunk
    frame.
    """

    __test__ = False  # no test of pytest's

    mass: float
    com: tuple[float, float, float]
    mass_std: float = 0.005
    com_std: float = 0.005


def tare_of(text: str) -> tuple[float, float] | str:
    """Parses a tare: a time range "T0:T1" [s], else the path of a log, returned unchanged. Raises IdentificationError:
    the range does not begin before its end.
    """
    first, colon, last = text.partition(":")
    try:
        begin, end = float(first), float(last if colon else "nan")
    except ValueError:
        return text
    if not (colon and np.isfinite([begin, end]).all() and begin < end):
        raise IdentificationError(f"{text!r} is not a range of time T0:T1 with T0 < T1")
    return begin, end
