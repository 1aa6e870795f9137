"""The square-root information: everything that rows have said of the parameters, in a triangle that never grows.

Rows `A θ = b` (divided by their noise) are summed up by the triangular factor of a QR::

    [A b] = Q [R z]        ‖A θ - b‖² = ‖R θ - z‖² + ρ²  for every θ
              [0 ρ]

so R, z, ρ and the number of rows hold all that least squares can ever ask of the rows: batch, recursive, forgetting,
merging of logs and prior information are all done on them. Working on R instead of AᵀA keeps twice the digits.
Householder QR treats each column by itself, so a column's unit does not matter here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from stadera.errors import IdentificationError, UnknownNameError
from stadera.identify.compress import Compressor, triangularize
from stadera.regressors.rows import Rows

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Information:
    """What is known of named parameters, as `R θ = z` with unit noise.

    Attributes:
        columns: names of the n parameters.
        R: (n, n) upper triangular, each row in units of 1/parameter.
        z: (n,).
        rho_squared: the part of the sum of squares that no parameters can explain.
        count: how many rows went in (after forgetting: their sum of weights).
    """

    columns: tuple[str, ...]
    R: Array
    z: Array
    rho_squared: float = 0.0
    count: float = 0.0

    @classmethod
    def empty(cls, columns: tuple[str, ...]) -> Information:
        """Nothing known yet."""
        n = len(columns)
        return cls(columns, np.zeros((n, n)), np.zeros(n))

    @classmethod
    def of(cls, rows: Iterable[Rows], columns: tuple[str, ...]) -> Information:
        """Everything a stream of rows says; memory does not grow with its length."""
        compressor, n = Compressor(columns), len(columns)
        with _blas().limit(limits=1, user_api="blas"):  # the factors are small: two threads would wait for each other
            for r in rows:
                compressor.add(r)
            triangle = compressor.triangle()
        return cls(columns, triangle[:n, :n], triangle[:n, n], _tail(triangle), float(compressor.count))

    def __post_init__(self) -> None:
        n = len(self.columns)
        if self.R.shape != (n, n) or self.z.shape != (n,):
            raise IdentificationError(
                f"information on {n} parameters needs R {(n, n)} and z {(n,)}, got {self.R.shape}, {self.z.shape}"
            )

    # -- growing ----------------------------------------------------------------------------------------------
    def add(self, rows: Rows | Iterable[Rows]) -> Information:
        """With more rows."""
        return self.merge(Information.of([rows] if isinstance(rows, Rows) else rows, self.columns))

    def merge(self, other: Information) -> Information:
        """With all that another information on the same parameters holds (any order of names).

        Raises:
            UnknownNameError: the other has a parameter that this one has not.
        """
        order = self.indices(other.columns)
        spread = np.zeros((len(other.columns), len(self.columns)))
        spread[:, order] = other.R
        stacked = np.vstack((np.column_stack((self.R, self.z)), np.column_stack((spread, other.z))))
        triangle = triangularize(stacked)
        rho = self.rho_squared + other.rho_squared + _tail(triangle)
        n = len(self.columns)
        return Information(self.columns, triangle[:n, :n], triangle[:n, n], rho, self.count + other.count)

    def forget(self, factor: float) -> Information:
        """With everything so far worth `factor` (0 to 1) of what it was; 1 changes nothing.

        Raises:
            IdentificationError: a factor outside 0 to 1.
        """
        if not 0.0 <= factor <= 1.0:
            raise IdentificationError(f"a forgetting factor lies between 0 and 1, got {factor}")
        root = np.sqrt(factor)
        return Information(self.columns, root * self.R, root * self.z, factor * self.rho_squared, factor * self.count)

    # -- narrowing --------------------------------------------------------------------------------------------
    def fix(self, values: Mapping[str, float]) -> Information:
        """The information on the other parameters when these are known: the paper's eq. 6.

        Their contribution moves to the right-hand side, Y_id φ_id = τ - Y_f φ_f.

        Raises:
            UnknownNameError: a name that is not among the columns.
        """
        fixed = self.indices(tuple(values))
        keep = [k for k in range(len(self.columns)) if k not in set(fixed)]
        target = self.z - self.R[:, fixed] @ np.array(list(values.values()), dtype=float)
        return self._reduced(self.R[:, keep], target, keep)

    def marginal(self, columns: tuple[str, ...]) -> Information:
        """What is known of these parameters when nothing is assumed of the others, in the order asked for.

        The rows are projected onto the orthogonal complement of the other parameters' columns; directions of the
        others that were never seen bind nothing and drop out.
        """
        keep = self.indices(columns)
        away = [k for k in range(len(self.columns)) if k not in set(keep)]
        others = self.R[:, away] / self.column_scales()[away]
        U, s, _ = np.linalg.svd(others)
        rank = int(np.sum(s > 1e-12 * s.max(initial=0.0)))
        complement = U[:, rank:].T
        return self._reduced(complement @ self.R[:, keep], complement @ self.z, keep)

    def scaled_noise(self, std: float) -> Information:
        """The same rows with their noise multiplied by `std`, for rows that went in with a noise yet unknown."""
        if not std > 0:
            raise IdentificationError(f"a noise must be positive, got {std}")
        return Information(self.columns, self.R / std, self.z / std, self.rho_squared / std**2, self.count)

    def indices(self, names: tuple[str, ...]) -> list[int]:
        """Where these parameters stand among the columns."""
        position = {name: k for k, name in enumerate(self.columns)}
        for name in names:
            if name not in position:
                raise UnknownNameError("parameter", name, self.columns)
        return [position[name] for name in names]

    def _reduced(self, matrix: Array, target: Array, keep: list[int]) -> Information:
        triangle = triangularize(np.column_stack((matrix, target)))
        n = len(keep)
        columns = tuple(self.columns[k] for k in keep)
        return Information(columns, triangle[:n, :n], triangle[:n, n], self.rho_squared + _tail(triangle), self.count)

    # -- asking -----------------------------------------------------------------------------------------------
    def residual_squared(self, values: Array) -> float:
        """‖A θ - b‖² over all rows that went in, in units of their noise, for parameters (n,)."""
        return float(np.sum((self.R @ values - self.z) ** 2) + self.rho_squared)

    def rank(self) -> int:
        """How many directions the rows know at all, to rounding."""
        return int(np.linalg.matrix_rank(self.R / self.column_scales(), tol=1e-10))

    def least_squares(self) -> dict[str, float]:
        """The plain least-squares solution by name, of smallest norm in units of the columns where it is not unique."""
        scale = self.column_scales()
        solution = np.linalg.lstsq(self.R / scale, self.z, rcond=1e-10)[0] / scale
        return dict(zip(self.columns, solution.tolist(), strict=True))

    def column_scales(self) -> Array:
        """‖A's column‖ for each parameter, (n,): how much of the data moves with it; 1 where nothing does."""
        norms = np.linalg.norm(self.R, axis=0)
        return np.where(norms > 0, norms, 1.0)


def _tail(triangle: Array) -> float:
    return float(triangle[-1, -1] ** 2)


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
