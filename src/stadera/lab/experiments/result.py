"""Result of an experiment as plain values: records with bounds, tables and figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from stadera.errors import StaderaError
from stadera.report.figures import Figure
from stadera.report.table import Cell, TableData
from stadera.results import Result, data_frame

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
        paper = "" if record.paper is None else f" ({record.paper:.3f})"
        cell = Cell(f"{record.value:.{3 if record.value >= 1e-3 else 4}f}{paper}", strong=True, good=record.met)
        groups.setdefault(group(record), {}).setdefault(row(record), {})[column(record)] = cell
    columns = tuple(dict.fromkeys(name for rows in groups.values() for cells in rows.values() for name in cells))
    body = {
        heading: [(name, *(cells[column] for column in columns)) for name, cells in rows.items()]
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
        return f"{self.title}: {len(self.records)} figures, {bounded - len(self.missed)} of {bounded} bounds met"

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
