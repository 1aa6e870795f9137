"""Keeps the clock of a robot's stamps continuous when it is set or restarts."""

from dataclasses import dataclass

from stadera.live.settings import LiveSettings

NS = 1_000_000_000


@dataclass
class _Heard:
    """State of a topic: newest stamp [ns], arrival of its last message on the clock [s], largest stamp minus arrival
    [s].
    """

    newest: int
    arrived: float
    ahead: float


class StreamClock:
    """Keeps the stamps of a robot's topics on one clock.

    A message cannot arrive before it was measured, so stamp minus arrival exceeds its largest value so far only if the
    clock was set forwards. A stamp far behind the topic's newest indicates that the clock was set back, or that the
    publisher restarted. Messages off the clock are skipped as those of a second publisher, unless messages on it have
    stopped: then the clock continues with them, shifted by the difference in arrival, for all topics alike.

    Attributes:
        shift: added to stamps [ns]. steps: number of times the clock was set.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self._step, self._patience = settings.clock_step, settings.other_publisher
        self.shift = self.steps = 0
        self._heard: dict[str, _Heard] = {}

    def at(self, topic: str, stamp: int, arrived: float) -> int | None:
        """The stamp [ns] on the clock; None for a message that is off it.

        Args:
            topic: of the message. stamp: [ns]. arrived: on this machine's monotonic clock [s].
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
