"""Compares reproduced experiments with their bounds: a table of the records, and the outcome in a sentence."""

from __future__ import annotations

from collections.abc import Sequence

from stadera.lab.experiments.result import ExperimentResult, Record
from stadera.report.numbers import number
from stadera.report.shown import SHOWN
from stadera.report.table import Cell, TableData

_WORDS = {True: "met", False: "NOT met", None: ""}


def outcome(result: ExperimentResult) -> str:
    """Number of bounds met, in half a sentence."""
    bounded = sum(record.met is not None for record in result.records)
    if not result.missed:
        return f"all {bounded} bounds met"
    return f"{len(result.missed)} of {bounded} bounds NOT met"


def compared_records(result: ExperimentResult) -> tuple[Record, ...]:
    """Records that have a bound or the paper's value; if there are many, only the missed ones."""
    compared = tuple(r for r in result.records if r.bound is not None or r.paper is not None)
    return compared if len(compared) <= SHOWN.records else result.missed


def record_table(records: Sequence[Record], title: str = "Measured values, their bounds, and the paper's") -> TableData:
    """Records grouped by case, for all joints, under one heading."""
    groups: dict[str, list[tuple[Cell, ...]]] = {}
    for record in records:
        case = ", ".join(f"{name}: {value}" for name, value in record.case.items() if name != "joint")
        groups.setdefault(case, []).append(_row(record))
    return TableData.of(title, ("metric", "unit", "measured", "bound", "", "paper"), groups)


def _row(record: Record) -> tuple[Cell, ...]:
    sign = {"at most": "≤", "at least": "≥"}[record.bound_is]
    return (
        Cell(f"{record.case['joint']}: {record.metric}" if "joint" in record.case else record.metric),
        Cell("" if record.unit == "1" else record.unit),
        Cell(_figure(record.value), strong=True),
        Cell("" if record.bound is None else f"{sign} {_figure(record.bound)}"),
        Cell(_WORDS[record.met], good=record.met),
        Cell("" if record.paper is None else _figure(record.paper)),
    )


def _figure(value: float) -> str:
    return f"{value:g}" if float(value).is_integer() and abs(value) < 1e6 else number(value, 3)
