"""Summing rows up: the triangular factor of ever more rows, block by block.

A block of rows is taken into the triangle of those so far by the QR of a triangle on top of a rectangle (LAPACK's
`tpqrt`): memory does not grow, and no AᵀA is formed, which would halve the digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from stadera.errors import IdentificationError, UnknownNameError
from stadera.regressors.rows import Rows

Array = NDArray[np.float64]

_ROWS = 4096  # of a block, which stays in the processor's cache
_PANEL = 8  # columns that are reflected at once


def triangularize(matrix: Array) -> Array:
    """The triangular factor of a matrix (rows, n), as a full (n, n) block; zero rows fill up a short matrix."""
    rows, n = matrix.shape
    if not matrix.any():
        return np.zeros((n, n))
    factor, _, _, _ = lapack.dgeqrf(np.asfortranarray(matrix), overwrite_a=False)
    triangle = np.zeros((n, n))
    top = min(rows, n)
    triangle[:top] = np.triu(factor[:top])
    return triangle


@dataclass(eq=False)
class _Kind:
    """The triangle of [reduced, target] of rows that share columns and mixing, and room for a block of them."""

    mixing: Array | None
    triangle: Array
    room: Array

    def take(self, sides: Array, target: Array, scale: Array) -> None:
        """Takes columns (n, rows) and their target (rows,) in, multiplied by scale, one number or (rows,)."""
        n = len(sides)
        block = self.room[: (n + 1) * len(target)].reshape(n + 1, -1)
        np.multiply(sides, scale, out=block[:n])
        np.multiply(target, scale, out=block[n])
        panel = min(_PANEL, n + 1)
        self.triangle, *_ = lapack.dtpqrt(0, panel, self.triangle, block.T, overwrite_a=True, overwrite_b=True)


class Compressor:
    """Sums up a stream of rows: one triangle for each kind that comes along, all merged once at the end.

    With A = reduced mixing, the triangle [R z] of the reduced rows becomes [R mixing, z] of all columns.

    Args:
        columns: names of all parameters.
    """

    def __init__(self, columns: tuple[str, ...]) -> None:
        self.columns = columns
        self.count = 0
        self._kinds: dict[tuple[tuple[str, ...], int | None], _Kind] = {}

    def add(self, rows: Rows) -> None:
        """Takes rows in."""
        kind = self._kind(rows)
        sides, target, weight = rows.reduced.T, rows.target, 1.0 / np.asarray(rows.std)
        for start in range(0, len(rows), _ROWS):
            part = slice(start, start + _ROWS)
            kind.take(sides[:, part], target[part], weight[part] if weight.ndim else weight)
        self.count += len(rows)

    def triangle(self) -> Array:
        """Of everything so far, (n + 1, n + 1), the target last.

        Raises:
            UnknownNameError: rows came with a parameter that is not among the columns.
            IdentificationError: rows held values that are not finite.
        """
        n = len(self.columns)
        position = {name: k for k, name in enumerate(self.columns)}
        blocks = [np.zeros((1, n + 1))]
        for (columns, _), kind in self._kinds.items():
            for name in columns:
                if name not in position:
                    raise UnknownNameError("parameter", name, self.columns)
            own = np.triu(kind.triangle)
            spread = np.zeros((len(own), n + 1))
            spread[:, [position[c] for c in columns]] = (
                own[:, :-1] if kind.mixing is None else own[:, :-1] @ kind.mixing
            )
            spread[:, n] = own[:, -1]
            blocks.append(spread)
        stacked = np.vstack(blocks)
        if not np.isfinite(stacked).all():
            raise IdentificationError("rows hold values that are not finite")
        return triangularize(stacked)

    def _kind(self, rows: Rows) -> _Kind:
        key = rows.columns, None if rows.mixing is None else id(rows.mixing)
        if key not in self._kinds:
            width = rows.reduced.shape[1] + 1
            self._kinds[key] = _Kind(rows.mixing, np.zeros((width, width), order="F"), np.empty(width * _ROWS))
        return self._kinds[key]
