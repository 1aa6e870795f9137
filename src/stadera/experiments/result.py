"""What an experiment gives back, as plain values: records with bounds, tables and figures still to be drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from stadera.errors import StaderaError
from stadera.identify.observability import Verdict

Array = NDArray[np.float64]

Progress = Callable[[str, int, int], None]
"""Told a step's name, how much of it is done, and how much there is (0: not known)."""


@dataclass(frozen=True)
class ReproduceSettings:
    """What all experiments are told.

    Attributes:
        seed: of every random draw; the same seed gives the same figures.
        quick: a short, coarse version that shows the same in less time; its figures are not the published ones.
        data: the folder of real logs; None to look for it (see `experiments.real_logs`).
        keep: the folder in which long studies keep their runs, to go on from (see `experiments.grid`); None for none.
        seeds: how many, of a study that repeats its whole grid for each; None for as many as it has.

    Raises:
        StaderaError: a negative seed, less than one of them.
    """

    seed: int = 0
    quick: bool = False
    data: Path | None = None
    keep: Path | None = None
    seeds: int | None = None

    def __post_init__(self) -> None:
        if self.seeds is not None and self.seeds < 1:
            raise StaderaError(f"a study needs at least 1 seed, got {self.seeds}")
        if self.seed < 0:
            raise StaderaError(f"a seed needs to be at least 0, got {self.seed}")


@dataclass(frozen=True)
class Record:
    """One measured figure, and what it was held against.

    Attributes:
        experiment: its name.
        case: what was run, by name.
        metric: what was measured.
        unit: of value, paper and bound; "1" for a plain number.
        value: measured.
        paper: what the paper prints, None where it prints nothing that compares.
        bound: what the value has to keep to, None where nothing was promised.
        bound_is: whether the bound is the largest or the least value that meets it.

    Raises:
        StaderaError: a value or bound that is not finite.
    """

    experiment: str
    case: Mapping[str, str | float]
    metric: str
    unit: str
    value: float
    paper: float | None = None
    bound: float | None = None
    bound_is: Literal["at most", "at least"] = "at most"

    def __post_init__(self) -> None:
        for number in (self.value, self.paper, self.bound):
            if number is not None and not np.isfinite(number):
                raise StaderaError(f"{self.experiment}, {self.metric}: {number} is no figure to report")

    @property
    def met(self) -> bool | None:
        """Whether the bound is kept; None without one."""
        if self.bound is None:
            return None
        return self.value <= self.bound if self.bound_is == "at most" else self.value >= self.bound

    def to_dict(self) -> dict[str, Any]:
        """As the JSON contract has it."""
        return {
            "experiment": self.experiment,
            "case": dict(self.case),
            "metric": self.metric,
            "unit": self.unit,
            "value": self.value,
            "paper": self.paper,
            "bound": self.bound,
            "bound_is": None if self.bound is None else self.bound_is,
            "met": self.met,
        }


@dataclass(frozen=True)
class Cell:
    """One entry of a table.

    Attributes:
        text: as printed.
        verdict: how far the data know it (Table I's colours); None for what was not identified.
        strong: whether it stands out.
        good: whether it is good or bad news; None for neither.
    """

    text: str
    verdict: Verdict | None = None
    strong: bool = False
    good: bool | None = None


@dataclass(frozen=True)
class TableData:
    """A table: a head, and rows grouped under headings.

    Attributes:
        title: what it shows.
        head: one text a column; the first column holds the rows' names.
        groups: heading (may be empty) and its rows, each as long as the head.
        note: how to read it.
        verdicts: whether the colours of observability are used in it.

    Raises:
        StaderaError: a row that does not fit the head.
    """

    title: str
    head: tuple[str, ...]
    groups: tuple[tuple[str, tuple[tuple[Cell, ...], ...]], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for _, rows in self.groups:
            for row in rows:
                if len(row) != len(self.head):
                    raise StaderaError(f"table {self.title!r}: a row of {len(row)} cells under {len(self.head)} titles")

    @property
    def has_verdicts(self) -> bool:
        """Whether it uses the colours of observability."""
        return any(cell.verdict is not None for _, rows in self.groups for row in rows for cell in row)


@dataclass(frozen=True, eq=False)
class Line:
    """One curve of a panel.

    Attributes:
        name: as in the legend.
        role: what it stands for, which gives its colour: measured, identified, prior_friction or prior.
        x, y: (samples,).
        kind: a line, markers, or bars.
        std: (samples,), error bars; None for none.
    """

    name: str
    role: str
    x: Array
    y: Array
    kind: Literal["line", "markers", "bars"] = "line"
    std: Array | None = None


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes."""

    title: str
    x_title: str
    y_title: str
    lines: tuple[Line, ...]
    log_y: bool = False
    labels: tuple[str, ...] = ()
    """Of x = 0, 1, 2, ...; empty where x is a quantity."""


@dataclass(frozen=True, eq=False)
class FigureData:
    """Panels one below the other."""

    title: str
    panels: tuple[Panel, ...]
    note: str = ""


@dataclass(frozen=True, eq=False)
class ExperimentResult:
    """What one experiment showed.

    Attributes:
        name, title: of the experiment.
        lead: what was done, in a few sentences for a reader who has not seen it.
        records: figures, each with unit, the paper's value and its bound.
        tables: for terminal and page; the first is the one the experiment is about.
        figures: for the page.
        notes: what a reader should know besides.
        facts: what was run, by name.
    """

    name: str
    title: str
    lead: str
    records: tuple[Record, ...]
    tables: tuple[TableData, ...] = ()
    figures: tuple[FigureData, ...] = ()
    notes: tuple[str, ...] = ()
    facts: Mapping[str, str] = field(default_factory=dict)

    @property
    def missed(self) -> tuple[Record, ...]:
        """Records whose bound is not kept."""
        return tuple(record for record in self.records if record.met is False)


@dataclass(frozen=True)
class Skipped:
    """An experiment that was left out, and why."""

    name: str
    reason: str


class Steps:
    """Tells whoever watches an experiment which step it is at."""

    def __init__(self, name: str, progress: Progress) -> None:
        self._name, self._progress, self._at = name, progress, ""

    def __call__(self, what: str) -> None:
        """The next step begins, and so the last one is over."""
        self.finished()
        self._at = f"{self._name}: {what}"
        self._progress(self._at, 0, 0)

    def finished(self) -> None:
        """The last step is over."""
        if self._at:
            self._progress(self._at, 1, 1)
            self._at = ""


@dataclass(frozen=True)
class Experiment:
    """An experiment as the registry holds it.

    Attributes:
        name, title: of it.
        run: pure, it neither prints nor writes.
        study: hundreds of runs, for which an hour is needed: asked for by name, and left out of all.
        seeded: it repeats its grid for each of `ReproduceSettings.seeds`.
    """

    name: str
    title: str
    run: Callable[[ReproduceSettings, Progress], ExperimentResult]
    study: bool = False
    seeded: bool = False
