"""Values of decoded messages."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stadera.types import Array


class Sample(NamedTuple):
    """The values of one message.

    Attributes:
        topic: of the message.
        received: time of recording [ns].
        stamp: time of measurement [ns].
        frame: of the IMU, without a leading slash; may be empty.
        columns: names of the flat table.
        values: (columns,); NaN where the message marks them as unknown.
    """

    topic: str
    received: int
    stamp: int
    frame: str
    columns: tuple[str, ...]
    values: Array


class SampleBatch(NamedTuple):
    """The values of several messages of one topic, like `Sample` with arrays (n,) and values (n, columns)."""

    topic: str
    received: NDArray[np.int64]
    stamp: NDArray[np.int64]
    frame: str
    columns: tuple[str, ...]
    values: Array
