"""Places of the model errors of a robot with four legs of three joints, and rows of them, which most tests use."""

import numpy as np

from stadera.trunk.block_rows import WeightedRows
from stadera.trunk.error_model import ErrorLayout
from stadera.types import Array

LAYOUT = ErrorLayout(joints=12, links=12, contacts=4, legs=(3, 3, 3, 3))
PLACES, ERRORS, LEARNT, JOINTS = LAYOUT.places, LAYOUT.count, LAYOUT.learnt, LAYOUT.by_swing


def rows_of(time: float, matrix: Array, errors: Array, target: Array, white: float) -> WeightedRows:
    """A block's rows from A (6, 10), C (6, errors) and b (6,)."""
    return WeightedRows(time, np.hstack([matrix, target[:, None], errors]), white)
