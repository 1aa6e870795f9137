"""Reproduced experiments against their bounds: the records as a table, and the verdict in a sentence."""

from __future__ import annotations

from collections.abc import Sequence

from stadera.experiments.result import Cell, ExperimentResult, Record, TableData
from stadera.report.numbers import number

_MOST_RECORDS = 24
_WORDS = {True: "met", False: "NOT met", None: ""}


def judgement(result: ExperimentResult) -> str:
    """How many bounds were kept, in one sentence."""
    bounded = sum(record.met is not None for record in result.records)
    if not result.missed:
        return f"all {bounded} bounds met"
    return f"{len(result.missed)} of {bounded} bounds NOT met"


def judged_records(result: ExperimentResult) -> tuple[Record, ...]:
    """Records held against a bound or the paper; of very many the missed ones alone, for the tables show the rest."""
    judged = tuple(r for r in result.records if r.bound is not None or r.paper is not None)
    return judged if len(judged) <= _MOST_RECORDS else result.missed


def record_table(records: Sequence[Record], title: str = "Measured, and what it was held against") -> TableData:
    """Records, those of one case, whatever the joint, under one heading."""
    groups: dict[str, list[tuple[Cell, ...]]] = {}
    for record in records:
        case = ", ".join(f"{name}: {value}" for name, value in record.case.items() if name != "joint")
        groups.setdefault(case, []).append(_row(record))
    head = ("metric", "unit", "measured", "bound", "", "paper")
    return TableData(title, head, tuple((case, tuple(rows)) for case, rows in groups.items()))


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
