"""What the pages of all reports are made of: the head with its facts and figures, plots, lists, the words explained."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import plotly.graph_objects as go

import stadera
from stadera.report.markup import Html, element, items, text
from stadera.report.page import figure_html


def header(title: str, *parts: str, notes: Sequence[str] = ()) -> Html:
    """The top of a page: who made it, its title, what else is given, then the notes on how it was made."""
    return element(
        "header",
        element("p", text(f"stadera {stadera.__version__}"), css="brand"),
        element("h1", text(title)),
        *parts,
        items(notes, css="steps") if notes else "",
    )


def facts(named: Mapping[str, str]) -> Html:
    """What was looked at, name by name."""
    return _definitions(named, "facts")


def cards(figures: Iterable[Html]) -> Html:
    """The figures that matter most, side by side (see `card`)."""
    return element("div", *figures, css="cards")


def card(label: str, figure: str, unit: str = "kg", *, good: bool = True) -> Html:
    """One figure, large; in the colour of what was identified where it is good."""
    return element(
        "div",
        element("p", text(label), css="label"),
        element("p", text(figure), " ", element("small", text(unit)), css="figure"),
        css="card identified" if good else "card",
    )


def plot(title: str, note: str, figure: go.Figure) -> Html:
    """A section with one figure."""
    return element(
        "section", element("h2", text(title)), element("p", text(note), css="lead"), figure_html(figure, title)
    )


def listing(title: str, listed: Html, more: int) -> Html:
    """A section with a table, of which so many more rows are left out."""
    below = [element("p", text(f"and {more} more"), css="lead")] if more > 0 else []
    return element("section", element("h2", text(title)), listed, *below)


def words(terms: Mapping[str, str], title: str = "How to read the numbers", **attributes: str) -> Html:
    """A section that says what each word means."""
    return element("section", element("h2", text(title)), _definitions(terms, "terms"), **attributes)


def _definitions(named: Mapping[str, str], css: str) -> Html:
    listed = (element("div", element("dt", text(name)), element("dd", text(value))) for name, value in named.items())
    return element("dl", *listed, css=css)
