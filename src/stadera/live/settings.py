"""How a running robot's messages are taken in."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from stadera.errors import require_positive
from stadera.logs.bags.settings import BagSettings
from stadera.trunk.settings import TrunkSettings


@dataclass(frozen=True)
class LiveSettings:
    """Settings of a live session.

    Attributes:
        queue: messages that wait at most; of more the oldest are dropped, and counted. 4 s of two topics at 500 Hz.
        batch: time over which messages are gathered before they are worked on [s]: a block of the estimator.
        period: between two states that are sent [s]; changes are sent at once.
        head: messages of joints that decide which columns there are and how fast they come.
        silent: time without a message after which a topic counts as silent [s]: fifty samples of the slowest stream.
        clock_step: difference between a stamp and its topic's clock from which the clock was set, or the message is
            another publisher's [s]; clocks are slewed, not set, by less.
        other_publisher: time after the last message of a publisher, or on a clock, from which another one is taken [s].
        rate_change: factor between two rates from which sampling begins anew.
        least_rate: samples a second below which the motion between them is not seen.
        bags: of decoding and merging. Streams wait for one another half a second at most, stamps that repeat or run
            back are left out however many they are, and delays of two topics may differ by what a network adds.
        trunk: of the estimator.
    """

    queue: int = 4000
    batch: float = 0.02
    period: float = 0.1
    head: int = 50
    silent: float = 1.0
    clock_step: float = 0.1
    other_publisher: float = 0.25
    rate_change: float = 1.5
    least_rate: float = 50.0
    bags: BagSettings = field(default_factory=lambda: BagSettings(patience=0.5, out_of_order=1.0, drift=0.05))
    trunk: TrunkSettings = field(default_factory=TrunkSettings)

    def __post_init__(self) -> None:
        require_positive("live setting", self, [f.name for f in fields(self) if f.name not in ("bags", "trunk")])
