"""The `real` errors of the test-bed: what robots do and their model files do not say, drawn anew each run."""

from stadera.lab.reality.draw import Drawn, drawn
from stadera.lab.reality.log import TrueMotion, measured_log
from stadera.lab.reality.sizes import REAL_SETS, RealSizes

__all__ = ["REAL_SETS", "Drawn", "RealSizes", "TrueMotion", "drawn", "measured_log"]
