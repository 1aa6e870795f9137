"""Table IV: what torque offsets and wrong foot positions do to each method, and to all evidence taken together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stadera.estimate.combined import WIDE_FOOT, WIDE_TORQUE
from stadera.estimate.equilibrium import ConstantErrors
from stadera.estimate.noise import ForceNoise
from stadera.estimate.static_poses import PoseOffset, expected_covariance
from stadera.experiments.result import (
    Cell,
    Experiment,
    ExperimentResult,
    Progress,
    Record,
    ReproduceSettings,
    TableData,
)
from stadera.experiments.standing import poses_of
from stadera.experiments.standing_case import StandingCase, StandingOutcome
from stadera.experiments.standing_runs import METHOD_NAMES, error_cell, median, run_cases
from stadera.robot import Robot, load_robot
from stadera.sim import Gaussian, with_foot_position, with_torque_offset

NAME = "table4"

Kind = Literal["torque", "foot"]
Reading = Literal["run", "sample", "drive", "misled"]

_LOAD = 100.0  # N
_SEEDS = 3
_LONG_HOLD = 4.0  # s
_PAPER: dict[tuple[Kind, str], tuple[float, float, float]] = {
    ("torque", "orientation"): (0.410, 1.114, 2.098),
    ("torque", "contact"): (0.073, 0.190, 0.255),
    ("foot", "orientation"): (0.001, 0.060, 0.202),
    ("foot", "contact"): (0.308, 2.661, 5.074),
}  # cm, by column
_COLUMNS: dict[Kind, tuple[tuple[float, float], ...]] = {
    "torque": ((0.0, 1.0), (10.0, 1.0), (20.0, 1.0)),  # μ, σ in N·m
    "foot": ((0.0, 1.0), (0.0, 2.0), (0.0, 3.0)),  # μ, σ in cm
}
_COMBINED_BOUND: dict[Kind, float] = {"torque": 0.26, "foot": 0.21}  # cm
_METHODS = ("orientation", "contact", "combined")
_READINGS: dict[Reading, str] = {
    "run": "measured, constant over a run",
    "sample": "measured, new in every sample",
    "drive": "constant over a run, and the drives follow what is measured",
    "misled": "constant over a run, and the controller is misled as well",
}
_OF: dict[Kind, tuple[Reading, ...]] = {"torque": ("run", "sample", "drive"), "foot": ("run", "sample", "misled")}
_UNIT: dict[Kind, str] = {"torque": "N·m", "foot": "cm"}
_METRIC = "‖δ‖ in x-y, median"
_STATED = "‖δ‖ by the estimate's own covariance, 1 σ"
_LEAD = (
    "HyQ with 100 N on it, as in Table II, but every joint torque or every coordinate of every foot is off by a "
    "Gaussian error. The paper does not say whether it is drawn once a run or for every sample; both are run. Torques "
    "have a third reading: the drives regulate the torque that is measured, so that what acts on the joints is off as "
    "well, which is how method (b), that measures no torque, can suffer as it does in the paper."
)


@dataclass(frozen=True)
class Column:
    """One kind of error: which, how it is read, its mean and standard deviation [N·m or cm]."""

    kind: Kind
    reading: Reading
    mean: float
    std: float

    def case(self, method: str, seed: int) -> StandingCase:
        """The run of a method under it."""
        drawn: Literal["run", "sample"] = "sample" if self.reading == "sample" else "run"
        plain = StandingCase("hyq", method, _LOAD, seed=seed, height=False)
        if drawn == "sample":  # it averages out, over every sample and over time
            plain = replace(plain, every=1, hold=_LONG_HOLD)
        if self.reading == "drive":
            return replace(plain, drive_offset=Gaussian(self.mean, self.std))
        if self.kind == "torque":
            return replace(plain, errors=with_torque_offset(self.mean, self.std, drawn))
        misled = self.reading == "misled"
        errors = with_foot_position(0.01 * self.mean, 0.01 * self.std, drawn)
        return replace(plain, errors=errors, misled=misled)

    @property
    def runs(self) -> int:
        """How many seeds: errors that average out need one."""
        return 1 if self.reading == "sample" else _SEEDS


def run(settings: ReproduceSettings, progress: Progress) -> ExperimentResult:
    """Weighs HyQ by three methods under all errors."""
    cells = [(column, method) for column in _columns() for method in _METHODS]
    if settings.quick:
        cells = [(Column("torque", "sample", 0.0, 1.0), "contact")]
    planned = [(column, method, settings.seed + k) for column, method in cells for k in range(column.runs)]
    outcomes = run_cases(NAME, [column.case(method, seed) for column, method, seed in planned], progress)
    found: dict[tuple[Column, str], list[StandingOutcome]] = {cell: [] for cell in cells}
    for (column, method, _), outcome in zip(planned, outcomes, strict=True):
        found[column, method].append(outcome)
    records = [record for (column, method), runs in found.items() for record in _records(column, method, runs)]
    return ExperimentResult(
        name=NAME,
        title="Table IV: torque offsets and wrong foot positions",
        lead=_LEAD,
        records=tuple(records),
        tables=tuple(_table(kind, found) for kind in _OF if any(c.kind == kind for c, _ in found)),
        notes=_notes(),
        facts={
            "Robot": f"hyq, {_LOAD:g} N",
            "Seeds": f"{_SEEDS} where the error is constant over a run, medians; else one",
            "Combined": "static poses, torque offsets and feet as unknowns; told neither kind nor size of the error",
        },
    )


def _columns() -> Iterator[Column]:
    for kind, readings in _OF.items():
        for reading in readings:
            for mean, std in _COLUMNS[kind]:
                yield Column(kind, reading, mean, std)


def _records(column: Column, method: str, runs: list[StandingOutcome]) -> Iterator[Record]:
    case = _case(column, method)
    yield _error_record(column, method, runs)
    yield Record(NAME, case, "‖δ‖ in x-y, worst", "cm", 100 * max(o.in_plane for o in runs))
    yield Record(NAME, case, "error of the trunk's mass, median", "kg", median([abs(o.mass_error) for o in runs]))
    stated = [float(np.linalg.norm(o.std[:2])) for o in runs if np.isfinite(o.std[:2]).all()]
    if stated:
        yield Record(NAME, case, _STATED, "cm", 100 * median(stated))


def _case(column: Column, method: str) -> dict[str, str | float]:
    unit = _UNIT[column.kind]
    return {
        "error": "torque offset" if column.kind == "torque" else "foot position",
        f"μ [{unit}]": column.mean,
        f"σ [{unit}]": column.std,
        "reading": _READINGS[column.reading],
        "method": METHOD_NAMES[method],
    }


def _error_record(column: Column, method: str, runs: list[StandingOutcome]) -> Record:
    if method == "combined":
        paper, bound = None, _COMBINED_BOUND[column.kind]
    else:
        paper = _PAPER[column.kind, method][_COLUMNS[column.kind].index((column.mean, column.std))]
        bound = paper
    value = 100 * median([o.in_plane for o in runs])
    return Record(NAME, _case(column, method), _METRIC, "cm", value, paper, bound)


def _table(kind: Kind, found: dict[tuple[Column, str], list[StandingOutcome]]) -> TableData:
    mine = {cell: runs for cell, runs in found.items() if cell[0].kind == kind}
    columns = tuple(dict.fromkeys((column.mean, column.std) for column, _ in mine))
    groups = []
    for reading in dict.fromkeys(column.reading for column, _ in mine):
        rows = []
        for method in dict.fromkeys(method for column, method in mine if column.reading == reading):
            cells = [Column(kind, reading, mean, std) for mean, std in columns]
            rows.append((Cell(METHOD_NAMES[method]), *(_cell(c, method, mine[c, method]) for c in cells)))
        groups.append((_READINGS[reading], tuple(rows)))
    unit = _UNIT[kind]
    head = ("‖δ‖ [cm]", *(f"μ = {mean:g}, σ = {std:g} {unit}" for mean, std in columns))
    note = (
        "In brackets the paper's, which is the bound of (b) and (c); of the combined method it is "
        f"{_COMBINED_BOUND[kind]:.2f} cm. {_reach(kind)}"
    )
    title = "Torque offsets" if kind == "torque" else "Wrong foot positions"
    return TableData(title, head, tuple(groups), note)


def _cell(column: Column, method: str, runs: list[StandingOutcome]) -> Cell:
    return error_cell(_error_record(column, method, runs))


def _reach(kind: Kind) -> str:
    """What constant errors of the table's own sizes leave of the centre of mass, whoever looks, in one sentence."""
    robot, told = load_robot("hyq"), []
    poses = poses_of("hyq", 11)
    for mean, std in _COLUMNS[kind]:
        one, every = (100 * _expected(Column(kind, "run", mean, std), robot, p) for p in (poses[:1], poses))
        told.append(f"{one:.2f} cm in one pose and {every:.2f} cm over all (μ = {mean:g}, σ = {std:g} {_UNIT[kind]})")
    what = "torque offsets" if kind == "torque" else "errors of the feet"
    return (
        f"Where constant {what} are all that is wrong and their sizes are known, their signs and their common part "
        f"being Gaussian too, the Cramér-Rao bound of the equations at rest on ‖δ‖ is, 1 σ: {'; '.join(told)}."
    )


def _expected(column: Column, robot: Robot, poses: Sequence[PoseOffset]) -> float:
    """‖δ‖ [m], 1 σ, that constant errors leave; their mean μ as a common part of standard deviation μ."""
    torque = np.full((4, 3), column.std if column.kind == "torque" else 1e-6)
    foot = 0.01 * column.std if column.kind == "foot" else 0.0
    noise = ForceNoise(np.full((4, 3), 1e-3), torque, foot)
    errors = ConstantErrors.of(noise, orientation=1e-6, common_torque=column.mean if column.kind == "torque" else 0.0)
    covariance = expected_covariance(robot, poses, errors, seek_errors=True)
    return float(np.sqrt(covariance[1, 1] + covariance[2, 2]))


def _notes() -> tuple[str, ...]:
    return (
        "What is wrong with the feet is told to estimators; the controller goes by encoders that are right, as it must "
        "have in the paper, whose method (b) hardly notices. In the last reading it is misled by the same error.",
        "Method (b) reads an orientation, so that errors in the measured torque reach it through the mass alone, which "
        "has no say in the end: its error vanishes with the orientation's. With drives that follow a wrong torque it "
        "does not; by eq. 12 the trunk then balances about another point.",
        f"The combined method is told no more than that torques may be off by {100 * WIDE_TORQUE:g} % of their limits "
        f"and feet by {100 * WIDE_FOOT:g} cm, whatever the column, and leads the trunk through eleven poses.",
    )


EXPERIMENT = Experiment(NAME, "Table IV, torque offsets and wrong foot positions", run)
