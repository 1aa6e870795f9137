"""Observability analysis: rank, identifiable combinations, and a verdict for each parameter.

Each parameter is scaled by its prior width, θ_k = θ0_k + w_k x_k, so that W = R diag(w) is dimensionless. A singular
value s_k of W measures how well the data determine the direction v_k of x: its standard deviation without prior is
1/s_k, in units of the prior's. So:

* the rank is the number of directions that the data determine better than the prior, s_k > 1;
* a parameter is observable if the data alone determine it to a tenth of its prior width, unobservable if even a
  change by its whole width changes the data by less than their noise, and partially observable in between: some
  combination with others is known, but not the parameter itself.

For data without noise these are the algebraic rank and row space of the regressor (section II.A); noise reduces them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stadera.identify.prior import Prior
from stadera.information import Information
from stadera.types import Array


class Identifiability(StrEnum):
    """How well a parameter is determined (the colours of Table I: green, gray, red)."""

    OBSERVABLE = "observable"
    PARTIAL = "partial"
    UNOBSERVABLE = "unobservable"


@dataclass(frozen=True, eq=False)
class Combination:
    """An identifiable combination, Σ coefficient · parameter, each parameter in the unit of the first one."""

    terms: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        out = ""
        for name, factor in self.terms:
            sign = "-" if factor < 0 else "+"
            size = "" if abs(abs(factor) - 1.0) < 5e-7 else f"{abs(factor):.4g}·"
            out += f" {sign} {size}{name}" if out else f"{'-' if factor < 0 else ''}{size}{name}"
        return out

    def of(self, values: dict[str, float]) -> float:
        """The combination's value."""
        return sum(factor * values[name] for name, factor in self.terms)


def gradients_of(combinations: Sequence[Combination], columns: Sequence[str]) -> Array:
    """Derivatives of combinations with respect to the parameters `columns`, (combinations, columns)."""
    out = np.zeros((len(combinations), len(columns)))
    for row, combination in zip(out, combinations, strict=True):
        for name, factor in combination.terms:
            row[columns.index(name)] = factor
    return out


@dataclass(frozen=True, eq=False)
class Observability:
    """What the data determine about the parameters `columns`."""

    columns: tuple[str, ...]  # names of the n parameters
    widths: Array  # (n,), the prior's standard deviations, in the parameters' units
    singular_values: Array  # (n,) of W, descending, dimensionless
    directions: Array  # (n, n), the rows v_k
    left: Array  # (n, n), the columns u_k

    @property
    def rank(self) -> int:
        """Number of directions that the data determine better than the prior."""
        return int(np.sum(self.singular_values > self._floor))

    @property
    def _floor(self) -> float:
        return max(1.0, 1e-13 * len(self.columns) * float(self.singular_values.max(initial=0.0)))

    def std(self, gradients: Array | None = None, prior: float = 1.0) -> Array:
        """Standard deviations of the parameters, or of gradients (k, n), under a prior `prior` times as wide."""
        g = self._in_widths(gradients) @ self.directions.T
        s = np.where(self.singular_values > 1e-6 * self._floor, self.singular_values, 0.0)
        return np.asarray(np.sqrt(np.sum(g**2 / (s**2 + prior**-2), axis=1)))

    def verdicts(
        self, gradients: Array | None = None, flat: float = 1e4, firm: float = 0.1, silent: float = 1.0
    ) -> tuple[Identifiability, ...]:
        """The verdict on each parameter, or on each quantity whose gradient (k, n) is given.

        Args:
            flat: prior widths that stand for "no prior" [1].
            firm: largest standard deviation without prior, in prior widths, of an observable parameter [1].
            silent: change of the data by the parameter's whole prior width, in units of their noise, up to which it
                is unobservable [1].
        """
        g = self._in_widths(gradients)
        known = self.std(gradients, prior=flat) <= firm * np.linalg.norm(g, axis=1)
        influence = np.linalg.norm(self.singular_values[:, None] * self.directions, axis=0)
        heard = ((influence > max(silent, 1e-6 * self._floor)) & (g != 0)).any(axis=1)
        return tuple(
            Identifiability.OBSERVABLE if f else Identifiability.PARTIAL if h else Identifiability.UNOBSERVABLE
            for f, h in zip(known & heard, heard, strict=True)
        )

    def _in_widths(self, gradients: Array | None) -> Array:
        return np.diag(self.widths) if gradients is None else np.atleast_2d(gradients) * self.widths

    def combinations(self, negligible: float = 1e-6) -> tuple[Combination, ...]:
        """The identifiable combinations in reduced echelon form, one for each observed direction: "this parameter, plus
        those that cannot be distinguished from it". Intended for data without noise, which would perturb every
        coefficient.
        """
        masses = np.array([name.endswith(".m") for name in self.columns])
        # masses would be separated by the other parameters, so a mass leads a combination only if nothing else can
        reduced, pivots = _echelon(self.directions[: self.rank], np.where(masses, 1e-3, 1.0))
        out = []
        for row, pivot in zip(reduced, pivots, strict=True):
            row = np.where(np.abs(row) > negligible, row, 0.0) / self.widths
            row = row / row[pivot]
            order = [pivot, *(int(k) for k in np.flatnonzero(row) if k != pivot)]
            out.append(Combination(tuple((self.columns[k], float(row[k])) for k in order)))
        return tuple(sorted(out, key=lambda c: self.columns.index(c.terms[0][0])))


def observability(information: Information, prior: Prior) -> Observability:
    """Compares the information of rows, in units of their true noise, with the prior on its columns."""
    data = information if information.names == prior.columns else information.marginal(prior.columns)
    U, s, Vt = np.linalg.svd(data.R * prior.scales)
    return Observability(prior.columns, prior.scales, s, Vt, U)


def _echelon(rows: Array, preference: Array) -> tuple[Array, list[int]]:
    """Gauss-Jordan elimination with full pivoting on entries times `preference` (n,): reduced rows, pivot columns."""
    work = rows.copy()
    pivots: list[int] = []
    for k in range(len(work)):
        rest = np.abs(work[k:]) * preference
        rest[:, pivots] = 0.0
        i, j = divmod(int(np.argmax(rest)), rest.shape[1])
        work[[k, k + i]] = work[[k + i, k]]
        work[k] /= work[k, j]
        others = [r for r in range(len(work)) if r != k]
        work[others] -= np.outer(work[others, j], work[k])
        pivots.append(j)
    return work, pivots
