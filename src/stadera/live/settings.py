"""Settings for receiving a running robot's messages."""

from dataclasses import dataclass, field, fields

from stadera.constants import DAY
from stadera.errors import require_positive
from stadera.logs.bags.container import BagSettings
from stadera.trunk.settings import TrunkSettings


@dataclass(frozen=True)
class LiveSettings:
    """Settings of a live session."""

    # largest number of waiting messages; beyond it the oldest are dropped and counted. 4 s of two topics at 500 Hz.
    queue: int = 4000
    batch: float = 0.02  # time over which messages are collected before processing [s]: a block of the estimator
    period: float = 0.1  # interval of the states sent [s]; changes are sent at once
    head: int = 50  # messages of joints that determine the columns and the rate
    # time without a message after which a topic counts as silent [s]: fifty samples of the slowest stream
    silent: float = 1.0
    # difference between a stamp and its topic's clock above which the clock was set, or the message is from another
    # publisher [s]; smaller differences are slewed
    clock_step: float = 0.1
    # time after the last message of a publisher, or on a clock, after which another one is accepted [s]
    other_publisher: float = 0.25
    rate_change: float = 1.5  # factor between two rates above which sampling restarts
    lost: float = 2.5  # periods between two samples above which messages were lost; stamps jitter by up to one
    changes: int = 20  # number of latest changes of the load in every state
    clocks_apart: float = DAY  # difference below which two clocks are taken as synchronised [s]: a day
    least_rate: float = 50.0  # samples a second below which the motion is not resolved
    # length of the stretch at the beginning in which units, signs and order of legs are checked [s]: a few steps, or
    # periods of a sway
    guarded: float = 2.0
    # for decoding and merging. Streams wait for each other at most half a second, any number of stamps that repeat or
    # run back is skipped, and delays of two topics may differ by those of a network.
    bags: BagSettings = field(default_factory=lambda: BagSettings(patience=0.5, out_of_order=1.0, drift=0.05))
    trunk: TrunkSettings = field(default_factory=TrunkSettings)  # settings of the estimator

    def __post_init__(self) -> None:
        require_positive("live setting", self, [f.name for f in fields(self) if f.name not in ("bags", "trunk")])
