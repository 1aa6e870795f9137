"""Small pieces of HTML, with all text escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import NewType

Html = NewType("Html", str)


def text(value: object) -> Html:
    """Any text, escaped."""
    return Html(escape(str(value)))


def element(tag: str, *content: str, css: str = "", **attributes: str) -> Html:
    """One element; the content is markup already (see `text`)."""
    named = {"class": css} if css else {}
    written = "".join(f' {name}="{escape(value)}"' for name, value in (named | attributes).items())
    return Html(f"<{tag}{written}>{''.join(content)}</{tag}>")


def table(head: Sequence[str], rows: Iterable[Html], css: str = "") -> Html:
    """A table in a box that scrolls by itself where the page is too narrow. `rows` are whole <tr>."""
    titles = (element("th", title, scope="col") for title in head)
    whole = element("table", element("thead", element("tr", *titles)), element("tbody", *rows), css=css)
    return element("div", whole, css="scroll")


def row(name: str, *cells: str, css: str = "") -> Html:
    """A table row: its name, then its cells, each markup or a whole <td>."""
    written = (cell if cell.startswith("<td") else element("td", cell) for cell in cells)
    return element("tr", element("th", name, scope="row"), *written, css=css)


def items(sentences: Iterable[str], css: str = "") -> Html:
    """A list of sentences, plain text."""
    return element("ul", *(element("li", text(sentence)) for sentence in sentences), css=css)
