"""The clock of a stream's stamps, kept going when it is set or starts anew."""

from __future__ import annotations

from math import inf

from stadera.live.settings import LiveSettings

NS = 1_000_000_000


class StreamClock:
    """Keeps stamps on one clock.

    A message cannot arrive before it was measured, so stamp less arrival exceeds the largest value seen so far only
    if the clock was set forwards; a stamp far behind the newest one says it was set back, or that the publisher began
    anew. Messages off the clock are left out as a second publisher's, unless those on it have stopped: then the clock
    goes on with them, as much later as they arrived later.

    Args:
        settings: `clock_step` and `other_publisher`.

    Attributes:
        shift: added to stamps [ns]. steps: how often the clock was set. left_out: messages off the clock.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self._step, self._silent = settings.clock_step, settings.other_publisher
        self.shift = self.steps = self.left_out = 0
        self._newest: int | None = None
        self._arrived, self._ahead = 0.0, -inf

    def at(self, stamp: int, arrived: float) -> int | None:
        """The stamp [ns] on the stream's clock; None of a message that is off it.

        Args:
            stamp: of the message [ns]. arrived: by this machine's steady clock [s].
        """
        shifted = stamp + self.shift
        if self._newest is not None and not self._fits(shifted, arrived):
            if arrived - self._arrived < self._silent:
                self.left_out += 1
                return None
            self.steps += 1
            expected = self._newest + round(NS * (arrived - self._arrived))
            self.shift += expected - shifted
            shifted, self._ahead = expected, -inf
        self._newest = shifted if self._newest is None else max(self._newest, shifted)
        self._arrived = arrived
        self._ahead = max(self._ahead, shifted / NS - arrived)
        return shifted

    def _fits(self, shifted: int, arrived: float) -> bool:
        assert self._newest is not None
        return shifted > self._newest - self._step * NS and shifted / NS - arrived < self._ahead + self._step
