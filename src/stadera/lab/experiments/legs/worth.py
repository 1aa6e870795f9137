"""Information expected from the paper's random draw and from the optimised excitation, without any log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stadera.excite.bounds import LegBounds
from stadera.excite.optimise import FourierSearch, optimal_excitation
from stadera.excite.sinusoids import Reference
from stadera.excite.worth import LegExperiment
from stadera.identify.observability import Identifiability
from stadera.lab.experiments.legs.runs import LEG, LegRuns
from stadera.lab.experiments.paper import Paper
from stadera.lab.experiments.result import Record
from stadera.legs import FrictionModel
from stadera.report.table import TableData

_NOISELESS = 1e-7
_RATE = 100.0  # Hz, at which motions are evaluated
_QUICK = FourierSearch(starts=1, iterations=10)
_SEARCH = FourierSearch(starts=2, iterations=40)


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


def worth_records(paper: Paper, worth: tuple[Worth, ...]) -> Iterator[Record]:
    """Ranks and gains of each motion, the paper's first."""
    for w in worth:
        case, printed = {"motion": w.motion}, paper.values["rank"] if w is worth[0] else None
        yield paper.record(case, "rank without noise, of 30", "1", w.rank, printed)
        yield paper.record(case, "rank with torque noise, of 30", "1", w.noisy_rank)
        yield paper.record(case, "information gain", "nat", w.gain)


def worth_table(worth: tuple[Worth, ...]) -> TableData:
    """The motions side by side."""
    head = ("motion", "rank, no noise", "rank, noise", "observable, noise", "information gain [nat]")
    rows = [(w.motion, str(w.rank), str(w.noisy_rank), str(w.observable), f"{w.gain:.1f}") for w in worth]
    note = (
        "Of the links' 30 parameters on a held trunk 17 directions can be identified at best. Noise: torques off by "
        "0.33 % of each joint's limit, CAD as prior; a gain of one nat shrinks the error of one direction to 37 %."
    )
    return TableData.of("What the motion is worth", head, rows, note)
