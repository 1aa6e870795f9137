"""The `real` errors of the test-bed: differences between robots and their model files, drawn for each run."""

from stadera.lab.reality.draw import REAL_SETS, DrawnRobot, RealSizes, drawn, with_usual_drives
from stadera.lab.reality.log import TrueMotion, measured_log

__all__ = ["REAL_SETS", "DrawnRobot", "RealSizes", "TrueMotion", "drawn", "measured_log", "with_usual_drives"]
