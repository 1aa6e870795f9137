"""Settings for reading a bag's messages as one log."""

from dataclasses import dataclass

from stadera.errors import require_positive


@dataclass(frozen=True)
class BagSettings:
    """Limits and tolerances, chosen for robots' logs of 50 Hz to 1 kHz."""

    head: int = 2000  # messages of joints at the beginning that determine the columns
    most_ahead: int = 100_000  # messages searched for the first one of an IMU
    batch: int = 4096  # messages processed at a time
    # difference between two topics' clocks above which one is set from the other [s]; one second is far above any
    # latency and far below the difference of independently set clocks
    clocks_apart: float = 1.0
    # of two topics' clocks since the beginning above which it is corrected [s]: above the scatter of the delays, below
    # what affects weighing
    drift: float = 5e-3
    drift_window: float = 5.0  # over which a clock's delays are compared [s]; queues are empty at least once in it
    # difference from the recorder's clock, or run back, above which a stamp indicates a step of the clock [s]; ntpd
    # steps a clock by 0.128 s or more and slews it by less
    header_jump: float = 0.1
    patience: float = 10.0  # time for which a sample waits for the other topics [s]; bounds the memory
    # share of stamps that repeat or run back above which they are not those of a clock, and the times of recording are
    # used
    out_of_order: float = 0.1
    out_of_order_from: int = 100  # samples needed to evaluate that share
    # stamps up to this much later than the robot's counter are kept [s]: it counts in milliseconds
    counter_late: float = 2e-3
    counter_jump: float = 0.05  # difference between stamp and counter above which one of the clocks has stepped [s]
    # relative rate by which the robot's clock may run faster than the recorder's (crystals: 20 to 100 ppm)
    counter_drift: float = 1e-4
    counter_enough: int = 32  # number of ticks in a batch whose median is the counter's period

    def __post_init__(self) -> None:
        require_positive("setting of a bag", self, self.__dataclass_fields__)


DEFAULTS = BagSettings()
