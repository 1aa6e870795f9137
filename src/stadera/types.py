"""Type aliases used throughout the package."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""An array of double-precision numbers."""

Bools = NDArray[np.bool_]
"""An array of truth values."""


class Progress(Protocol):
    """Called with the name of the step, the number of items done, their total (0 if unknown), and a detail."""

    def __call__(self, what: str, done: int, total: int, detail: str = "") -> None: ...
