"""Repairs the stamps of a topic's messages by comparing its clock with the recorder's.

A message cannot be recorded before it was stamped, so the least delay so far, received - stamp, is the offset of the
recorder's clock from the sender's. Queues only add to a delay. So a delay below the least one, or a stamp that runs
back by more than messages overtake each other, indicates a step of a clock.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from stadera.logs.bags.settings import DEFAULTS, BagSettings
from stadera.logs.sampling import GAP_FACTOR

Stamps = NDArray[np.int64]

"""Number of messages needed to determine a period."""


class HeaderClock:
    """Stamps from headers with steps of their clock removed; times of recording if the stamps repeat or run back.

    Attributes:
        steps, furthest: number of steps of the headers' clock that were removed, and the largest of them [s].
        silent: True if the headers' stamps are not those of a clock, and times of recording are used.
        delay, first_delay: least delay in the latest complete window [s], and in the first.
    """

    def __init__(self, settings: BagSettings = DEFAULTS) -> None:
        self._settings, self._jump = settings, round(1e9 * settings.header_jump)
        self.steps, self.furthest, self.silent = 0, 0.0, False
        self.delay, self.first_delay = np.nan, np.nan
        self._correction, self._least, self._period = 0, 0, 1
        self._stamp, self._received = 0, 0
        self._seen = self._wrong = 0
        self._window_start, self._window_least, self._windows = 0, np.inf, 0

    def __call__(self, stamps: Stamps, received: Stamps) -> Stamps:
        """The stamps to use for the next messages [ns], given their headers and times of recording."""
        if not self._seen:
            self._stamp, self._received = int(stamps[0]) - 1, int(received[0])
            self._least, self._window_start = int(received[0] - stamps[0]), self._received
        self._decide(stamps)
        undone = received if self.silent else self._without_steps(stamps, received)
        self._watch_delay(undone, received)
        self._stamp, self._received = int(stamps[-1]), int(received[-1])
        return undone

    def _decide(self, stamps: Stamps) -> None:
        """Decides from the beginning of the log whether the stamps are those of a clock."""
        if self._seen < self._settings.head:
            first, self._seen = not self._seen, self._seen + len(stamps)
            self._wrong += int(np.count_nonzero(np.diff(stamps, prepend=self._stamp) <= 0))
            enough = first or self._seen >= self._settings.out_of_order_from
            self.silent = enough and self._wrong > self._settings.out_of_order * self._seen

    def _watch_delay(self, stamps: Stamps, received: Stamps) -> None:
        """Updates the least delays of windows, which show a clock's drift without the effect of queues."""
        self._window_least = min(self._window_least, 1e-9 * float((received - stamps).min()))
        whole = received[-1] - self._window_start > 1e9 * self._settings.drift_window
        if not self._windows:
            self.delay = self.first_delay = self._window_least
        elif whole:
            self.delay = self._window_least
        if whole:
            self._windows, self._window_start, self._window_least = self._windows + 1, int(received[-1]), np.inf

    def _without_steps(self, stamps: Stamps, received: Stamps) -> Stamps:
        """The stamps corrected for all steps so far, including those among them."""
        advance, passed = np.diff(stamps, prepend=self._stamp), np.diff(received, prepend=self._received)
        if len(advance) >= self._settings.counter_enough:
            self._period = max(int(np.median(advance)), 1)
        back, ahead = advance < -self._jump, advance > max(self._jump, GAP_FACTOR * self._period)
        # clocks drift apart, so the least delay may rise
        self._least += round(self._settings.counter_drift * max(int(received[-1]) - self._received, 0))
        out, start = stamps + self._correction, 0
        for k in (*np.flatnonzero(back | ahead).tolist(), len(stamps)):
            self._least = min(self._least, int((received - out)[start:k].min(initial=self._least)))
            start = k
            if k == len(stamps) or (ahead[k] and received[k] - out[k] > self._least - self._jump):
                continue  # the end, a pause, or an emptying queue: the delay is unchanged
            step = int(advance[k]) - max(int(passed[k]), self._period)
            out[k:] -= step
            self._correction -= step
            self._least = int(received[k] - out[k])
            self.steps, self.furthest = self.steps + 1, max(self.furthest, 1e-9 * abs(step))
        return out

    def notes(self, topic: str) -> Iterator[str]:
        """Yields notes on the corrections, one sentence each."""
        if self.silent:
            yield f"the stamps of {topic} repeat or run back: times of recording are used"
        if self.steps:
            yield (
                f"the clock of {topic} steps {self.steps} time{'s' * (self.steps > 1)}, by up to "
                f"{self.furthest:.3g} s: undone by the times of recording"
            )


class TickClock:
    """Stamps for messages without any: the times of recording, corrected by the robot's millisecond counter.

    A stamp more than `counter_late` after the least delay is a late message or a step of the recorder's clock, and gets
    the counter's time. A counter that stands still or restarts is ignored. `repaired` stamps were changed, the
    `furthest` by [s].
    """

    def __init__(self, settings: BagSettings = DEFAULTS) -> None:
        self._late, self._jump = round(1e9 * settings.counter_late), round(1e9 * settings.counter_jump)
        self._drift = settings.counter_drift
        self.repaired, self.furthest = 0, 0.0
        self._offset, self._tick, self._wraps = 0, -1, 0

    def stamp(self, received: int, tick: int) -> int:
        """The stamp [ns] of a message recorded at `received` [ns] with the counter at `tick` [ms, 32 bits]."""
        passed = (tick - self._tick) % (1 << 32) if self._tick >= 0 else 0
        anew = self._tick < 0 or passed == 0 or passed > 1 << 31
        self._wraps += not anew and tick < self._tick
        counted = (tick + (self._wraps << 32)) * 1_000_000
        offset = received - counted
        if anew:
            self._offset = offset
        elif abs(offset - self._offset) < self._jump:
            self._offset = min(offset, self._offset + round(self._drift * passed * 1e6))
        self._tick = tick
        stamp = counted + min(max(offset, self._offset), self._offset + self._late)
        self.repaired += stamp != received
        self.furthest = max(self.furthest, 1e-9 * abs(stamp - received))
        return stamp

    def stamps(self, received: Stamps, ticks: Stamps) -> Stamps:
        """The stamps [ns] of successive messages, as by `stamp`; all at once while the counter neither stands still nor
        restarts and no clock steps.

        The offset o_k = min(offset_k, o_k-1 + d_k) with drifts d_k is a running minimum of offset_k - Σ d.
        """
        passed = np.diff(ticks, prepend=self._tick) % (1 << 32)
        if self._tick >= 0 and ((passed > 0) & (passed <= 1 << 31)).all():
            wraps = self._wraps + np.cumsum(np.diff(ticks, prepend=self._tick) < 0)
            counted = (ticks + (wraps << 32)) * 1_000_000
            offset = received - counted
            drift = np.cumsum(np.round(self._drift * passed * 1e6).astype(np.int64))
            followed = drift + np.minimum(np.minimum.accumulate(offset - drift), self._offset)
            before = np.concatenate([[self._offset], followed[:-1]])
            if (np.abs(offset - before) < self._jump).all():
                stamps = counted + np.minimum(np.maximum(offset, followed), followed + self._late)
                self._tick, self._wraps, self._offset = int(ticks[-1]), int(wraps[-1]), int(followed[-1])
                self.repaired += int(np.count_nonzero(stamps != received))
                self.furthest = max(self.furthest, 1e-9 * int(np.abs(stamps - received).max()))
                return np.asarray(stamps)
        return np.array([self.stamp(*one) for one in zip(received.tolist(), ticks.tolist(), strict=True)])

    def notes(self, topic: str) -> Iterator[str]:
        """Yields notes on the corrections, one sentence each."""
        if self.repaired:
            yield f"{self.repaired} stamps of {topic} corrected by its counter, by at most {1e3 * self.furthest:.3g} ms"
