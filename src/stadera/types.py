"""Type aliases used throughout the package."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""An array of double-precision numbers."""

Bools = NDArray[np.bool_]
"""An array of truth values."""

Progress = Callable[[str, int, int], None]
"""Called with the name of the step, the number of items done, and their total (0 if unknown)."""
