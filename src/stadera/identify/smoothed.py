"""Rows of a part, filtered after they were made.

The equations are exact for the signals at every instant, and not linear in them: low-passing positions first and making
rows from what is left bends them, Coulomb friction's steps above all, while leaving the noise in makes accelerations of
encoder noise. So signals are filtered lightly, rows are made, and the same linear filter then goes over both
sides of the equations, which stay true. Thinned to twice the cut-off, neighbouring rows are nearly independent.
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
    """One set of rows for each joint of the regressor, chunk by chunk, in N·m with unit noise.

    Args:
        part: with its samples at rest, for a filter must not run across holes.
        cutoff_hz: of the rows; None leaves them as they are.
        drop_below: rows with all joints slower than this are left out afterwards [rad/s].
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
