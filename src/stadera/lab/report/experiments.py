"""Report of reproduced experiments: comparison with bounds, terminal and page."""

from collections.abc import Iterator, Sequence

from rich.console import RenderableType
from rich.padding import Padding
from rich.text import Text

from stadera.lab.experiments.runner import ExperimentResult, Record, Skipped
from stadera.report.numbers import counted, short
from stadera.report.page import render
from stadera.report.table import SHOWN, Cell, TableData, legend, rich_table

_WORDS = {True: "met", False: "NOT met", None: ""}


def outcome(records: Sequence[Record]) -> str:
    """Number of bounds met, in half a sentence; without bounds, what the values are beside."""
    bounded, missed = (sum(record.met in met for record in records) for met in ((True, False), (False,)))
    if missed:
        return f"{missed} of {counted(bounded, 'bound')} NOT met"
    if bounded:
        return "its bound is met" if bounded == 1 else f"all {bounded} bounds met"
    return "measured" + ", beside the paper's values" * any(record.paper is not None for record in records)


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
        Cell(short(record.value), strong=True),
        Cell("" if record.bound is None else f"{sign} {short(record.bound)}"),
        Cell(_WORDS[record.met], good=record.met),
        Cell("" if record.paper is None else short(record.paper)),
    )


def experiment_renderables(result: ExperimentResult | Skipped) -> Iterator[RenderableType]:
    """One experiment."""
    if isinstance(result, Skipped):
        yield Text(f"{result.name} skipped: {result.reason}\n", style="yellow")
        return
    yield Padding(Text(result.title, style="bold reverse"), (0, 0, 1, 0))
    yield Padding(Text(result.lead), (0, 0, 1, 0))
    for table in result.tables:
        yield rich_table(table)
        below = legend(table.note) if table.has_verdicts else Text(table.note, style="dim")
        yield Padding(below, (0, 0, 1, 1))
    if records := compared_records(result):
        yield rich_table(record_table(records))
    yield Text(f"{result.name}: {outcome(result.records)}\n", style="bold red" if result.missed else "bold green")


PAPER_CITED = (
    "G. Tournois, M. Focchi, A. Del Prete, R. Orsolino, D. G. Caldwell, C. Semini: Online Payload Identification for "
    "Quadruped Robots. IEEE/RSJ International Conference on Intelligent Robots and Systems, Vancouver 2017",
    "https://hal.science/hal-01575033",
)
"""The paper, and its open copy."""


def experiments_html(results: Sequence[ExperimentResult | Skipped]) -> str:
    """The complete, self-contained page."""
    done = [result for result in results if isinstance(result, ExperimentResult)]
    level, word, said, why = _verdict([record for result in done for record in result.records])
    again = f"stadera reproduce {done[0].name if len(done) == 1 else 'table1'}"
    return render(
        "experiments.html.j2",
        package="stadera.lab.report",
        title=done[0].title if len(done) == 1 else "Reproduced tables and figures",
        level=level,
        headline=f"{said}.",
        word=word,
        why=why,
        next=(
            f"Draw everything anew: `{again} --seed 1`.",
            f"Take the figures and tables along: `{again} --figure F.pdf --latex F.tex --json F.json`.",
        ),
        paper=PAPER_CITED if any(result.differs for result in done) else None,
        outcomes=[_outcome(result) for result in results],
        experiments=[_experiment(result) for result in done],
    )


def _verdict(records: Sequence[Record]) -> tuple[str, str, str, str]:
    missed, bounded = (sum(record.met in met for record in records) for met in ((False,), (True, False)))
    said = f"{bounded - missed} of {counted(bounded, 'bound')} met" if bounded else outcome(records).capitalize()
    if missed:
        why = "A bound that is missed is a measurement, not an error; why is said below."
        return "warning", f"{missed} missed", said, why
    return "note", "All met" if bounded else "Measured", said, ""


def _outcome(result: ExperimentResult | Skipped) -> tuple[str, str, str]:
    if isinstance(result, Skipped):
        return "warning", "Skipped", f"{result.name}: {result.reason}"
    level, word, *_ = _verdict(result.records)
    return level, word, f"{result.title}: {outcome(result.records)}."


def _experiment(result: ExperimentResult) -> dict[str, object]:
    records = compared_records(result)
    tables = [*result.tables, *([record_table(records)] if records else [])]
    coloured = next((table for table in tables if table.has_verdicts), None)
    return {**vars(result), "tables": tables, "coloured": coloured, "plots": list(result.figures)}
