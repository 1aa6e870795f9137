"""The numbers that tune weighing, and a weighing's request, validated where it is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from stadera.checks.limits import WindowLimits
from stadera.errors import IdentificationError, UnknownNameError, require_positive
from stadera.logs import LogFile
from stadera.logs.recording import Recording
from stadera.robot.model import Robot
from stadera.trunk.registry import METHODS
from stadera.trunk.settings import TrunkSettings
from stadera.types import Progress

if TYPE_CHECKING:
    from stadera.trunk.estimator import TrunkEstimator
    from stadera.trunk.samples import Samples

Source = LogFile | Recording
Watch = Callable[["Samples", "TrunkEstimator"], None]
"""Called with samples, IMU values in trunk axes, and the estimator that has taken them in."""
IN_MOTION = "walking"
"""The method that weighs in any motion, by its name in `METHODS`; all others weigh at rest."""


@dataclass(frozen=True)
class WeighSettings:
    """How a log is weighed.

    Attributes:
        least_rate: samples a second that weighing in motion needs at least; between slower ones the motion is not seen.
        jitter: by how much rounded stamps may exceed the longest step that this allows.
        entry: time between two entries of the timeline in motion [s].
        ahead: samples handed to the estimator at once.
        log_gap: time put between the log of a tare and the other log [s].
        trunk: of the estimator that weighs in motion, see `TrunkSettings`.
        block: length of a block at rest [s].
        least_change: share of the robot's mass above which blocks at rest differ by a change of the load.
        change_deviations: standard deviations above which they do; both must hold.
        stale: time from the last rest to the log's end from which a change of the load may have gone unseen [s].
        doubtful_misfit: variance of the masses of blocks at rest over the stated one from which the result is doubtful
            and its error bars are widened.
        windows: when signals contradict each other in part of a log, see `WindowLimits`.
        window: over which encoders, torques and IMU are compared where a log contradicts itself only in part [s].
    """

    least_rate: float = 50.0
    jitter: float = 1.02
    entry: float = 0.1
    ahead: int = 512
    log_gap: float = 10.0
    trunk: TrunkSettings = field(default_factory=TrunkSettings)
    block: float = 0.25
    least_change: float = 0.01
    change_deviations: float = 5.0
    stale: float = 1.0
    doubtful_misfit: float = 3.0
    windows: WindowLimits = field(default_factory=WindowLimits)
    window: float = 0.5

    def __post_init__(self) -> None:
        require_positive("weighing setting", self, [f.name for f in fields(self) if f.name not in ("trunk", "windows")])


@dataclass(frozen=True, eq=False)
class Request:
    """What is to be weighed, and how.

    Attributes:
        robot: with its legs as known; its trunk is the prior.
        source: the log.
        tare: a range of the log's time [s], or another log, in which the robot is without its payload; None for none.
        method: a name of `METHODS`.
        imu_frame: frame of the IMU's values; None for the log's own, else the model's.
        stiffness: of the trunk controller about the trunk's axes [N·m/rad], for the method "orientation".
        force: whether a result that is not to be trusted is given all the same, marked as such.
        settings: see `WeighSettings`.
        progress: called with what is done, and how many samples of it.
        watch: called with the samples, IMU values in trunk axes, and the estimator that took them in; in motion alone.

    Raises:
        UnknownNameError: no such method.
        IdentificationError: the method "orientation" without a stiffness or another one with it, a stiffness that is
            not positive, a tare's range that does not begin before its end.
    """

    robot: Robot
    source: Source
    tare: tuple[float, float] | Source | None
    method: str
    imu_frame: str | None = None
    stiffness: tuple[float, float, float] | None = None
    force: bool = False
    settings: WeighSettings = field(default_factory=WeighSettings)
    progress: Progress | None = None
    watch: Watch | None = None

    def __post_init__(self) -> None:
        if self.watch is not None and self.method != IN_MOTION:
            raise IdentificationError(
                f"{self.source.source}: only weighing in motion, {IN_MOTION!r}, can be watched; this log is weighed by "
                f"{self.method!r}"
            )
        check_choice(self.method, self.stiffness)
        if isinstance(self.tare, tuple) and not self.tare[0] < self.tare[1]:
            raise IdentificationError(f"a tare's range needs a beginning before its end, got {self.tare} s")


def check_choice(method: str | None, stiffness: tuple[float, float, float] | None) -> None:
    """Checks a method, None for one still to be chosen, and the stiffness that goes with it; raises as `Request`."""
    if method is not None and method not in METHODS:
        raise UnknownNameError("method", method, METHODS)
    if stiffness is not None and not (np.isfinite(stiffness).all() and min(stiffness) > 0):
        raise IdentificationError(f"a stiffness must be three positive numbers, got {stiffness}")
    if method == "orientation" and stiffness is None:
        raise IdentificationError(
            "the method 'orientation' weighs by how far the trunk controller's springs give way: it needs their "
            "--stiffness KX,KY,KZ [N·m/rad]; without it use 'contact'"
        )
    if method != "orientation" and stiffness is not None:
        raise IdentificationError(
            f"a stiffness is used by the method 'orientation' alone, not by {method or 'the one chosen without a name'}"
        )


def tare_of(text: str) -> tuple[float, float] | str:
    """A tare as text: a range of time "T0:T1" [s], else the address of a log, as it is.

    Raises:
        IdentificationError: a range that does not begin before its end.
    """
    first, colon, last = text.partition(":")
    try:
        begin, end = float(first), float(last)
    except ValueError:
        return text
    if not (colon and np.isfinite([begin, end]).all() and begin < end):
        raise IdentificationError(f"{text!r} is not a range of time T0:T1 with T0 < T1")
    return begin, end
