"""Makes rows first and low-passes them afterwards.

The equations hold exactly at every instant but are not linear in the signals. Low-passing positions first distorts
them, above all the steps of Coulomb friction, while unfiltered encoder noise dominates the accelerations. So signals
are filtered lightly, rows are made, and the same linear filter is applied to both sides of the equations, which then
still hold. Thinned to twice the cut-off, neighbouring rows are nearly independent.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np

from stadera.identify.log import Part
from stadera.identify.residuals import rows_of, speed
from stadera.legs import JointTorqueRegressor, Rows, TrunkMotion
from stadera.logs.processing import Processed
from stadera.logs.smoothing import smooth_rows
from stadera.types import Array


def smoothed_rows(
    regressor: JointTorqueRegressor, part: Part, trunk: TrunkMotion, cutoff_hz: float | None, drop_below: float
) -> Iterator[tuple[Rows, ...]]:
    """Yields one set of rows for each joint of the regressor, chunk by chunk, in N·m with unit noise.

    Args:
        part: including its samples at rest, since a filter must not run across gaps.
        cutoff_hz: of the rows; None for no filter.
        drop_below: rows in which all joints are slower than this are removed after filtering [rad/s].
    """
    for stream in part.streams():
        first = next(stream, None)
        if first is None:
            continue
        chunks = chain([first], stream)
        if cutoff_hz is None:
            yield from (_plain(regressor, chunk, trunk, drop_below) for chunk in chunks)
        else:
            yield from _filtered(regressor, chunks, trunk, first.report.rate_hz, cutoff_hz, drop_below)


def _plain(
    regressor: JointTorqueRegressor, chunk: Processed, trunk: TrunkMotion, drop_below: float
) -> tuple[Rows, ...]:
    moving = speed(regressor, chunk) >= drop_below
    every = tuple(rows_of(regressor, chunk, trunk))
    if moving.all():
        return every
    return tuple(rows.replaced(rows.reduced[moving], rows.target[moving]) for rows in every)


def _filtered(
    regressor: JointTorqueRegressor,
    chunks: Iterator[Processed],
    trunk: TrunkMotion,
    rate_hz: float,
    cutoff_hz: float,
    drop_below: float,
) -> Iterator[tuple[Rows, ...]]:
    kinds: list[Rows] = []

    def stacked() -> Iterator[tuple[Array, Array]]:
        for chunk in chunks:
            every = list(rows_of(regressor, chunk, trunk))
            kinds[:] = every
            sides = [side for rows in every for side in (rows.reduced, rows.target[:, None])]
            yield chunk.time, np.concatenate([*sides, speed(regressor, chunk)[:, None]], axis=1)

    for _, values in smooth_rows(stacked(), rate_hz, cutoff_hz):
        values = values[values[:, -1] >= drop_below]
        edges = np.cumsum([0, *(kind.reduced.shape[1] + 1 for kind in kinds)])
        yield tuple(
            kind.replaced(values[:, start : stop - 1], values[:, stop - 1])
            for kind, start, stop in zip(kinds, edges[:-1], edges[1:], strict=True)
        )
