"""Tables as plain values, drawn in the terminal (`rich_table`), on pages (the macro `table`) and as LaTeX."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from stadera.errors import StaderaError
from stadera.identify.observability import Identifiability


@dataclass(frozen=True)
class Shown:
    """Largest number of entries of each list shown to a reader; omitted ones are counted."""

    gaps: int = 5  # of a log
    failed: int = 10  # logs of a fleet
    reasons: int = 3  # why times of a log were not used, in the terminal
    changes: int = 5  # of the load, live
    rows: int = 12  # of a table on a page
    records: int = 24  # of an experiment there; if there are more, only those that miss their bound
    named: int = 100  # points of a figure with texts of their own; more make a page too heavy
    figures: int = 1_000_000  # bytes of a fleet's figures, such that a page of 1,000 logs stays below 3 MB


SHOWN = Shown()


@dataclass(frozen=True)
class Mark:
    """Presentation of an observability verdict: a symbol and a word in addition to the colour."""

    symbol: str  # of the verdict
    word: str  # of the verdict
    style: str  # for rich, the colour of the paper's Table I
    meaning: str  # half a sentence for a legend


MARKS: dict[Identifiability, Mark] = {
    Identifiability.OBSERVABLE: Mark("●", "observable", "green", "the data alone determine it"),
    Identifiability.PARTIAL: Mark(
        "◐", "partial", "bright_black", "known only in combination with others; its own value rests on CAD"
    ),
    Identifiability.UNOBSERVABLE: Mark(
        "○", "unobservable", "red", "the data say nothing: CAD's value, or moved along with the rest"
    ),
}


@dataclass(frozen=True)
class Cell:
    """One cell of a table."""

    text: str
    # observability (Table I's colours); None for values that were not identified
    verdict: Identifiability | None = None
    strong: bool = False  # whether it is emphasised
    good: bool | None = None  # True for good and False for bad news; None for neither
    muted: bool = False  # whether it is de-emphasised, such as a value that was not measured
    note: str = ""  # displayed after it, less prominently
    link: str = ""  # on pages, what a click on it opens; empty for nothing

    @property
    def mark(self) -> Mark | None:
        """Mark of its verdict."""
        return None if self.verdict is None else MARKS[self.verdict]

    @property
    def marked(self) -> str:
        """Its text after the symbol of its verdict."""
        return f"{self.mark.symbol} {self.text}" if self.mark else self.text

    @property
    def classes(self) -> str:
        """CSS classes."""
        named = {"value": self.strong, "held": self.muted, "good": self.good is True, "bad": self.good is False}
        words = [name for name, applies in named.items() if applies]
        return " ".join([self.mark.word, *words] if self.mark else words)


Row = Sequence[str | Cell]
"""One row of a table."""


@dataclass(frozen=True)
class TableData:
    """A table: a head, and rows grouped under headings. StaderaError for a row or `sides` that do not fit the head."""

    title: str
    head: tuple[str, ...]  # one text for each column; the first column contains the rows' names
    # heading (may be empty) and its rows, each as long as the head
    groups: tuple[tuple[str, tuple[tuple[Cell, ...], ...]], ...]
    note: str = ""  # how to read it
    # for each column "l" (left), "r" (right) or "w" (left, wrapping text); empty for names to the left in the first
    # column and values to the right
    sides: str = ""

    @classmethod
    def of(
        cls,
        title: str,
        head: Sequence[str],
        body: Iterable[Row] | Mapping[str, Iterable[Row]] = (),
        note: str = "",
        sides: str = "",
    ) -> TableData:
        """Makes a table from rows of cells or texts; a mapping groups them under its keys."""
        grouped = body if isinstance(body, Mapping) else {"": body}
        groups = tuple(
            (heading, tuple(tuple(cell if isinstance(cell, Cell) else Cell(cell) for cell in row) for row in rows))
            for heading, rows in grouped.items()
        )
        return cls(title, tuple(head), groups, note, sides)

    def __post_init__(self) -> None:
        for _, rows in self.groups:
            for row in rows:
                if len(row) != len(self.head):
                    raise StaderaError(f"table {self.title!r}: a row of {len(row)} cells under {len(self.head)} titles")
        if len(self.columns) != len(self.head):
            raise StaderaError(f"table {self.title!r}: sides {self.sides!r} for {len(self.head)} columns")

    @property
    def columns(self) -> str:
        """Alignment of each column."""
        return self.sides or "l" + "r" * (len(self.head) - 1)

    @property
    def has_verdicts(self) -> bool:
        """True if it uses the colours of observability."""
        return any(cell.verdict is not None for _, rows in self.groups for row in rows for cell in row)


_ALIGNED = {"l": "l", "r": "r", "w": "p{0.5\\linewidth}"}
_SUPERSCRIPT = str.maketrans("⁻⁺⁰¹²³⁴⁵⁶⁷⁸⁹", "-+0123456789")
_TEXT = {
    "\\": r"\textbackslash{}",
    **{sign: f"\\{sign}" for sign in "&%#_{}"},
    "$": r"\textdollar{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "−": "$-$",
    "–": "--",
    "·": r"$\cdot$",
    "×": r"$\times$",
    "°": r"$^\circ$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "‖": r"$\Vert$",
    "→": r"$\to$",
    "…": r"\dots{}",
    "’": "'",
    "•": r"$\bullet$",
    "●": r"$\bullet$",
    "◐": r"$\odot$",
    "○": r"$\circ$",
    "✓": r"$\surd$",
    "✗": r"$\times$",
    "½": r"$\frac12$",
    **{greek: f"$\\{unicodedata.name(greek).split()[-1].lower()}$" for greek in "αβγδεθμπρστφχω"},
    "λ": r"$\lambda$",
    "Δ": r"$\Delta$",
    "Σ": r"$\Sigma$",
}
_RAISED = re.compile("[⁻⁺]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+")


def latex(tables: Iterable[TableData]) -> str:
    """Floats of all tables, for `\\usepackage{booktabs}`."""
    return "% made by stadera; needs \\usepackage{booktabs}\n" + "\n".join(map(_float, tables))


def escaped(text: str) -> str:
    """Escapes text as ASCII LaTeX; characters without a command become question marks."""
    text = _RAISED.sub(lambda found: f"\0{found.group().translate(_SUPERSCRIPT)}\1", text)
    made = "".join(_TEXT.get(c, c if c.isascii() else "?") for c in text)
    return made.replace("\0", "$^{").replace("\1", "}$").replace("$$", "")


def _float(table: TableData) -> str:
    columns = "".join(_ALIGNED[side] for side in table.columns)
    lines = ["\\begin{table}", "\\centering"]
    caption = ". ".join(part.rstrip(".") for part in (table.title, table.note) if part)
    lines += [f"\\caption{{{escaped(caption)}}}"] if caption else []
    lines += [f"\\begin{{tabular}}{{{columns}}}", "\\toprule", _latex_row(table.head), "\\midrule"]
    for k, (heading, rows) in enumerate(table.groups):
        lines += ["\\addlinespace"] if k else []
        lines += [f"\\multicolumn{{{len(table.head)}}}{{l}}{{\\emph{{{escaped(heading)}}}}} \\\\"] if heading else []
        lines += [_latex_row(f"{cell.marked} {cell.note}".rstrip() for cell in row) for row in rows]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", "\\end{table}", ""])


def _latex_row(texts: Iterable[str]) -> str:
    return " & ".join(map(escaped, texts)) + " \\\\"


_SIDES: dict[str, Literal["left", "right"]] = {"l": "left", "w": "left", "r": "right"}


def rich_table(data: TableData) -> Table:
    """Converts a table, with literal title and headings: rich would interpret "[kg]" as markup and drop it."""
    drawn = Table(title=Text(data.title), title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False)
    for heading, side in zip(data.head, data.columns, strict=True):
        drawn.add_column(Text(heading), justify=_SIDES[side], overflow="fold")
    for heading, rows in data.groups:
        if heading:
            drawn.add_row(Text(heading, style="italic"))
        for row in rows:
            drawn.add_row(*map(_cell, row))
        drawn.add_section()
    return drawn


def legend(note: str = "") -> Text:
    """Legend of the symbols and colours of observability."""
    text = Text()
    for mark in MARKS.values():
        text.append(f"{mark.symbol} {mark.word}  ", style=mark.style)
    return text.append(note, style="dim")


def notes(sentences: Iterable[str]) -> Iterator[Text]:
    """Notes on a result, one line each."""
    return (Text(f"note: {sentence}", style="dim") for sentence in sentences)


def _cell(cell: Cell) -> Text:
    text = Text(cell.marked, style=_style(cell))
    return text.append(f" {cell.note}", style="dim") if cell.note else text


def _style(cell: Cell) -> str:
    if cell.mark:
        return cell.mark.style
    return "bold" * cell.strong if cell.good is None else "green" if cell.good else "bold red"
