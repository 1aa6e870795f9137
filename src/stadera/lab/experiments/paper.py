"""Settings, progress and text of experiments; the paper's values and bounds (`experiments.toml`)."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from stadera.errors import StaderaError
from stadera.fleet.pool import Pool
from stadera.lab.experiments.result import CaseValues, ExperimentResult, Record
from stadera.report.figures import Figure
from stadera.report.table import TableData
from stadera.types import Progress


@dataclass(frozen=True)
class ReproduceSettings:
    """Settings common to all experiments."""

    seed: int = 0  # of all random draws; the same seed gives the same values
    quick: bool = False  # run a short, coarse version; its values are not the published ones
    data: Path | None = None  # folder of real logs; None to search for it (see `experiments.legs.real_logs`)
    # folder in which long studies store their runs, to resume from (see `experiments.grid`); None for none
    keep: Path | None = None
    seeds: int | None = None  # number of seeds for a study that repeats its whole grid for each; None for its default
    pool: Pool = field(default_factory=Pool)  # where the runs of a grid are run

    def __post_init__(self) -> None:
        if self.seeds is not None and self.seeds < 1:
            raise StaderaError(f"a study needs at least 1 seed, got {self.seeds}")
        if self.seed < 0:
            raise StaderaError(f"a seed needs to be at least 0, got {self.seed}")


@dataclass(frozen=True)
class Experiment:
    """An experiment of the registry."""

    name: str
    title: str
    run: Callable[[ReproduceSettings, Progress], ExperimentResult]  # a pure function that neither prints nor writes
    study: bool = False  # True for hundreds of runs that take an hour: run on request only, not by `all`
    seeded: bool = False  # whether it repeats its grid for each of `ReproduceSettings.seeds`


@dataclass(frozen=True)
class Paper:
    """An experiment's entry in `experiments.toml`."""

    # name, title, lead, differs, notes, study, seeded: see `ExperimentResult` and `Experiment`
    name: str
    title: str
    lead: str
    differs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    study: bool = False
    seeded: bool = False
    values: Mapping[str, Any] = field(default_factory=dict)  # printed in the paper
    bounds: Mapping[str, float] = field(default_factory=dict)  # for records, by name

    @classmethod
    def of(cls, name: str) -> Paper:
        text = (resources.files(__package__) / "experiments.toml").read_text(encoding="utf-8")
        entry = tomllib.loads(text)[name]
        values, (differs, notes) = entry.pop("paper", {}), (tuple(entry.pop(key, ())) for key in ("differs", "notes"))
        return cls(name, values=values, differs=differs, notes=notes, **entry)

    def experiment(self, run: Callable[[ReproduceSettings, Progress], ExperimentResult]) -> Experiment:
        return Experiment(self.name, self.title, run, self.study, self.seeded)

    def record(
        self,
        case: CaseValues,
        metric: str,
        unit: str,
        value: float,
        paper: float | None = None,
        bound: float | None = None,
    ) -> Record:
        return Record(self.name, case, metric, unit, value, paper, bound)

    def result(
        self,
        records: Iterable[Record],
        tables: Iterable[TableData] = (),
        figures: Iterable[Figure] = (),
        facts: Mapping[str, str] | None = None,
        notes: tuple[str, ...] = (),
    ) -> ExperimentResult:
        """A result with the text of this entry; `notes` follow its own."""
        made, notes = (tuple(records), tuple(tables), tuple(figures)), (*self.notes, *notes)
        return ExperimentResult(self.name, self.title, self.lead, *made, notes, facts or {}, self.differs)


class Steps:
    """Reports the present step of an experiment."""

    def __init__(self, name: str, progress: Progress) -> None:
        self._name, self._progress, self._at = name, progress, ""

    def __call__(self, what: str) -> None:
        self.finished()
        self._at = f"{self._name}: {what}"
        self._progress(self._at, 0, 0)

    def finished(self) -> None:
        if self._at:
            self._progress(self._at, 1, 1)
            self._at = ""
