"""The page of reproduced experiments: which bounds are met, then tables and figures of each."""

from __future__ import annotations

from collections.abc import Sequence

from stadera.lab.experiments.result import ExperimentResult, Skipped
from stadera.lab.report.experiments.bounds import compared_records, outcome, record_table
from stadera.report.page import render


def experiments_html(results: Sequence[ExperimentResult | Skipped]) -> str:
    """A whole page. Loads nothing from anywhere."""
    done = [result for result in results if isinstance(result, ExperimentResult)]
    missed = any(result.missed for result in done)
    return render(
        "experiments.html.j2",
        package="stadera.lab.report",
        title=done[0].title if len(done) == 1 else "Reproduced tables and figures",
        level="bad" if missed else "note",
        headline="Not every bound is met" if missed else "Every bound is met",
        outcomes=[_outcome(result) for result in results],
        experiments=[_experiment(result) for result in done],
    )


def _outcome(result: ExperimentResult | Skipped) -> tuple[str, str, str]:
    """Level, word and sentence."""
    if isinstance(result, Skipped):
        return "warning", "Skipped", f"{result.name}: {result.reason}"
    level, word = ("bad", "Missed") if result.missed else ("note", "Met")
    return level, word, f"{result.title}: {outcome(result)}."


def _experiment(result: ExperimentResult) -> dict[str, object]:
    """What the template shows of one experiment."""
    records = compared_records(result)
    tables = [*result.tables, *([record_table(records)] if records else [])]
    return {
        "name": result.name,
        "title": result.title,
        "lead": result.lead,
        "facts": result.facts,
        "tables": tables,
        "coloured": next((table for table in tables if table.has_verdicts), None),
        "plots": list(result.figures),
        "notes": result.notes,
    }
