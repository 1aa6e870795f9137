"""Settings and state of a live session: the estimates at one instant, with statistics of the messages."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import nan
from typing import Any

from stadera.constants import DAY
from stadera.errors import require_positive
from stadera.logs.bags.container import BagSettings
from stadera.report.numbers import number, with_std
from stadera.results import finite_or_none
from stadera.trunk.load import LoadChange, Payload
from stadera.trunk.result import TrunkParameters
from stadera.trunk.settings import TrunkSettings
from stadera.trust import Trust


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
    # for decoding and merging. Streams wait for each other at most half a second; stamps that repeat or run back are
    # skipped, of messages that come twice every other one, but if most do they are no clock's; and delays of two topics
    # may differ by those of a network.
    bags: BagSettings = field(default_factory=lambda: BagSettings(patience=0.5, out_of_order=0.5, drift=0.05))
    trunk: TrunkSettings = field(default_factory=TrunkSettings)  # settings of the estimator

    def __post_init__(self) -> None:
        require_positive("live setting", self, [f.name for f in fields(self) if f.name not in ("bags", "trunk")])


BODY = ("mass [kg]", "com x [m]", "com y [m]", "com z [m]")
"""Values of a body that are shown to people."""


@dataclass(frozen=True, eq=False)
class LiveState:
    """State at one instant."""

    robot: str
    link: str  # the trunk's name, whose frame is used for all values
    time: float  # of the newest sample used [s], NaN before the first; on the stamps' clock until that was first set
    stamp: int  # of that sample on its own clock [ns], 0 before the first
    status: str  # of the estimator, see `stadera.trunk.protocol.Status`
    trunk: TrunkParameters  # including everything attached; the model's values where nothing was observed
    payload: Payload | None  # mass added since the tare; None without one
    changes: tuple[LoadChange, ...]
    trust: Trust
    rates: Mapping[str, float]  # messages a second, by topic
    # number of messages that did not reach the estimator, by reason: "network", "queue", "damaged", "left out"
    # (repeated stamps, a second publisher, missing values)
    lost: Mapping[str, int]
    # age of the estimate [s]: from the arrival of the newest message used until now, and from its stamp until now on
    # this machine's clock, meaningful if the clocks agree; NaN before the first
    lag: tuple[float, float]
    waiting_for: tuple[str, ...] = ()  # missing input, one sentence each; empty while samples arrive
    notes: tuple[str, ...] = ()  # events, one sentence each
    spikes: int = 0  # samples of which single wild values were replaced since the estimates began
    impacts: float = 0.0  # s, left out since then because the rate does not resolve impacts
    begin: float = 0.0  # time of the first sample used [s], from which times that a person reads are counted
    tared_at: float = nan  # time of the newest sample used at the tare [s], NaN without one

    def since(self, time: float) -> float:
        """Time since the first sample [s] of one on the state's clock."""
        return time - self.begin

    @property
    def is_trusted(self) -> bool:
        """True unless the verdict is "bad"."""
        return self.trust.verdict != "bad"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; null for unobserved quantities, "trusted": false if the verdict is bad."""
        mark = {} if self.is_trusted else {"trusted": False}
        return {
            "robot": self.robot,
            "time": finite_or_none(self.time),
            "status": self.status,
            "trunk": self.trunk.to_dict(mark) | {"frame": self.link},
            "payload": None if self.payload is None else self.payload.to_dict(self.link, mark),
            "changes": [change.to_dict(mark) for change in self.changes],
            "trust": self.trust.to_dict(),
            "rates": {topic: round(rate, 2) for topic, rate in self.rates.items()},
            "lost": dict(self.lost),
            "lag": dict(zip(("processing", "stamp"), map(finite_or_none, self.lag), strict=True)),
            "waiting_for": list(self.waiting_for),
            "notes": list(self.notes),
            "spikes": self.spikes,
            "impacts": self.impacts,
        }

    @property
    def mark(self) -> str:
        """What follows a value: nothing, or that it is not to be trusted."""
        return "" if self.is_trusted else " (not to be trusted)"

    def bodies(self) -> dict[str, list[str]]:
        """`BODY` of the trunk, and after a tare of the payload, as text with standard deviations."""
        trunk, payload = self.trunk, self.payload
        found = {"trunk": (trunk.inertial.mass, trunk.mass_std, trunk.com, trunk.com_std)}
        if payload is not None:
            found["payload"] = (payload.mass, payload.mass_std, payload.com, payload.com_std)
        return {
            name: [with_std(mass, std), *map(with_std, com.tolist(), com_std.tolist())]
            for name, (mass, std, com, com_std) in found.items()
        }

    def figures(self) -> dict[str, str]:
        """The values as text with units and standard deviations, for people."""
        bodies = [(name, *each) for name, texts in self.bodies().items() for each in zip(BODY, texts, strict=True)]
        shown = {f"{name} {quantity}": f"{text}{self.mark}" for name, quantity, text in bodies}
        if self.payload is not None and self.payload.at:
            shown["payload at"] = self.payload.at
        for change in self.changes[-1:]:
            shown["last change [kg]"] = (
                f"{change.kind} at {self.since(change.time):.2f} s, {with_std(change.mass, change.mass_std)}"
            )
        misfit = number(self.trust.misfit, 3, "not evaluated")
        shown["trust"] = f"{self.trust.verdict}, misfit {misfit}"
        shown |= {f"rate of {topic} [Hz]": f"{rate:.1f}" for topic, rate in self.rates.items()}
        shown["lost"] = ", ".join(f"{where} {count}" for where, count in self.lost.items() if count) or "none"
        shown["outliers replaced"] = f"{self.spikes}"
        shown["left out for impacts [s]"] = f"{self.impacts:.2f}"
        shown["lag [ms]"] = number(1e3 * self.lag[0], 3, "none yet")
        return shown
