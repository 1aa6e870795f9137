"""Rows `A θ = b` with known noise: the interface between measurements and solvers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.errors import IdentificationError
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class Rows:
    """Linear equations `matrix @ θ[columns] = target` with independent noise of standard deviation `std`.

    Some columns of rigid-body rows are linearly dependent in any motion: a link's mass acts on its parent's joint like
    a certain moment and inertia of the parent. Then `matrix = reduced @ mixing`, with fewer columns to compute, filter
    and sum up.

    IdentificationError for inconsistent shapes, or a std that is not positive and finite. Finite values of matrix and
    target are checked when they are summed up.
    """

    columns: tuple[str, ...]  # names of the parameters of the matrix's columns; parameters not named have zero columns
    reduced: Array  # (rows, k), the matrix itself if there is no mixing
    target: Array  # (rows,)
    std: float | Array = 1.0  # noise of the target, one number or (rows,), in the target's unit; positive
    mixing: Array | None = None  # (k, columns); None for the identity

    def __post_init__(self) -> None:
        rows, width = len(self.target), len(self.columns if self.mixing is None else self.mixing)
        if self.reduced.shape != (rows, width):
            raise IdentificationError(f"rows need a matrix of shape {(rows, width)}, got {self.reduced.shape}")
        if self.mixing is not None and self.mixing.shape != (width, len(self.columns)):
            raise IdentificationError(
                f"rows need a mixing of shape {(width, len(self.columns))}, got {self.mixing.shape}"
            )
        std = np.asarray(self.std)
        if std.shape not in ((), (rows,)) or not ((std > 0) & (std < np.inf)).all():
            raise IdentificationError(
                f"the standard deviation of rows must be one number or {rows}, positive and finite"
            )

    def __len__(self) -> int:
        return len(self.target)

    @property
    def matrix(self) -> Array:
        """The matrix of all columns, (rows, columns)."""
        return self.reduced if self.mixing is None else self.reduced @ self.mixing

    def replaced(self, reduced: Array, target: Array) -> Rows:
        """Rows of the same kind and unit noise with other values, such as a selection or filtered rows."""
        return Rows(self.columns, reduced, target, mixing=self.mixing)

    def predict(self, values: Array) -> Array:
        """Target predicted from parameters (ordered as `columns`), shape (rows,)."""
        return np.asarray(self.reduced @ (values if self.mixing is None else self.mixing @ values))


def discounted(rows: Array, errors: Array) -> Array:
    """Rows (..., k, n) of unit noise with errors E p, E (..., k, m) and p of unit variance that changes from one set of
    rows to the next, as rows of unit noise: (1 + E Eᵀ)^-1/2 times them. So what E hides counts for next to nothing.
    """
    if not errors.any():
        return rows
    value, vector = np.linalg.eigh(errors @ errors.swapaxes(-1, -2))
    return np.asarray((vector / np.sqrt(1.0 + value)[..., None, :]) @ (vector.swapaxes(-1, -2) @ rows))
