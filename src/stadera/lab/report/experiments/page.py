"""Page of reproduced experiments: bounds met, then tables and figures of each."""

from __future__ import annotations

from collections.abc import Sequence

from stadera.lab.experiments.result import ExperimentResult, Skipped
from stadera.lab.report.experiments.bounds import compared_records, outcome, record_table
from stadera.report.page import render

PAPER_CITED = (
    "G. Tournois, M. Focchi, A. Del Prete, R. Orsolino, D. G. Caldwell, C. Semini: Online Payload Identification for "
    "Quadruped Robots. IEEE/RSJ International Conference on Intelligent Robots and Systems, Vancouver 2017",
    "https://hal.science/hal-01575033",
)
"""The paper, and its open copy."""


def experiments_html(results: Sequence[ExperimentResult | Skipped]) -> str:
    """The complete, self-contained page."""
    done = [result for result in results if isinstance(result, ExperimentResult)]
    missed = sum(len(result.missed) for result in done)
    bounded = sum(record.met is not None for result in done for record in result.records)
    level, word, said, why = _verdict(missed, bounded)
    return render(
        "experiments.html.j2",
        package="stadera.lab.report",
        title=done[0].title if len(done) == 1 else "Reproduced tables and figures",
        level=level,
        headline=f"{said}.",
        word=word,
        why=why,
        next=_next_steps(done),
        paper=PAPER_CITED if any(result.differs for result in done) else None,
        outcomes=[_outcome(result) for result in results],
        experiments=[_experiment(result) for result in done],
    )


def _verdict(missed: int, bounded: int) -> tuple[str, str, str, str]:
    """Level, word, headline and reason for a number of bounds missed and their total."""
    if missed:
        why = "A bound that is missed is a measurement, not an error; why is said below."
        return "warning", f"{missed} missed", f"{bounded - missed} of {bounded} bounds are met", why
    if bounded:
        return "note", "All met", f"{bounded} of {bounded} bounds are met", ""
    return "note", "Measured", "No bound is set; values alone", ""


def _next_steps(done: Sequence[ExperimentResult]) -> tuple[str, ...]:
    name = done[0].name if len(done) == 1 else "table1"
    return (
        f"Draw everything anew: `stadera reproduce {name} --seed 1`.",
        f"Take the figures and tables along: `stadera reproduce {name} --figure F.pdf --latex F.tex --json F.json`.",
    )


def _outcome(result: ExperimentResult | Skipped) -> tuple[str, str, str]:
    """Level, word and sentence."""
    if isinstance(result, Skipped):
        return "warning", "Skipped", f"{result.name}: {result.reason}"
    level, word = ("warning", "Missed") if result.missed else ("note", "Met")
    return level, word, f"{result.title}: {outcome(result)}."


def _experiment(result: ExperimentResult) -> dict[str, object]:
    """The template's values for one experiment."""
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
        "differs": result.differs,
    }
