"""Table I: the right hind leg identified in simulation, compared with the simulated values.

Four parts: the paper's own (CAD perturbed, no noise, eq. 5); the same with a physically possible perturbation, solved
physically consistently; that with sensor errors; and the information of the motion: the ranks reached by the paper's
random draw and by the optimised excitation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.stats import chi2

from stadera.body import FrictionModel, TrunkMotion
from stadera.constants import SAME
from stadera.excite.bounds import LegBounds
from stadera.excite.optimise import FourierSearch, LegExperiment, optimal_excitation
from stadera.excite.sinusoids import Reference
from stadera.identify.job import LegTask
from stadera.identify.legs import structural_observability
from stadera.identify.observability import Combination, Identifiability, Observability, gradients_of
from stadera.identify.result import Identification, LegIdentification, Quantity
from stadera.identify.settings import IdentifySettings
from stadera.inertia import ORDER
from stadera.lab.experiments.legs import LEG, LegCase, impossible_links, torque_figure
from stadera.lab.experiments.runner import CaseValues, ExperimentResult, Paper, Record
from stadera.report.numbers import fixed
from stadera.report.table import Cell, Row, TableData
from stadera.robot.model import Robot
from stadera.types import Array

PAPER = Paper.of("table1")


@dataclass(frozen=True)
class Recovered:
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
    def parameters(self) -> tuple[Recovered, ...]:
        """The ten parameters of each link."""
        return tuple(_compared(n, t, self.leg.parameters[n]) for n, t in self.true_values.items())

    @cached_property
    def coms(self) -> tuple[Recovered, ...]:
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
    def combinations(self) -> tuple[Recovered, ...]:
        """The identifiable combinations."""
        estimate = self.leg.estimate
        gradients = self._gradients
        stds = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", gradients, estimate.covariance, gradients), 0.0))
        verdicts = estimate.observability.verdicts(gradients)
        values, priors = gradients @ estimate.values, gradients @ estimate.prior.values
        return tuple(
            Recovered(str(c), c.of(self.true_values), float(v), float(p), float(s), q)
            for c, v, p, s, q in zip(self.structure, values, priors, stds, verdicts, strict=True)
        )

    def worst(self, compared: tuple[Recovered, ...]) -> float:
        """The largest relative error among the observable ones; 0 if there are none."""
        return max((c.relative_error for c in compared if c.verdict is Identifiability.OBSERVABLE), default=0.0)

    def largest_error(self, compared: tuple[Recovered, ...]) -> float:
        """The largest error among the observable ones, in their unit; 0 if there are none."""
        return max((abs(c.value - c.truth) for c in compared if c.verdict is Identifiability.OBSERVABLE), default=0.0)

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

    def nees_limit(self, probability: float = 0.975) -> float:
        """Quantile of `nees` for this probability if the covariance is right."""
        n = len(self.structure)
        return float(chi2.ppf(probability, n) / n)

    @cached_property
    def _gradients(self) -> Array:
        return gradients_of(self.structure, self.leg.estimate.columns)


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


def _compared(name: str, truth: float, quantity: Quantity, verdict: Identifiability | None = None) -> Recovered:
    return Recovered(name, truth, quantity.value, quantity.prior, quantity.std or 0.0, verdict or quantity.verdict)


# -- runs -------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Worth:
    """Information that a log of one motion would contain on the links' 30 parameters."""

    motion: str  # description
    rank: int  # without noise
    noisy_rank: int  # with the usual torque noise, relative to the prior
    gain: float  # information [nat]


def _part(case: LegCase) -> Recovery | tuple[Worth, ...]:
    if case.part == "motion":
        return _motion_worth(case)
    if case.part == "exact":
        log, second = (case.recorded(case.paper_truth, motion) for motion in (case.motion, case.second_motion))
        return Recovery.of(case.identified_exact(log, "null-space", second), case.paper_truth)
    log = case.recorded(case.physical_truth, case.motion)
    if case.part == "possible":
        return Recovery.of(case.identified_exact(log, "consistent"), case.physical_truth)
    return Recovery.of(case.identified_sensed(case.sensed(log)), case.physical_truth)


def _motion_worth(case: LegCase) -> tuple[Worth, ...]:
    """Evaluates the paper's draw and the optimised excitation, within the same bounds and time."""
    bounds, noiseless, rate = LegBounds.of(case.cad, LEG), 1e-7, 100.0  # [Hz], at which motions are evaluated
    noise = LegExperiment.usual(bounds).noise
    noisy = LegExperiment(bounds, noise, case.size[1], FrictionModel())
    exact = LegExperiment(bounds, noiseless * noise, case.size[1], FrictionModel())
    search = FourierSearch(starts=1, iterations=10) if case.quick else FourierSearch(starts=2, iterations=40)
    best = optimal_excitation(noisy, np.random.default_rng(case.seed), case.size[0], search)

    def worth(name: str, reference: Reference) -> Worth:
        seen = noisy.observability(reference)
        return Worth(name, exact.observability(reference).rank, seen.rank, noisy.gain(reference))

    motions = {"the paper's random draw": case.motion, "optimised": best}
    return tuple(worth(name, motion.sample(rate)) for name, motion in motions.items())


def _summary(cases: Sequence[LegCase], found: Sequence[Any]) -> ExperimentResult:
    exact, possible, noisy, worth = found
    estimate, note = exact.leg.estimate, "Not used to identify. The identified model's curves lie on the measured ones;"
    return PAPER.result(
        _records(exact, possible, noisy, worth),
        (*_link_tables(exact), _paper_table(PAPER.values["links"])),
        (torque_figure(exact.leg, "Torques on a second motion", f"{note} CAD's do not.", ("prior", "identified")),),
        {
            "Robot": f"{exact.truth.name}, leg {LEG}, trunk held",
            "Motion": f"the paper's random sinusoids, {cases[0]}",
            "Plant": "MuJoCo, PD-tracked",
            "Identified": f"{len(estimate.columns)} parameters, rank {estimate.observability.rank}",
            "Seed": str(cases[0].seed),
        },
    )


EXPERIMENT = PAPER.experiment(
    lambda settings: [
        LegCase(part, settings.seed, settings.quick) for part in ("exact", "possible", "noisy", "motion")
    ],
    _part,
    _summary,
    alone=True,
)


# -- records ----------------------------------------------------------------------------------------------------------
def _case(perturbation: str, errors: str, found: Recovery) -> CaseValues:
    return {"perturbation": perturbation, "sensor errors": errors, "method": found.leg.estimate.method}


def _exact_records(case: CaseValues, found: Recovery, paper: float | None = None) -> Iterator[Record]:
    """Records of a leg identified without noise. The paper states 1 mm for observable components of its case."""
    bounds = PAPER.bounds
    for title, compared in (
        ("observable parameters", found.parameters),
        ("identifiable combinations", found.combinations),
    ):
        worst = found.worst(compared)
        yield PAPER.record(case, f"worst relative error, {title}", "1", worst, bound=bounds["relative"])
    yield PAPER.record(case, "worst error, observable CoM", "m", found.largest_error(found.coms), paper, bounds["com"])


def _records(exact: Recovery, possible: Recovery, noisy: Recovery, worth: tuple[Worth, ...]) -> Iterator[Record]:
    """The paper's case, in which unobservable parameters are CAD's and the rank is 12; then ours."""
    paper, case = PAPER.values, _case("the paper's", "none", exact)
    yield from _exact_records(case, exact, paper["com"])
    yield PAPER.record(case, "unobservable parameters, largest change from CAD", "SI", exact.drift, 0.0, 0.0)
    rank = exact.leg.estimate.observability.rank
    yield PAPER.record(case, "rank, of 30", "1", rank, paper["rank"], PAPER.bounds["rank"], "at least")
    case = _case("physical", "none", possible)
    yield from _exact_records(case, possible)
    yield PAPER.record(case, "links that no real body could be", "1", impossible_links(possible.leg), bound=0.0)
    case, deviations = _case("physical", "standard", noisy), max(abs(c.deviations) for c in noisy.combinations)
    yield PAPER.record(case, "error of combinations, NEES / n", "1", noisy.nees, bound=noisy.nees_limit())
    yield PAPER.record(case, "worst error of a combination", "σ", deviations)
    yield PAPER.record(case, "rank, of 33 with torque offsets", "1", noisy.leg.estimate.observability.rank)
    for w, printed in zip(worth, (paper["rank"], None), strict=True):  # the paper's motion first
        case = {"motion": w.motion}
        yield PAPER.record(case, "rank without noise, of 30", "1", w.rank, printed)
        yield PAPER.record(case, "rank with torque noise, of 30", "1", w.noisy_rank)
        yield PAPER.record(case, "information gain", "nat", w.gain)


# -- tables ---------------------------------------------------------------------------------------------------------
_COM_HEAD = ("", "mass [kg]", "CoM x [m]", "CoM y [m]", "CoM z [m]")


def _link_tables(found: Recovery) -> tuple[TableData, TableData]:
    """Mass and centre of mass of each link, in the layout of the paper's Table I, and its inertia."""

    def groups(compared: Callable[[str], list[Recovered]]) -> dict[str, list[Row]]:
        links = zip(("hip assembly", "upper leg", "lower leg"), found.leg.leg.links, strict=True)
        return {f"{words} ({link})": _rows(compared(f"{link}.")) for words, link in links}

    masses = [c for c in found.parameters if c.name.endswith(".m")]
    moments = groups(lambda link: [c for c in (*masses, *found.coms) if c.name.startswith(link)])
    inertias = groups(lambda link: [c for c in found.parameters if c.name.startswith(f"{link}I")])
    note = "About the origin of the link's frame, in its axes: there, not about the centre of mass, torques are linear."
    return (
        TableData.of("Masses and centres of mass", _COM_HEAD, moments, "In the link's frame."),
        TableData.of("Inertias [kg·m²]", ("", *ORDER[4:]), inertias, note),
    )


def _rows(compared: list[Recovered]) -> list[Row]:
    found = (Cell(_figure(c.value), c.verdict, strong=c.verdict is Identifiability.OBSERVABLE) for c in compared)
    return [
        ("simulated", *(_figure(c.truth) for c in compared)),
        ("identified", *found),
        ("CAD", *(_figure(c.prior) for c in compared)),
    ]


_figure = partial(fixed, decimals=4)


def _paper_table(links: Mapping[str, Sequence[Sequence[float]]]) -> TableData:
    """The paper's own Table I: simulated and identified values by link."""
    rows = {
        link: [(name, *map(_figure, values)) for name, values in zip(("simulated", "identified"), both, strict=True)]
        for link, both in links.items()
    }
    head = (*_COM_HEAD, *(f"{name} [kg·m²]" for name in ORDER[4:]))
    return TableData.of("The paper's Table I", head, rows, "Another draw of the perturbation than ours.")
