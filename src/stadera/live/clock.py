"""The clock of a robot's stamps, kept going when it is set or starts anew."""

from __future__ import annotations

from dataclasses import dataclass

from stadera.live.settings import LiveSettings

NS = 1_000_000_000


@dataclass
class _Heard:
    """Of a topic: newest stamp [ns], arrival of its last message on the clock [s], stamp less arrival at most [s]."""

    newest: int
    arrived: float
    ahead: float


class StreamClock:
    """Keeps the stamps of a robot's topics on one clock.

    A message cannot arrive before it was measured, so stamp less arrival exceeds its largest value so far only if the
    clock was set forwards; a stamp far behind the topic's newest says it was set back, or that the publisher began
    anew. Messages off the clock are left out as a second publisher's, unless those on it have stopped: then the clock
    goes on with them, as much later as they arrived later, for all topics alike.

    Args:
        settings: `clock_step` and `other_publisher`.

    Attributes:
        shift: added to stamps [ns]. steps: how often the clock was set.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self._step, self._patience = settings.clock_step, settings.other_publisher
        self.shift = self.steps = 0
        self._heard: dict[str, _Heard] = {}

    def at(self, topic: str, stamp: int, arrived: float) -> int | None:
        """The stamp [ns] on the clock; None of a message that is off it.

        Args:
            topic: of the message. stamp: [ns]. arrived: by this machine's steady clock [s].
        """
        shifted = stamp + self.shift
        heard = self._heard.setdefault(topic, _Heard(shifted, arrived, shifted / NS - arrived))
        back = shifted < heard.newest - self._step * NS
        if back or shifted / NS - arrived > heard.ahead + self._step:
            if arrived - heard.arrived < self._patience:
                return None
            self.steps += 1
            expected = heard.newest + round(NS * (arrived - heard.arrived))
            self.shift += expected - shifted
            shifted, heard.ahead = expected, expected / NS - arrived
        heard.newest, heard.arrived = max(heard.newest, shifted), arrived
        heard.ahead = max(heard.ahead, shifted / NS - arrived)
        return shifted
