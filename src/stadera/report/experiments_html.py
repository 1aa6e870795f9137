"""The report of reproduced experiments: one self-contained page, the verdict before the numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from stadera.experiments.result import Cell, ExperimentResult, FigureData, Skipped, TableData
from stadera.report.experiment_plots import panels_figure
from stadera.report.judged import judged_records, judgement, record_table
from stadera.report.markup import Html, element, items, text
from stadera.report.page import figure_html, page_html
from stadera.report.quantities import MARKS
from stadera.report.sections import facts, header

_MEANINGS = {
    "observable": "the data fix it",
    "partial": "known only together with others; its own value leans on CAD",
    "unobservable": "no torque of this motion depends on it: CAD's",
}


def experiments_html(results: Sequence[ExperimentResult | Skipped]) -> str:
    """A whole page. Loads nothing from anywhere."""
    done = [r for r in results if isinstance(r, ExperimentResult)]
    title = done[0].title if len(done) == 1 else "Reproduced tables and figures"
    return page_html(title, _header(title, done), _verdict(results), *(_experiment(r, done) for r in done))


def _header(title: str, done: list[ExperimentResult]) -> Html:
    if len(done) == 1:
        return header(title, element("p", text(done[0].lead), css="lead"), facts(done[0].facts))
    nav = (element("a", text(r.title), href=f"#{r.name}") for r in done)
    return header(title, element("nav", *nav))


def _verdict(results: Sequence[ExperimentResult | Skipped]) -> Html:
    done = [r for r in results if isinstance(r, ExperimentResult)]
    missed = [r for r in done if r.missed]
    headline = "Not everything came out as it should" if missed else "Everything came out as it should"
    listed = []
    for result in results:
        if isinstance(result, Skipped):
            listed.append(_finding("warning", "Skipped", f"{result.name}: {result.reason}"))
            continue
        word = "Missed" if result.missed else "Met"
        listed.append(_finding("bad" if result.missed else "note", word, f"{result.title}: {judgement(result)}."))
    level = "bad" if missed else "note"
    return element("section", element("h2", text(headline)), element("ul", *listed), css=f"findings {level}")


def _finding(level: str, word: str, sentence: str) -> Html:
    return element("li", element("strong", text(word)), " ", text(sentence), css=level)


def _experiment(result: ExperimentResult, done: list[ExperimentResult]) -> Html:
    top: list[str] = []
    if len(done) > 1:
        top = [element("h2", text(result.title)), element("p", text(result.lead), css="lead"), facts(result.facts)]
    records = judged_records(result)
    tables = [*result.tables, *([record_table(records)] if records else [])]
    coloured = next((table for table in tables if table.has_verdicts), None)
    return element(
        "section",
        *top,
        *(_table(table, legend=table is coloured) for table in tables),
        *(_figure(figure) for figure in result.figures),
        *((element("h3", text("How to read this")), items(result.notes)) if result.notes else ()),
        id=result.name,
    )


def _table(data: TableData, legend: bool) -> Html:
    head = element("thead", element("tr", *(element("th", text(title), scope="col") for title in data.head)))
    body = element("tbody", *_rows(data))
    whole = element("table", head, body, css="experiment")
    below = [element("p", text(data.note), css="lead")] if data.note else []
    above = [_legend()] if legend else []
    return element("div", element("h3", text(data.title)), *above, element("div", whole, css="scroll"), *below)


def _rows(data: TableData) -> Iterator[Html]:
    for heading, rows in data.groups:
        if heading:
            yield element(
                "tr", element("th", text(heading), colspan=str(len(data.head)), scope="colgroup"), css="group"
            )
        for first, *others in rows:
            yield element("tr", element("th", text(first.text), scope="row"), *(_cell(cell) for cell in others))


def _cell(cell: Cell) -> Html:
    if cell.verdict is not None:
        mark = MARKS[cell.verdict]
        seen = element("span", text(mark.symbol), css="seen", title=mark.word, role="img", **{"aria-label": mark.word})
        return element("td", seen, " ", text(cell.text), css=f"{mark.word} {'value' if cell.strong else ''}".strip())
    if cell.good is not None:
        return element("td", text(cell.text), css="good" if cell.good else "bad")
    return element("td", text(cell.text), css="value" if cell.strong else "")


def _legend() -> Html:
    marks = (
        element("span", element("b", text(f"{m.symbol} {m.word}")), text(f": {_MEANINGS[m.word]}"), css=f"key {m.word}")
        for m in MARKS.values()
    )
    return element("p", *marks, css="legend")


def _figure(data: FigureData) -> Html:
    figure = figure_html(panels_figure(data), data.title)
    return element("div", element("h3", text(data.title)), element("p", text(data.note), css="lead"), figure)
