"""Many standing robots at once, and the cells and records they fill."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed

import numpy as np

from stadera.errors import StaderaError
from stadera.experiments.result import Cell, Progress, Record
from stadera.experiments.standing import stand
from stadera.experiments.standing_case import StandingCase, StandingOutcome

_PROCESSES = 2
_ALONE = 2  # cases, up to which starting processes takes longer than it saves

METHOD_NAMES: Mapping[str, str] = {
    "poses": "(a) static poses",
    "orientation": "(b) orientation error",
    "contact": "(c) contact forces",
    "combined": "combined",
}
"""As the paper calls them, by the registry's names."""


def run_cases(experiment: str, cases: Sequence[StandingCase], progress: Progress) -> list[StandingOutcome]:
    """Every case's outcome, in the cases' order; several at once, in processes of their own.

    Processes are started afresh (spawned), so a script that gets here needs the usual `if __name__ == "__main__"`.

    Raises:
        StaderaError: a case could not be run.
    """
    told = f"{experiment}: standing robots"
    progress(told, 0, len(cases))
    if len(cases) <= _ALONE or (os.cpu_count() or 1) < _PROCESSES:
        outcomes = list(_one_after_another(told, cases, progress))
    else:
        with ProcessPoolExecutor(_PROCESSES, multiprocessing.get_context("spawn")) as pool:
            futures = [pool.submit(_stand_apart, case) for case in cases]
            for done, _ in enumerate(as_completed(futures), 1):
                progress(told, done, len(cases))
            outcomes = [_known(future.result()) for future in futures]
    return outcomes


def _stand_apart(case: StandingCase) -> StandingOutcome | str:
    """The outcome, or what a user did wrong, as text: not every error survives the way between processes."""
    try:
        return stand(case)
    except StaderaError as error:
        return str(error)


def _known(outcome: StandingOutcome | str) -> StandingOutcome:
    if isinstance(outcome, str):
        raise StaderaError(outcome)
    return outcome


def _one_after_another(told: str, cases: Sequence[StandingCase], progress: Progress) -> Iterator[StandingOutcome]:
    for done, case in enumerate(cases, 1):
        yield stand(case)
        progress(told, done, len(cases))


def error_cell(record: Record) -> Cell:
    """A record's value, the paper's in brackets; good or bad news by its bound."""
    digits = 3 if record.value >= 1e-3 else 4
    paper = "" if record.paper is None else f" ({record.paper:.3f})"
    return Cell(f"{record.value:.{digits}f}{paper}", strong=True, good=record.met)


def median(values: Sequence[float]) -> float:
    """Of a case's runs with several seeds."""
    return float(np.median(values))
