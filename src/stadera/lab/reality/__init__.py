"""The `real` errors of the test-bed: differences between robots and their model files, drawn for each run."""

from stadera.lab.reality.draw import Drawn, drawn, with_usual_drives
from stadera.lab.reality.log import TrueMotion, measured_log
from stadera.lab.reality.sizes import REAL_SETS, RealSizes

__all__ = ["REAL_SETS", "Drawn", "RealSizes", "TrueMotion", "drawn", "measured_log", "with_usual_drives"]
