"""Table IV: effect of torque offsets and wrong foot positions on each method, and on the combined method."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Literal

import numpy as np

from stadera.lab.experiments.runner import ExperimentResult, Paper, Record, ReproduceSettings, crossed, grouped
from stadera.lab.experiments.standing import METHOD_NAMES, StandingCase, StandingOutcome, StandingTimes, stand
from stadera.lab.laws.poses import WIDE_FOOT, WIDE_TORQUE
from stadera.lab.plant.sensors import Gaussian, SensorErrors
from stadera.report.table import TableData

PAPER = Paper.of("table4")

Kind = Literal["torque", "foot"]
Reading = Literal["run", "sample", "drive", "misled"]


@dataclass(frozen=True)
class Table4Settings:
    """Settings of the runs."""

    load: float = 100.0  # [N]
    seeds: int = 3  # where the error is constant over a run
    averaged: StandingTimes = field(default_factory=lambda: StandingTimes(hold=4.0))  # where it is new in every sample


_HOW = Table4Settings()
_METHODS = ("orientation", "contact", "combined")
_READINGS: dict[Reading, str] = {
    "run": "measured, constant over a run",
    "sample": "measured, new in every sample",
    "drive": "constant over a run, and the drives follow what is measured",
    "misled": "constant over a run, and the controller is misled as well",
}


@dataclass(frozen=True)
class _Error:
    """Texts for a kind of error: its object, unit, columns (μ, σ), reading besides "run" and "sample"."""

    name: str
    title: str
    unit: str
    columns: tuple[tuple[float, float], ...]
    own: Reading


_ERRORS: Mapping[Kind, _Error] = {
    "torque": _Error("torque offset", "Torque offsets", "N·m", ((0.0, 1.0), (10.0, 1.0), (20.0, 1.0)), "drive"),
    "foot": _Error("foot position", "Wrong foot positions", "cm", ((0.0, 1.0), (0.0, 2.0), (0.0, 3.0)), "misled"),
}
_METRIC = "‖δ‖ in x-y, median"


@dataclass(frozen=True)
class ErrorColumn:
    """One kind of error: its kind and reading, its mean and standard deviation [N·m or cm]."""

    kind: Kind
    reading: Reading
    mean: float
    std: float

    def case(self, method: str, seed: int) -> StandingCase:
        """The run of a method under this error."""
        drawn: Literal["run", "sample"] = "sample" if self.reading == "sample" else "run"
        plain = StandingCase("hyq", method, _HOW.load, seed=seed, height=False)
        if drawn == "sample":  # it averages out, over every sample and over time
            plain = replace(plain, every=1, times=_HOW.averaged)
        if self.reading == "drive":
            return replace(plain, drive_offset=Gaussian(self.mean, self.std))
        if self.kind == "torque":
            return replace(plain, errors=SensorErrors(torque_offset=Gaussian(self.mean, self.std, drawn)))
        errors = SensorErrors(foot_position=Gaussian(0.01 * self.mean, 0.01 * self.std, drawn))
        return replace(plain, errors=errors, misled=self.reading == "misled")

    @property
    def runs(self) -> int:
        """Number of seeds: errors that average out need one."""
        return 1 if self.reading == "sample" else _HOW.seeds

    def named(self, method: str) -> dict[str, str | float]:
        """Description of a method's case under this error."""
        error = _ERRORS[self.kind]
        return {
            "error": error.name,
            f"μ [{error.unit}]": self.mean,
            f"σ [{error.unit}]": self.std,
            "reading": _READINGS[self.reading],
            "method": METHOD_NAMES[method],
        }

    def limits(self, method: str) -> tuple[float | None, float]:
        """The paper's error and the bound [cm]; for (b) and (c) the bound is the paper's error."""
        if method == "combined":
            return None, PAPER.bounds[self.kind]
        paper = PAPER.values[self.kind][method][_ERRORS[self.kind].columns.index((self.mean, self.std))]
        return paper, paper


@dataclass(frozen=True)
class ErrorCase:
    """A method's run under an error."""

    column: ErrorColumn
    method: str
    seed: int


def cases(settings: ReproduceSettings) -> list[ErrorCase]:
    """All errors, with each method."""
    if settings.quick:
        return [ErrorCase(ErrorColumn("torque", "sample", 0.0, 1.0), "contact", settings.seed)]
    readings: tuple[Reading, ...] = ("run", "sample")
    columns = [
        ErrorColumn(kind, reading, mean, std)
        for kind, error in _ERRORS.items()
        for reading in (*readings, error.own)
        for mean, std in error.columns
    ]
    return [
        ErrorCase(column, method, settings.seed + k)
        for column, method in product(columns, _METHODS)
        for k in range(column.runs)
    ]


def weigh(case: ErrorCase) -> StandingOutcome:
    return stand(case.column.case(case.method, case.seed))


def summary(cases: Sequence[ErrorCase], outcomes: Sequence[StandingOutcome]) -> ExperimentResult:
    pairs = list(zip(cases, outcomes, strict=True))
    cells = grouped(pairs, lambda case: (case.column, case.method))
    found = {cell: [outcome for _, outcome in runs] for cell, runs in cells.items()}
    records = [record for (column, method), runs in found.items() for record in _records(column, method, runs)]
    kinds = {column.kind for column, _ in found}
    return PAPER.result(
        records,
        [_table(kind, records) for kind in _ERRORS if kind in kinds],
        facts={
            "Robot": f"hyq, {_HOW.load:g} N",
            "Seeds": f"{_HOW.seeds} where the error is constant over a run, medians; else one",
            "Combined": "static poses, torque offsets and feet as unknowns; given neither kind nor size of the error",
        },
        notes=(
            f"The combined method's prior is that torques may be off by {100 * WIDE_TORQUE:g} % of their limits and "
            f"feet by {100 * WIDE_FOOT:g} cm, whatever the column; it leads the trunk through eleven poses.",
        ),
    )


EXPERIMENT = PAPER.experiment(cases, weigh, summary)


def _records(column: ErrorColumn, method: str, runs: Sequence[StandingOutcome]) -> Iterator[Record]:
    case = column.named(method)
    errors = [100 * o.in_plane for o in runs]
    yield PAPER.record(case, _METRIC, "cm", float(np.median(errors)), *column.limits(method))
    yield PAPER.record(case, "‖δ‖ in x-y, worst", "cm", max(errors))
    mass = float(np.median([abs(o.mass_error) for o in runs]))
    yield PAPER.record(case, "error of the trunk's mass, median", "kg", mass)
    stated = [float(np.linalg.norm(o.std[:2])) for o in runs if np.isfinite(o.std[:2]).all()]
    if stated:
        yield PAPER.record(case, "‖δ‖ by the estimate's own covariance, 1 σ", "cm", 100 * float(np.median(stated)))


def _table(kind: Kind, records: Sequence[Record]) -> TableData:
    error = _ERRORS[kind]
    unit = error.unit
    bound = f"{PAPER.bounds[kind]:.2f} cm"
    return crossed(
        error.title,
        (r for r in records if r.metric == _METRIC and r.case["error"] == error.name),
        group=lambda r: str(r.case["reading"]),
        row=lambda r: str(r.case["method"]),
        column=lambda r: f"μ = {r.case[f'μ [{unit}]']:g}, σ = {r.case[f'σ [{unit}]']:g} {unit}",
        corner="‖δ‖ [cm]",
        note=f"In brackets the paper's, which is the bound of (b) and (c); of the combined method it is {bound}.",
    )
