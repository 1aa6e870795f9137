"""Table I: the right hind leg identified in simulation, compared with the simulated values.

Four cases: the paper's own (CAD perturbed, no noise, eq. 5); the same with a physically possible perturbation, solved
physically consistently; that with sensor errors; and the information of the motion: the ranks reached by the paper's
random draw and by the optimised excitation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stadera.body import FrictionModel
from stadera.excite.bounds import LegBounds
from stadera.excite.optimise import FourierSearch, optimal_excitation
from stadera.excite.sinusoids import Reference
from stadera.excite.worth import LegExperiment
from stadera.identify.observability import Identifiability
from stadera.inertia import ORDER
from stadera.lab.experiments.legs.recovery import Compared, Recovery
from stadera.lab.experiments.legs.runs import LEG, LegRuns
from stadera.lab.experiments.legs.torques import torque_figure
from stadera.lab.experiments.paper import Paper, ReproduceSettings, Steps
from stadera.lab.experiments.result import ExperimentResult, Record
from stadera.report.figures import Axis, Figure, Panel, Series
from stadera.report.table import Cell, Row, TableData
from stadera.types import Progress

PAPER = Paper.of("table1")

_LINKS = ("hip assembly", "upper leg", "lower leg")
_NOISELESS = 1e-7
_RATE = 100.0  # Hz, at which motions are evaluated
_QUICK = FourierSearch(starts=1, iterations=10)
_SEARCH = FourierSearch(starts=2, iterations=40)


def first_moment_table(found: Recovery) -> TableData:
    """Mass and centre of mass of each link, in the layout of the paper's Table I."""
    groups = {}
    for words, link in zip(_LINKS, found.leg.leg.links, strict=True):
        mass = next(c for c in found.parameters if c.name == f"{link}.m")
        coms = [c for c in found.coms if c.name.startswith(f"{link}.")]
        groups[f"{words} ({link})"] = _rows([mass, *coms])
    head = ("", "mass [kg]", "CoM x [m]", "CoM y [m]", "CoM z [m]")
    return TableData.of("Masses and centres of mass", head, groups, "In the link's frame.")


def inertia_table(found: Recovery) -> TableData:
    """Inertia of each link about its frame's origin."""
    groups = {}
    for words, link in zip(_LINKS, found.leg.leg.links, strict=True):
        entries = [c for c in found.parameters if c.name.startswith(f"{link}.I")]
        groups[f"{words} ({link})"] = _rows(entries)
    note = "About the origin of the link's frame, in its axes: there, not about the centre of mass, torques are linear."
    return TableData.of("Inertias [kg·m²]", ("", *ORDER[4:]), groups, note)


def combination_table(found: Recovery, title: str) -> TableData:
    """Identifiable combinations: simulated, identified, and their difference in standard deviations."""
    rows = [
        (
            c.name,
            _figure(c.truth),
            Cell(f"{_figure(c.value)} ± {c.std:.4f}", c.verdict, strong=c.verdict is Identifiability.OBSERVABLE),
            _figure(c.prior),
            f"{c.deviations:+.1f} σ",
        )
        for c in found.combinations
    ]
    head = ("combination [kg·m, kg·m²]", "simulated", "identified ± std", "CAD", "off by")
    note = (
        "Sums over links that no motion on a held trunk can take apart. With correct error bars two in three are off "
        "by less than 1 σ, nineteen in twenty by less than 2 σ."
    )
    return TableData.of(title, head, rows, note)


def paper_table(links: Mapping[str, Sequence[Sequence[float]]]) -> TableData:
    """The paper's own Table I: simulated and identified values by link."""
    rows = {
        link: [(name, *map(_figure, values)) for name, values in zip(("simulated", "identified"), both, strict=True)]
        for link, both in links.items()
    }
    head = ("", "mass [kg]", "CoM x [m]", "CoM y [m]", "CoM z [m]", *(f"{name} [kg·m²]" for name in ORDER[4:]))
    return TableData.of("The paper's Table I", head, rows, "Another draw of the perturbation than ours.")


def deviation_figure(found: Recovery) -> Figure:
    """Errors of the identifiable combinations, in units of the prior's standard deviation."""
    compared = found.combinations
    position = np.arange(len(compared), dtype=float)
    widths = found.prior_widths
    before = np.array([c.prior - c.truth for c in compared]) / widths
    after = np.array([c.value - c.truth for c in compared]) / widths
    stds = np.array([c.std for c in compared]) / widths
    names = tuple(c.name.split(" ")[0] + (" + …" if " " in c.name else "") for c in compared)
    marks = (
        Series(before, position, "CAD", "steel", 0.0, marker="dot"),
        Series(after, position, "identified ± 1 σ", "blue", 0.0, marker="dot", x_range=(after - stds, after + stds)),
    )
    panel = Panel(Axis("off from simulated [prior widths]"), Axis(labels=names), marks)
    note = "0 is the simulated value, 1 the prior's standard deviation; bars are the estimate's."
    return Figure("With sensor errors: how far off CAD is, and how far what was identified", ((panel,),), note)


def _rows(compared: list[Compared]) -> list[Row]:
    found = (Cell(_figure(c.value), c.verdict, strong=c.verdict is Identifiability.OBSERVABLE) for c in compared)
    return [
        ("simulated", *(_figure(c.truth) for c in compared)),
        ("identified", *found),
        ("CAD", *(_figure(c.prior) for c in compared)),
    ]


def _figure(value: float) -> str:
    text = f"{value:.4f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """Simulates, identifies and compares."""
    runs = LegRuns.of(settings)
    step = Steps(PAPER.name, progress)
    step("simulating the leg on two motions")
    log = runs.recorded(runs.paper_truth, runs.motion)
    second = runs.recorded(runs.paper_truth, runs.second_motion)
    step("identifying, CAD in the null space")
    exact = Recovery.of(runs.identified_exact(log, "null-space", second), runs.paper_truth)
    step("simulating a physically possible leg")
    log = runs.recorded(runs.physical_truth, runs.motion)
    step("identifying, physically consistent")
    possible = Recovery.of(runs.identified_exact(log, "consistent"), runs.physical_truth)
    step("identifying with sensor errors")
    noisy = Recovery.of(runs.identified_sensed(runs.sensed(log)), runs.physical_truth)
    step("optimising the motion")
    worth = motion_worth(runs, settings.quick)
    step.finished()
    return PAPER.result(
        (*_exact_records(exact), *_possible_records(possible), *_noisy_records(noisy), *worth_records(worth)),
        (
            first_moment_table(exact),
            inertia_table(exact),
            paper_table(PAPER.values["links"]),
            combination_table(noisy, "With sensor errors: what the leg's torques depend on"),
            worth_table(worth),
        ),
        (
            torque_figure(
                exact.leg,
                "Torques on a second motion",
                "Not used to identify. The identified model's curves lie on the measured ones; CAD's do not.",
                ("prior", "identified"),
            ),
            deviation_figure(noisy),
        ),
        {
            "Robot": f"{runs.cad.name}, leg {LEG}, trunk held",
            "Motion": f"the paper's random sinusoids, {runs.size}",
            "Plant": "MuJoCo, PD-tracked",
            "Identified": f"{len(exact.leg.estimate.columns)} parameters, rank {exact.leg.estimate.observability.rank}",
            "Seed": str(settings.seed),
        },
    )


def _relative_records(case: dict[str, str | float], found: Recovery) -> tuple[Record, ...]:
    bound = PAPER.bounds["relative"]
    parameters, combinations = found.worst(found.parameters), found.worst(found.combinations)
    return (
        PAPER.record(case, "worst relative error, observable parameters", "1", parameters, bound=bound),
        PAPER.record(case, "worst relative error, identifiable combinations", "1", combinations, bound=bound),
    )


def _exact_records(found: Recovery) -> tuple[Record, ...]:
    """Records of the paper's case. It states 1 mm for observable components, CAD for the others, and rank 12."""
    case, paper, bounds = _case("the paper's", "none", found), PAPER.values, PAPER.bounds
    com, rank = found.largest_error(found.coms), found.leg.estimate.observability.rank
    return (
        *_relative_records(case, found),
        PAPER.record(case, "worst error, observable CoM", "m", com, paper["com"], bounds["com"]),
        PAPER.record(case, "unobservable parameters, largest change from CAD", "SI", found.drift, 0.0, 0.0),
        Record(PAPER.name, case, "rank, of 30", "1", rank, paper["rank"], bounds["rank"], "at least"),
    )


def _possible_records(found: Recovery) -> tuple[Record, ...]:
    case, com = _case("physical", "none", found), found.largest_error(found.coms)
    return (
        *_relative_records(case, found),
        PAPER.record(case, "worst error, observable CoM", "m", com, bound=PAPER.bounds["com"]),
        PAPER.record(case, "links that no real body could be", "1", found.impossible_links, bound=0.0),
    )


def _noisy_records(found: Recovery) -> tuple[Record, ...]:
    case = _case("physical", "standard", found)
    deviations = max(abs(c.deviations) for c in found.combinations)
    rank = found.leg.estimate.observability.rank
    return (
        PAPER.record(case, "error of combinations, NEES / n", "1", found.nees, bound=found.nees_limit()),
        PAPER.record(case, "worst error of a combination", "σ", deviations),
        PAPER.record(case, "rank, of 33 with torque offsets", "1", rank),
    )


def _case(perturbation: str, errors: str, found: Recovery) -> dict[str, str | float]:
    return {"perturbation": perturbation, "sensor errors": errors, "method": found.leg.estimate.method}


@dataclass(frozen=True)
class Worth:
    """Information that a log of one motion would contain on the links' 30 parameters."""

    motion: str  # description
    rank: int  # without noise
    noisy_rank: int  # with the usual torque noise, relative to the prior
    observable: int  # number of parameters that the data alone determine, with that noise
    gain: float  # information [nat]


def motion_worth(runs: LegRuns, quick: bool) -> tuple[Worth, Worth]:
    """Evaluates the paper's draw and the optimised excitation, within the same bounds and time."""
    bounds = LegBounds.of(runs.cad, LEG)
    noise = LegExperiment.usual(bounds).noise
    noisy = LegExperiment(bounds, noise, runs.size.rate, FrictionModel())
    exact = LegExperiment(bounds, _NOISELESS * noise, runs.size.rate, FrictionModel())
    search = _QUICK if quick else _SEARCH
    best = optimal_excitation(noisy, np.random.default_rng(runs.seed), runs.size.duration, search)
    motions = {"the paper's random draw": runs.motion, "optimised": best}
    one, other = (_worth(name, m.sample(_RATE), noisy, exact) for name, m in motions.items())
    return one, other


def _worth(name: str, reference: Reference, noisy: LegExperiment, exact: LegExperiment) -> Worth:
    seen = noisy.observability(reference)
    observable = sum(v is Identifiability.OBSERVABLE for v in seen.verdicts())
    return Worth(name, exact.observability(reference).rank, seen.rank, observable, noisy.gain(reference))


def worth_records(worth: tuple[Worth, ...]) -> Iterator[Record]:
    """Ranks and gains of each motion, the paper's first."""
    for w in worth:
        case, printed = {"motion": w.motion}, PAPER.values["rank"] if w is worth[0] else None
        yield PAPER.record(case, "rank without noise, of 30", "1", w.rank, printed)
        yield PAPER.record(case, "rank with torque noise, of 30", "1", w.noisy_rank)
        yield PAPER.record(case, "information gain", "nat", w.gain)


def worth_table(worth: tuple[Worth, ...]) -> TableData:
    """The motions side by side."""
    head = ("motion", "rank, no noise", "rank, noise", "observable, noise", "information gain [nat]")
    rows = [(w.motion, str(w.rank), str(w.noisy_rank), str(w.observable), f"{w.gain:.1f}") for w in worth]
    note = (
        "Of the links' 30 parameters on a held trunk 17 directions can be identified at best. Noise: torques off by "
        "0.33 % of each joint's limit, CAD as prior; a gain of one nat shrinks the error of one direction to 37 %."
    )
    return TableData.of("What the motion is worth", head, rows, note)
