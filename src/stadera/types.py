"""Types that every room uses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""An array of double-precision numbers."""

Bools = NDArray[np.bool_]
"""An array of truth values."""

Progress = Callable[[str, int, int], None]
"""Called with the name of what is being done, how many of its steps are done, and how many there are (0: not known)."""
