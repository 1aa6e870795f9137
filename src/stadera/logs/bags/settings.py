"""How the messages of a bag become one log."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BagSettings:
    """Limits and tolerances, chosen for robots' logs of 50 Hz to 1 kHz.

    Attributes:
        head: messages of joints at the beginning that decide which columns there are.
        most_ahead: messages to look through for the first one of an IMU.
        batch: messages processed at a time.
        clocks_apart: difference of two topics' clocks above which one is set by the other [s]; a second is far above
            any latency and far below the difference of clocks that were set independently.
        drift: of two topics' clocks since the beginning, above which it is corrected [s]: above what delays scatter by,
            below what weighing feels.
        drift_window: over which a clock's delays are compared [s]: queues are empty once in it.
        header_jump: a stamp that is so much further than the recorder's clock says, or runs so far back, follows a step
            of the clock [s]; ntpd steps a clock by 0.128 s or more and slews it by less.
        patience: how long a sample waits for the other topics [s]; bounds the memory.
        out_of_order: share of stamps that may repeat or run back; above it they are no clock, and the times of
            recording are used.
        out_of_order_from: samples from which that share is evaluated.
        counter_late: stamps up to so much later than the robot's counter are kept [s]: it counts in milliseconds.
        counter_jump: a stamp that is further off the counter follows a step of one of the clocks [s].
        counter_drift: how much faster the robot's clock may run than the recorder's (crystals: 20 to 100 ppm).
    """

    head: int = 2000
    most_ahead: int = 100_000
    batch: int = 4096
    clocks_apart: float = 1.0
    drift: float = 5e-3
    drift_window: float = 5.0
    header_jump: float = 0.1
    patience: float = 10.0
    out_of_order: float = 0.1
    out_of_order_from: int = 100
    counter_late: float = 2e-3
    counter_jump: float = 0.05
    counter_drift: float = 1e-4


DEFAULTS = BagSettings()
