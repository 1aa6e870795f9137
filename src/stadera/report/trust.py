"""Trust as text and colours, common to all results."""

from dataclasses import replace
from math import isfinite
from typing import Literal

from stadera.report.numbers import number
from stadera.report.table import Cell, TableData
from stadera.trust import Trust

Level = Literal["bad", "warning", "note"]
"""Severity of a remark; also its CSS class."""

LEVELS: dict[str, Level] = {"good": "note", "doubtful": "warning", "bad": "bad"}
"""Level of each verdict."""

STYLES: dict[Level, str] = {"bad": "bold red", "warning": "yellow", "note": "dim"}
"""Styles in the terminal."""

UNTRUSTED = "untrusted"
"""Mark on every value of a bad result."""


def trust_text(trust: Trust, reasons: bool = True) -> str:
    """Verdict, misfit and reasons, in one sentence."""
    misfit = f", misfit {number(trust.misfit, 3)}" if isfinite(trust.misfit) else ""
    because = "".join(f"; {reason}" for reason in trust.reasons) if reasons else ""
    return f"{trust.verdict}{misfit}{because}"


def trust_reasons(trust: Trust) -> str:
    """Basis of the verdict, as sentences: how well model and log agree, and the reasons."""
    said = [f"{reason[:1].upper()}{reason[1:]}." for reason in trust.reasons]
    if isfinite(trust.misfit):
        ratio = trust.misfit**0.5
        size = "smaller than" if ratio < 0.9 else "as large as" if ratio <= 1.1 else f"{number(ratio, 2)} times"
        begin = "The model explains the log: residuals" if ratio <= 1.1 else "Residuals"
        said.insert(0, f"{begin} are {size} the stated noise.")
    return " ".join(said)


def fit_figure(trust: Trust) -> str:
    """The misfit as a number, with what it is."""
    if not isfinite(trust.misfit):
        return "not evaluated"
    return f"{number(trust.misfit, 3)}, the residuals' variance over the stated one; 1 where both agree"


def marked(data: TableData, trust: Trust) -> TableData:
    """The table unchanged, or with every estimated value marked if the result cannot be trusted."""
    if trust.verdict != "bad":
        return data

    def mark(cell: Cell) -> Cell:
        estimated = cell.verdict is not None or cell.strong or cell.muted
        return replace(cell, text=f"✗ {cell.text}") if estimated else cell

    groups = ((heading, tuple((row[0], *map(mark, row[1:])) for row in rows)) for heading, rows in data.groups)
    return replace(data, title=f"{data.title} (✗ {UNTRUSTED})".strip(), groups=tuple(groups))
