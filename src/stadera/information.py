"""Square-root information: the information of any number of least-squares rows, kept as one triangular factor.

Rows ``H x + B p = y`` of unit noise, x the unknowns and p errors of unit covariance that are not estimated, are summed
up by the triangular factor of a QR::

    [H y B] = Q [R z G]        |H x - y|² = |R x - z|² + ρ²  for every x (p = 0)
                [0 ρ *]

Batch and recursive least squares, forgetting, merging and prior information are operations on R, z, G and ρ. R has
twice the digits of HᵀH, and a column's unit does not matter, for Householder QR treats each column by itself.

The errors p are consider parameters (Schmidt 1966): the estimate R⁻¹z takes them for zero and is off by R⁻¹G p, so its
covariance is ``R⁻¹R⁻ᵀ + (R⁻¹G)(R⁻¹G)ᵀ``. An error that acts alike on two unknowns cancels in their difference.

Unknowns are named blocks, of one entry or more: ``known.mean[known["theta"]]``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lapack

from stadera.body.rows import Rows
from stadera.errors import IdentificationError, UnknownNameError
from stadera.process import one_thread
from stadera.types import Array

Places = NDArray[np.intp]

_DEPENDENT = 1e-12  # share of a column's norm below which the remainder is rounding error
_BLOCK = 4096  # rows reduced at once; a block fits into the processor's cache
_PANEL = 8  # columns reflected at once
_PANEL_OF_BLOCKS = 4  # the same for blocks of thousands of rows


@dataclass(frozen=True)
class Unknowns:
    """Order and sizes of the named blocks of unknowns. Raises IdentificationError: duplicate names, or sizes that are
    not one positive integer per name.
    """

    names: tuple[str, ...]
    sizes: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(set(self.names)) < len(self.names):
            raise IdentificationError(f"unknowns need names of their own, got {', '.join(self.names)}")
        if len(self.sizes) != len(self.names) or not all(size > 0 for size in self.sizes):
            raise IdentificationError(f"{len(self.names)} blocks of unknowns need as many sizes, got {self.sizes}")

    @classmethod
    def of(cls, **sizes: int) -> Unknowns:
        """Blocks given by name and size: ``Unknowns.of(theta=10, bias=3)``."""
        return cls(tuple(sizes), tuple(sizes.values()))

    @classmethod
    def scalars(cls, names: Iterable[str]) -> Unknowns:
        """One scalar unknown for each name."""
        names = tuple(names)
        return cls(names, (1,) * len(names))

    def __len__(self) -> int:
        return self._edges[-1]

    def __getitem__(self, name: str) -> slice:
        """Index range of a block's entries. Raises UnknownNameError: no such block."""
        k = self._places.get(name)
        if k is None:
            raise UnknownNameError("parameter", name, self.names)
        return slice(self._edges[k], self._edges[k + 1])

    def index(self, names: Iterable[str]) -> Places:
        """Indices of the entries of several blocks, in the given order."""
        parts = [np.arange(s.start, s.stop) for s in map(self.__getitem__, names)]
        return np.concatenate(parts) if parts else np.zeros(0, dtype=np.intp)

    def only(self, names: Iterable[str]) -> Unknowns:
        """The named blocks only, in the given order."""
        names = tuple(names)
        return Unknowns(names, tuple(self[name].stop - self[name].start for name in names))

    def without(self, names: Iterable[str]) -> Unknowns:
        """All blocks except the named ones."""
        left_out = set(names)
        return self.only(name for name in self.names if name not in left_out)

    @cached_property
    def _edges(self) -> list[int]:
        return [0, *np.cumsum(self.sizes, dtype=int).tolist()]

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.names)}


@dataclass(frozen=True, eq=False)
class Information:
    """Information on n unknowns, stored as ``R x + G p = z`` with unit noise.

    Attributes:
        unknowns: names and sizes of the blocks.
        R: (n, n), upper triangular, each column in units of 1/unknown; singular if some direction is unknown.
        z: (n,).
        G: (n, q), sensitivity to the q considered errors.
        cost: ρ², the sum of squared residuals that no x explains.
        count: number of rows added; after forgetting, the sum of their weights.

    Raises:
        IdentificationError: inconsistent shapes.
    """

    unknowns: Unknowns
    R: Array
    z: Array
    G: Array
    cost: float = 0.0
    count: float = 0.0

    @classmethod
    def empty(cls, unknowns: Unknowns | Iterable[str], considered: int = 0) -> Information:
        """No information, on named blocks or on one scalar unknown for each name."""
        layout = _layout(unknowns)
        n = len(layout)
        return cls(layout, np.zeros((n, n)), np.zeros(n), np.zeros((n, considered)))

    @classmethod
    def of(cls, rows: Iterable[Rows], unknowns: Unknowns | Iterable[str]) -> Information:
        """Sums up a stream of rows on scalar unknowns. Memory does not grow with the length of the stream.

        Raises:
            UnknownNameError: rows with a parameter that is not one of the unknowns.
            IdentificationError: rows with non-finite values.
        """
        layout = _layout(unknowns)
        kinds, count = _Kinds(), 0
        with one_thread():
            for r in rows:
                _add(r, kinds)
                count += len(r)
            return _triangular(layout, _stacked(kinds, layout), count=float(count))

    @classmethod
    def of_posterior(
        cls, unknowns: Unknowns | Iterable[str], mean: Array, covariance: Array, prior: Array, least: float = 0.1
    ) -> Information:
        """Of rows that turned N(0, `prior`) into N(`mean`, `covariance`): RᵀR = Σ⁻¹ - P⁻¹, Rᵀz = Σ⁻¹ mean.

        Args:
            least: information of a direction, in units of the prior's, below which it is left out [1].
        """
        root = np.linalg.cholesky(prior)
        inside = np.linalg.solve(root, np.linalg.solve(root, covariance).T)
        sizes, axes = np.linalg.eigh(0.5 * (inside + inside.T))
        kept = 1.0 / sizes - 1.0 > least
        gained, axes = 1.0 / sizes[kept] - 1.0, axes[:, kept]
        H = np.sqrt(gained)[:, None] * np.linalg.solve(root.T, axes).T
        z = (1.0 + gained) / np.sqrt(gained) * (axes.T @ np.linalg.solve(root, mean))
        return _triangular(_layout(unknowns), np.column_stack((H, z)))

    def __post_init__(self) -> None:
        n = len(self.unknowns)
        if self.R.shape != (n, n) or self.z.shape != (n,) or len(self.G) != n:
            raise IdentificationError(
                f"information on {n} unknowns needs R {(n, n)} and z {(n,)}, got {self.R.shape}, {self.z.shape}"
            )

    def __len__(self) -> int:
        return len(self.z)

    def __getitem__(self, name: str) -> slice:
        """Index range of a block of unknowns."""
        return self.unknowns[name]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return self.unknowns.names

    # -- more rows --------------------------------------------------------------------------------------------------
    def add(self, matrix: Array, target: Array, considered: Array | None = None) -> Information:
        """Returns the information with more rows of unit noise on all unknowns.

        Args:
            matrix, target: H (rows, n) and y (rows,).
            considered: B (rows, q); None if the considered errors do not affect these rows.
        """
        n, rows, q = len(self), len(target), self.G.shape[1]
        if not rows:
            return self
        # the QR of a triangle on top of a rectangle, and its reflections of the right-hand sides
        R, V, T, _ = lapack.dtpqrt(0, min(_PANEL, n), self.R, matrix)
        above, below = np.empty((n, 1 + q), order="F"), np.zeros((rows, 1 + q), order="F")
        above[:, 0], above[:, 1:], below[:, 0] = self.z, self.G, target
        if considered is not None:
            below[:, 1:] = considered
        above, below, _ = lapack.dtpmqrt(0, V, T, above, below, trans="T", overwrite_a=True, overwrite_b=True)
        cost = self.cost + float(below[:, 0] @ below[:, 0])
        return Information(self.unknowns, R * _upper(n, n), above[:, 0], above[:, 1:], cost, self.count + rows)

    def merge(self, other: Information) -> Information:
        """Returns the information merged with another on some of the same unknowns, under the same considered errors.

        Raises:
            UnknownNameError: the other has an unknown that this one lacks.
            IdentificationError: the numbers of considered errors differ.
        """
        n, q = len(self), max(self.G.shape[1], other.G.shape[1])
        if any(G.shape[1] not in (0, q) for G in (self.G, other.G)):
            raise IdentificationError(
                f"information merges under the same considered errors, got {self.G.shape[1]} and {other.G.shape[1]}"
            )
        stacked = np.zeros((n + len(other), n + 1 + q))
        stacked[:n, :n], stacked[:n, n], stacked[:n, n + 1 : n + 1 + self.G.shape[1]] = self.R, self.z, self.G
        stacked[n:, self.unknowns.index(other.names)] = other.R
        stacked[n:, n], stacked[n:, n + 1 : n + 1 + other.G.shape[1]] = other.z, other.G
        return _triangular(self.unknowns, stacked, self.cost + other.cost, self.count + other.count)

    # -- less certain -----------------------------------------------------------------------------------------------
    def forget(self, factor: float) -> Information:
        """Returns the information with the weight of all rows multiplied by `factor` (0 to 1).

        Raises:
            IdentificationError: a factor outside 0 to 1.
        """
        if not 0.0 <= factor <= 1.0:
            raise IdentificationError(f"a forgetting factor lies between 0 and 1, got {factor}")
        root = np.sqrt(factor)
        parts = root * self.R, root * self.z, root * self.G, factor * self.cost, factor * self.count
        return Information(self.unknowns, *parts)

    def scaled_noise(self, std: float) -> Information:
        """Returns the information with all rows' noise multiplied by `std`, for rows added before it was known."""
        if not std > 0:
            raise IdentificationError(f"a noise must be positive, got {std}")
        return Information(self.unknowns, self.R / std, self.z / std, self.G / std, self.cost / std**2, self.count)

    # -- other unknowns ---------------------------------------------------------------------------------------------
    def marginal(self, names: Iterable[str]) -> Information:
        """Marginal information on some blocks, with nothing assumed of the others, in the given order.

        The rows are projected onto the orthogonal complement of the other unknowns' columns. Directions of the others
        that no row depends on constrain nothing and drop out.
        """
        layout = self.unknowns.only(names)
        keep, away = self._split(layout.names)
        sides = np.column_stack((self.R[:, keep], self.z, self.G))
        triangle = _triangle(np.hstack([self.R[:, away], sides]))
        pivots = np.abs(np.diagonal(triangle))[: len(away)]
        if (pivots > _DEPENDENT * np.linalg.norm(self.R[:, away], axis=0)).all():
            return _triangular(layout, triangle[len(away) :, len(away) :], self.cost, self.count)
        U, s, _ = np.linalg.svd(self.R[:, away] / self.column_scales()[away])
        complement = U[:, int(np.sum(s > _DEPENDENT * s.max(initial=0.0))) :].T
        return _triangular(layout, complement @ sides, self.cost, self.count)

    def fix(self, values: Mapping[str, ArrayLike]) -> Information:
        """Information on the other unknowns when these are known: H_x x = y - H_f x_f, the paper's eq. 6.

        Raises:
            UnknownNameError: a name that is not among the unknowns.
        """
        layout = self.unknowns.without(values)
        keep, fixed = self._split(layout.names, tuple(values))
        known = [np.broadcast_to(v, self[name].stop - self[name].start) for name, v in values.items()]
        target = self.z - self.R[:, fixed] @ (np.concatenate(known) if known else np.zeros(0))
        return _triangular(layout, np.column_stack((self.R[:, keep], target, self.G)), self.cost, self.count)

    def consider(self, root: Array, names: Iterable[str]) -> Information:
        """Information on the other unknowns when these are set to zero and their errors are considered.

        Args:
            root: (k, k), a square root of the covariance of the entries of `names`: ``covariance = root rootᵀ``.
            names: blocks that become considered errors, appended to the existing ones.
        """
        names = tuple(names)
        layout = self.unknowns.without(names)
        keep, away = self._split(layout.names, names)
        G = np.hstack([self.G, self.R[:, away] @ root])
        return _triangular(layout, np.column_stack((self.R[:, keep], self.z, G)), self.cost, self.count)

    # -- asking -----------------------------------------------------------------------------------------------------
    @cached_property
    def inverse(self) -> Array:
        """R⁻¹, (n, n).

        Raises:
            IdentificationError: the rows do not determine all unknowns.
        """
        inverse, first = lapack.dtrtri(np.asfortranarray(self.R))
        if first:
            raise IdentificationError(f"the rows do not determine all of: {', '.join(self.names)}")
        return np.asarray(inverse)

    @cached_property
    def mean(self) -> Array:
        """The least-squares estimate, (n,)."""
        return np.asarray(self.inverse @ self.z)

    @cached_property
    def root(self) -> Array:
        """[R⁻¹, -R⁻¹ G], (n, n + q): a square root of the covariance, the part from the rows' noise first."""
        if not self.G.shape[1]:
            return self.inverse
        return np.hstack([self.inverse, -self.inverse @ self.G])

    def covariance(self, name: str | None = None) -> Array:
        """Covariance of all unknowns, or of one block."""
        root = self.root if name is None else self.root[self[name]]
        return np.asarray(root @ root.T)

    def residual_squared(self, values: Array) -> float:
        """|H x - y|² over all rows, in units of their noise, for unknowns x (n,)."""
        return float(np.sum((self.R @ values - self.z) ** 2) + self.cost)

    def rank(self) -> int:
        """Number of directions that the rows determine, to rounding."""
        return int(np.linalg.matrix_rank(self.R / self.column_scales(), tol=1e-10))

    def least_squares(self) -> dict[str, float]:
        """Least-squares solution by name, for scalar unknowns. If the rows do not determine all unknowns, the solution
        of smallest norm in units of the columns.
        """
        scale = self.column_scales()
        solution = np.linalg.lstsq(self.R / scale, self.z, rcond=1e-10)[0] / scale
        return dict(zip(self.names, solution.tolist(), strict=True))

    def column_scales(self) -> Array:
        """Norm of each unknown's column over all rows, (n,); 1 for a column of zeros."""
        norms = np.linalg.norm(self.R, axis=0)
        return np.where(norms > 0, norms, 1.0)

    # -- inside -----------------------------------------------------------------------------------------------------
    def _split(self, keep: tuple[str, ...], away: tuple[str, ...] | None = None) -> tuple[Places, Places]:
        """Indices of the entries of some blocks, and of the others."""
        others = self.unknowns.without(keep).names if away is None else away
        return self.unknowns.index(keep), self.unknowns.index(others)


def _layout(unknowns: Unknowns | Iterable[str]) -> Unknowns:
    return unknowns if isinstance(unknowns, Unknowns) else Unknowns.scalars(unknowns)


def _triangular(unknowns: Unknowns, matrix: Array, cost: float = 0.0, count: float = 0.0) -> Information:
    """Makes an information from any number of rows [H y B]."""
    n = len(unknowns)
    triangle = _triangle(matrix)
    if len(triangle) < n:
        triangle = np.vstack([triangle, np.zeros((n - len(triangle), triangle.shape[1]))])
    more = float(triangle[n, n] ** 2) if len(triangle) > n else 0.0
    return Information(unknowns, triangle[:n, :n], triangle[:n, n], triangle[:n, n + 1 :], cost + more, count)


def _triangle(matrix: Array) -> Array:
    """Triangular factor of a QR, (min(rows, columns), columns)."""
    if not len(matrix):
        return matrix
    factor = lapack.dgeqrf(matrix)[0]
    top = min(matrix.shape)
    return np.asarray(factor[:top] * _upper(top, matrix.shape[1]))


@lru_cache(maxsize=64)
def _upper(rows: int, columns: int) -> Array:
    return np.triu(np.ones((rows, columns)))


_Kinds = dict[tuple[tuple[str, ...], int | None], tuple[Array | None, Array, Array]]
"""By columns and mixing of rows: the mixing, the triangle of those added so far, and room for a block.

Rows of one kind share columns and mixing: with H = reduced mixing, the triangle [R z] of [reduced y] stands for
[R mixing, z].
"""


def _add(rows: Rows, kinds: _Kinds) -> None:
    """Takes rows into the triangle of their kind, block by block, each by the QR of a triangle on top of a rectangle
    (LAPACK's tpqrt).
    """
    key, n = (rows.columns, None if rows.mixing is None else id(rows.mixing)), rows.reduced.shape[1]
    if key not in kinds:
        kinds[key] = rows.mixing, np.zeros((n + 1, n + 1), order="F"), np.empty((n + 1) * _BLOCK)
    mixing, triangle, room = kinds[key]
    weight = np.broadcast_to(1.0 / np.asarray(rows.std), len(rows))
    panel = n + 1 if n < _PANEL - 1 else _PANEL_OF_BLOCKS
    for start in range(0, len(rows), _BLOCK):
        part = slice(start, start + _BLOCK)
        block = room[: (n + 1) * len(weight[part])].reshape(n + 1, -1)
        np.multiply(rows.reduced[part].T, weight[part], out=block[:n])
        np.multiply(rows.target[part], weight[part], out=block[n])
        triangle, *_ = lapack.dtpqrt(0, panel, triangle, block.T, overwrite_a=True, overwrite_b=True)
    kinds[key] = mixing, triangle, room


def _stacked(kinds: _Kinds, unknowns: Unknowns) -> Array:
    """Rows [H y] that carry the same information as all rows added."""
    blocks = [np.zeros((1, len(unknowns) + 1))]
    for (columns, _), (mixing, triangle, _) in kinds.items():
        own = np.triu(triangle)
        spread = np.zeros((len(own), len(unknowns) + 1))
        spread[:, unknowns.index(columns)] = own[:, :-1] if mixing is None else own[:, :-1] @ mixing
        spread[:, -1] = own[:, -1]
        blocks.append(spread)
    stacked = np.vstack(blocks)
    if not np.isfinite(stacked).all():
        raise IdentificationError("rows hold values that are not finite")
    return stacked
