"""Tables with separate rows for joints and IMU, as PlotJuggler writes topics with different stamps."""

from collections.abc import Iterable, Iterator
from itertools import chain

import numpy as np

from stadera.logs.batches import Batch
from stadera.logs.columns import Layout
from stadera.types import Bools

INTERLEAVED = "rows without joint positions are left out; the IMU is interpolated at the stamps of the others"


def is_interleaved(batch: Batch, layout: Layout, few: float = 0.5) -> bool:
    """True if most rows at the log's beginning lack either the joints' values or the IMU's.

    Below a share of `few` complete rows [1] a table counts as interleaved: so many blanks are not a sensor's dropouts.
    """
    if batch.blank is None:
        return False
    joints, imu = _complete(batch, layout)
    if not joints.any():
        return False
    many = int(np.count_nonzero(joints))
    apart = bool(layout.imu) and bool(imu.any()) and bool(np.count_nonzero(joints & imu) < few * many)
    return apart or many < few * len(batch)


def aligned(batches: Iterable[Batch], layout: Layout) -> Iterator[Batch]:
    """Yields the joints' rows, with the IMU's values interpolated at their stamps; blank where the IMU has a gap.

    Args:
        batches: in SI units.
        layout: of their rows.
    """
    from stadera.logs.bags.alignment import Alignment, Track
    from stadera.logs.bags.settings import DEFAULTS

    columns = layout.columns
    of_imu = [columns.index(name) for names in layout.imu.values() for name in names]
    of_joints = [k for k in range(1, len(columns)) if k not in of_imu]
    tracks = [Track("joints", [columns[k] for k in of_joints], DEFAULTS)]
    if of_imu:
        tracks.append(Track("IMU", [columns[k] for k in of_imu], DEFAULTS))
    alignment = Alignment(tracks, DEFAULTS)
    order = np.argsort([0, *of_joints, *of_imu])
    for batch in chain(batches, [None]):
        if batch is not None:
            complete = _complete(batch, layout)
            for track, rows, chosen in zip(tracks, (of_joints, of_imu), complete, strict=False):
                track.extend(np.round(1e9 * batch.values[0, chosen]).astype(np.int64), batch.values[rows][:, chosen].T)
        stamps, values = alignment.rows(final=batch is None)
        if len(stamps):
            cells = np.vstack([stamps / 1e9, values.T])[order]
            yield Batch(cells, np.isnan(cells))


def _complete(batch: Batch, layout: Layout) -> tuple[Bools, Bools]:
    """Rows in which all of the joints' columns have values, and rows in which all of the IMU's have."""
    blank = np.zeros(batch.values.shape, dtype=bool) if batch.blank is None else batch.blank
    imu = {name for names in layout.imu.values() for name in names}
    is_imu = np.array([name in imu for name in layout.columns])
    stamped = ~blank[0]
    return stamped & ~blank[~is_imu].any(axis=0), stamped & ~blank[is_imu].any(axis=0)
