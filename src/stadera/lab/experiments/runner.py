"""The one runner of all experiments: cases, a function of one case, and a summary of all of them.

A case is a frozen dataclass of plain values. Cases run over cores or machines. With a folder, outcomes that are
mappings of plain values are stored immediately as lines of `<folder>/<experiment>.jsonl`, and cases found there are not
run again, so that an interrupted study can be resumed. A line is valid for the version of this package that wrote it;
an incomplete line is skipped. Texts, the paper's values and bounds are in `experiments.toml`.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field
from functools import partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from stadera.errors import StaderaError, require_known
from stadera.fleet.pool import Failure, Pool, journal, read_journal, run_tasks
from stadera.report.figures import Figure
from stadera.report.numbers import short
from stadera.report.table import Cell, TableData
from stadera.results import Result, data_frame
from stadera.types import Progress

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


Outcome = Mapping[str, Any]
"""Outcome of a case: numbers (None for missing ones), texts, and lists of them."""

Case = TypeVar("Case", bound="DataclassInstance")
Found = TypeVar("Found")
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True)
class ReproduceSettings:
    """Settings common to all experiments."""

    seed: int = 0  # of all random draws; the same seed gives the same values
    quick: bool = False  # run a short, coarse version; its values are not the published ones
    data: Path | None = None  # folder of real logs; None to search for it (see `experiments.legs.real_log`)
    keep: Path | None = None  # folder in which studies store their runs, to resume from; None for none
    seeds: int | None = None  # number of seeds for a study that repeats its whole grid for each; None for its default
    robots: tuple[str, ...] = ()  # of which the cases are run; none for all
    pool: Pool = field(default_factory=Pool)  # where cases are run

    def __post_init__(self) -> None:
        if self.seeds is not None and self.seeds < 1:
            raise StaderaError(f"a study needs at least 1 seed, got {self.seeds}")
        if self.seed < 0:
            raise StaderaError(f"a seed needs to be at least 0, got {self.seed}")


@dataclass(frozen=True)
class Experiment:
    """An experiment of the registry."""

    name: str
    run: Callable[[ReproduceSettings, Progress], ExperimentResult]  # neither prints nor writes
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

    def experiment(
        self,
        cases: Callable[[ReproduceSettings], Sequence[Case]],
        run: Callable[..., Found],
        summary: Callable[[Sequence[Case], Sequence[Found]], ExperimentResult],
        *,
        keeps: bool = False,
        keeps_logs: bool = False,
        alone: bool = False,
    ) -> Experiment:
        """The experiment that runs all cases and summarises them.

        Args:
            keeps: whether outcomes are mappings, which can be stored.
            keeps_logs: whether `run` also takes `logs`, a folder in which it stores simulated logs, or None.
            alone: whether cases run one after another in this process.
        """

        def whole(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
            grid, keep = chosen(cases(settings), self.name, settings.robots), settings.keep if keeps else None
            logs = None if keep is None else keep.absolute() / f"{self.name}-logs"
            one = partial(run, logs=logs) if keeps_logs else run
            return summary(grid, run_grid(self.name, one, grid, progress, keep, Pool(0) if alone else settings.pool))

        return Experiment(self.name, whole, self.study, self.seeded)

    def record(
        self,
        case: CaseValues,
        metric: str,
        unit: str,
        value: float,
        paper: float | None = None,
        bound: float | None = None,
        bound_is: Literal["at most", "at least"] = "at most",
    ) -> Record:
        return Record(self.name, case, metric, unit, value, paper, bound, bound_is)

    def spread(
        self, case: CaseValues, title: str, unit: str, values: Sequence[float], bounds: Bounds
    ) -> tuple[Record, ...]:
        """Median and 95th percentile of sizes; none of no sizes."""
        if not values:
            return ()
        found = {"median": np.median(values), "95th percentile": np.percentile(values, 95)}
        return tuple(
            self.record(case, f"{title}, {name}", unit, float(value), bound=bound)
            for (name, value), bound in zip(found.items(), bounds, strict=True)
        )

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


def chosen(grid: Sequence[Case], study: str, robots: Sequence[str]) -> Sequence[Case]:
    """The cases of these robots, all for none.

    Raises StaderaError: cases have no robot. UnknownNameError: none has this one.
    """
    if not robots:
        return grid
    known = [getattr(case, "robot", "") for case in grid]
    if not all(known):
        raise StaderaError(f"{study} does not run robot by robot: --robots does not apply")
    require_known("robot", robots, dict.fromkeys(known), study)
    return [case for case, robot in zip(grid, known, strict=True) if robot in robots]


def run_grid(
    study: str,
    run: Callable[[Case], Found],
    cases: Sequence[Case],
    progress: Progress,
    keep: Path | None = None,
    pool: Pool | None = None,
) -> list[Found]:
    """Returns every case's outcome, in the cases' order.

    Args:
        study: name of the study, for progress and file.
        run: a module-level, deterministic function from a case to its outcome.
        keep: folder of stored outcomes; None to store none.
        pool: where cases are run; None for one process per core. A single case is run in this process.
    """
    keys = [json.dumps(asdict(case), sort_keys=True, ensure_ascii=False, default=str) for case in cases]
    file = None if keep is None else keep / f"{study}.jsonl"
    done = {} if file is None else {str(entry["case"]): entry["outcome"] for entry in read_journal(file)}
    waiting = {key: case for key, case in zip(keys, cases, strict=True) if key not in done}
    progress(study, len(cases) - len(waiting), len(cases))
    with nullcontext(None) if file is None else journal(file) as store:
        for key, outcome in run_tasks(run, waiting, (pool or Pool()).for_tasks(len(waiting))):
            if isinstance(outcome, Failure):
                raise StaderaError(f"{study}, {key}: {outcome.reason}")
            done[key] = outcome
            if store is not None:
                store({"case": key, "outcome": outcome})
            progress(study, len(done), len(cases))
    return [done[key] for key in keys]


def grouped(pairs: Sequence[tuple[Case, Found]], key: Callable[[Case], Key]) -> dict[Key, list[tuple[Case, Found]]]:
    """Groups cases and outcomes by a key of the case, in the order of first appearance."""
    groups: dict[Key, list[tuple[Case, Found]]] = {}
    for case, outcome in pairs:
        groups.setdefault(key(case), []).append((case, outcome))
    return groups


CaseValues = Mapping[str, str | float]
"""Settings of the run, by name."""


@dataclass(frozen=True)
class Record:
    """A measured value, and what it is compared with."""

    experiment: str
    case: CaseValues  # settings of the run, by name
    metric: str  # name of the quantity
    unit: str  # of value, paper and bound; "1" for a plain number
    value: float
    paper: float | None = None  # the paper's value, None if it gives none that is comparable
    bound: float | None = None  # limit of the value, None for none
    bound_is: Literal["at most", "at least"] = "at most"  # whether the bound is an upper or a lower limit

    def __post_init__(self) -> None:
        for number in (self.value, self.paper, self.bound):
            if number is not None and not np.isfinite(number):
                raise StaderaError(f"{self.experiment}, {self.metric}: {number} is no figure to report")

    @property
    def met(self) -> bool | None:
        """Whether the bound is met; None without one."""
        if self.bound is None:
            return None
        return self.value <= self.bound if self.bound_is == "at most" else self.value >= self.bound

    def label(self) -> str:
        """Metric and unit."""
        return self.metric if self.unit == "1" else f"{self.metric} [{self.unit}]"

    def to_dict(self) -> dict[str, Any]:
        """Plain values of the JSON contract."""
        bound_is = None if self.bound is None else self.bound_is
        return {**vars(self), "case": dict(self.case), "bound_is": bound_is, "met": self.met}


Naming = Callable[[Record], str]


def crossed(
    title: str, records: Iterable[Record], group: Naming, row: Naming, column: Naming, corner: str, note: str = ""
) -> TableData:
    """A table of records by group, row and column: values, the paper's in brackets, coloured by their bounds."""
    groups: dict[str, dict[str, dict[str, Cell]]] = {}
    for record in records:
        paper = "" if record.paper is None else f" ({short(record.paper)})"
        cell = Cell(f"{short(record.value)}{paper}", strong=True, good=record.met)
        groups.setdefault(group(record), {}).setdefault(row(record), {})[column(record)] = cell
    columns = tuple(dict.fromkeys(name for rows in groups.values() for cells in rows.values() for name in cells))
    body = {
        heading: [(name, *(cells.get(column, Cell("–")) for column in columns)) for name, cells in rows.items()]
        for heading, rows in groups.items()
    }
    return TableData.of(title, (corner, *columns), body, note)


Bounds = tuple[float | None, float | None]
"""Of a median and of a 95th percentile; None for none."""


def spread(values: Sequence[float], bounds: Bounds = (None, None)) -> Cell:
    """A cell with median and 95th percentile, coloured if there are bounds."""
    if not values:
        return Cell("–")
    found = float(np.median(values)), float(np.percentile(values, 95))
    kept = [v <= b for v, b in zip(found, bounds, strict=True) if b is not None]
    return Cell(f"{found[0]:.2f}; {found[1]:.2f}", strong=bool(kept), good=all(kept) if kept else None)


@dataclass(frozen=True, eq=False, repr=False)
class ExperimentResult(Result):
    """Result of one experiment."""

    name: str
    title: str
    lead: str  # summary of the experiment for readers
    records: tuple[Record, ...]  # values with unit, the paper's value and the bound
    tables: tuple[TableData, ...] = ()  # for terminal and page, the main one first
    figures: tuple[Figure, ...] = ()  # for the page
    notes: tuple[str, ...] = ()  # explanations for the reader
    facts: Mapping[str, str] = field(default_factory=dict)  # settings of the runs, by name
    differs: tuple[str, ...] = ()  # differences from the paper, and why; empty for our own studies

    @property
    def missed(self) -> tuple[Record, ...]:
        """Records whose bound is not met."""
        return tuple(record for record in self.records if record.met is False)

    def __repr__(self) -> str:
        bounded = sum(record.met is not None for record in self.records)
        met = f", {bounded - len(self.missed)} of {bounded} bounds met" if bounded else ""
        return f"{self.title}: {len(self.records)} figures{met}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON: name, title, facts, and the records that `stadera reproduce --json` lists."""
        records = [record.to_dict() for record in self.records]
        return {"name": self.name, "title": self.title, "facts": dict(self.facts), "records": records}

    def to_dataframe(self) -> Any:
        """A pandas DataFrame, one row per record, with the case in words. MissingExtraError without pandas."""
        rows = [record.to_dict() for record in self.records]
        for row in rows:
            row["case"] = ", ".join(f"{name}: {value}" for name, value in row["case"].items())
        return data_frame({key: [row[key] for row in rows] for key in (rows[0] if rows else ())})

    def to_html(self) -> str:
        """The report as one self-contained HTML page."""
        from stadera.lab.report.experiments import experiments_html

        return experiments_html([self])

    def to_tables(self) -> list[TableData]:
        """The experiment's tables, the main one first."""
        return list(self.tables)

    def to_figures(self) -> Mapping[str, Figure | TableData]:
        """Figures figure-1, figure-2, ..., then table-1, ..."""
        shown = {f"figure-{k}": figure for k, figure in enumerate(self.figures, start=1)}
        return shown | {f"table-{k}": table for k, table in enumerate(self.tables, start=1)}


@dataclass(frozen=True)
class Skipped:
    """An experiment that was skipped, and why."""

    name: str
    reason: str
