"""Compares identified with simulated values: the error of an identification with respect to ground truth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import chi2

from stadera.body import FrictionModel, TrunkMotion
from stadera.constants import SAME
from stadera.identify.job import LegTask
from stadera.identify.legs import structural_observability
from stadera.identify.observability import Combination, Identifiability, Observability, gradients_of
from stadera.identify.result import Identification, LegIdentification, Quantity
from stadera.identify.settings import IdentifySettings
from stadera.robot.model import Robot
from stadera.types import Array


@dataclass(frozen=True)
class Compared:
    """One quantity: simulated, identified, and from CAD."""

    name: str
    truth: float
    value: float
    prior: float
    std: float
    verdict: Identifiability

    @property
    def relative_error(self) -> float:
        """|identified - simulated| / |simulated|; if the simulated value is zero, relative to CAD's magnitude or 1."""
        return abs(self.value - self.truth) / (abs(self.truth) or abs(self.prior) or 1.0)

    @property
    def deviations(self) -> float:
        """(identified - simulated) in units of the stated standard deviation."""
        return (self.value - self.truth) / self.std


@dataclass(frozen=True, eq=False)
class Recovery:
    """An identified leg compared with the simulated one."""

    leg: LegIdentification
    truth: Robot  # the simulated robot
    # combinations of link parameters that motion on a held trunk can identify at best
    structure: tuple[Combination, ...]

    @classmethod
    def of(cls, result: Identification, truth: Robot) -> Recovery:
        """Compares the only leg of a result with the truth."""
        (leg,) = result.legs
        task = LegTask.of(result.robot, leg.leg, IdentifySettings(friction=FrictionModel()))
        return cls(leg, truth, structural_observability(task, TrunkMotion.held((0.0, 0.0, 1.0))).combinations())

    @cached_property
    def true_values(self) -> dict[str, float]:
        """The simulated link parameters by name."""
        bodies = {link: self.truth.inertias[link].to_dict() for link in self.leg.leg.links}
        return {f"{link}.{name}": value for link, body in bodies.items() for name, value in body.items()}

    @cached_property
    def parameters(self) -> tuple[Compared, ...]:
        """The ten parameters of each link."""
        return tuple(_compared(n, t, self.leg.parameters[n]) for n, t in self.true_values.items())

    @cached_property
    def coms(self) -> tuple[Compared, ...]:
        """Centres of mass [m]. They are observable here: the data determine the first moments given the masses, and in
        this experiment the simulated masses are CAD's, at which the estimates are fixed.
        """
        fixed = fixed_given(self.leg.estimate.observability, [f"{link}.m" for link in self.leg.leg.links])
        out = []
        for link in self.leg.leg.links:
            for axis, truth, quantity in zip("xyz", self.truth.inertias[link].com, self.leg.coms[link], strict=True):
                seen = Identifiability.OBSERVABLE if f"{link}.mc{axis}" in fixed else quantity.verdict
                out.append(_compared(f"{link}.c{axis}", float(truth), quantity, seen))
        return tuple(out)

    @cached_property
    def combinations(self) -> tuple[Compared, ...]:
        """The identifiable combinations."""
        estimate = self.leg.estimate
        gradients = self._gradients
        stds = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", gradients, estimate.covariance, gradients), 0.0))
        verdicts = estimate.observability.verdicts(gradients)
        values, priors = gradients @ estimate.values, gradients @ estimate.prior.values
        return tuple(
            Compared(str(c), c.of(self.true_values), float(v), float(p), float(s), q)
            for c, v, p, s, q in zip(self.structure, values, priors, stds, verdicts, strict=True)
        )

    def worst(self, compared: tuple[Compared, ...]) -> float:
        """The largest relative error among the observable ones; 0 if there are none."""
        return max((c.relative_error for c in compared if c.verdict is Identifiability.OBSERVABLE), default=0.0)

    def largest_error(self, compared: tuple[Compared, ...]) -> float:
        """The largest error among the observable ones, in their unit; 0 if there are none."""
        return max((abs(c.value - c.truth) for c in compared if c.verdict is Identifiability.OBSERVABLE), default=0.0)

    @property
    def impossible_links(self) -> int:
        """Number of identified links that are physically impossible."""
        return impossible_links(self.leg)

    @property
    def drift(self) -> float:
        """The largest change of an unobservable parameter from CAD, in its unit."""
        return max(
            (abs(c.value - c.prior) for c in self.parameters if c.verdict is Identifiability.UNOBSERVABLE), default=0.0
        )

    @property
    def nees(self) -> float:
        """Normalised estimation error squared of the identifiable combinations: eᵀ P⁻¹ e / n, 1 where the stated
        covariance P is right, above where it promises too much (Bar-Shalom, Li, Kirubarajan 2001).
        """
        gradients = self._gradients
        error = np.array([c.value - c.truth for c in self.combinations])
        covariance = gradients @ self.leg.estimate.covariance @ gradients.T
        scale = np.sqrt(np.diag(covariance))
        whitened = np.linalg.solve(covariance / np.outer(scale, scale), error / scale)
        return float((error / scale) @ whitened / len(error))

    @property
    def prior_widths(self) -> Array:
        """Prior standard deviation of each identifiable combination, in its unit."""
        return np.asarray(np.linalg.norm(self._gradients @ self.leg.estimate.prior.root, axis=1))

    def nees_limit(self, probability: float = 0.975) -> float:
        """Quantile of `nees` for this probability if the covariance is right."""
        n = len(self.structure)
        return float(chi2.ppf(probability, n) / n)

    @cached_property
    def _gradients(self) -> Array:
        return gradients_of(self.structure, self.leg.estimate.columns)


def impossible_links(leg: LegIdentification) -> int:
    """Number of physically impossible links in an identified leg."""
    return sum(not leg.estimate.inertia(link).is_physical() for link in leg.leg.links)


def fixed_given(seen: Observability, given: list[str]) -> frozenset[str]:
    """Parameters that the data determine once the given ones are known.

    With x any change within the null space of the data that does not affect the given parameters, these are the
    parameters not affected by any such x. The given ones are not listed.
    """
    free = seen.directions[seen.rank :].T
    held = [seen.columns.index(name) for name in given]
    _, moved, directions = np.linalg.svd(free[held])
    moves = free @ directions[np.count_nonzero(moved > SAME) :].T
    still = np.linalg.norm(moves, axis=1) < SAME
    return frozenset(name for name, s in zip(seen.columns, still, strict=True) if s and name not in given)


def _compared(name: str, truth: float, quantity: Quantity, verdict: Identifiability | None = None) -> Compared:
    return Compared(name, truth, quantity.value, quantity.prior, quantity.std or 0.0, verdict or quantity.verdict)
