"""Trust in words and colours, for every result."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite
from typing import Literal

from stadera.report.numbers import number
from stadera.report.table import Cell, TableData
from stadera.trust import Trust

Level = Literal["bad", "warning", "note"]
"""How serious a remark is; also its CSS class."""

LEVELS: dict[str, Level] = {"good": "note", "doubtful": "warning", "bad": "bad"}
"""By verdict."""

STYLES: dict[Level, str] = {"bad": "bold red", "warning": "yellow", "note": "dim"}
"""In the terminal."""


UNTRUSTED = "untrusted"
"""The mark of every figure of a result that is bad."""


def trust_text(trust: Trust, reasons: bool = True) -> str:
    """Verdict, misfit and reasons, in one sentence."""
    misfit = f", misfit {number(trust.misfit, 3)}" if isfinite(trust.misfit) else ""
    because = "".join(f"; {reason}" for reason in trust.reasons) if reasons else ""
    return f"{trust.verdict}{misfit}{because}"


def trust_reasons(trust: Trust) -> str:
    """What the verdict rests on: misfit and reasons, as sentences."""
    misfit = f"Misfit {number(trust.misfit, 3)}, where 1 is right." if isfinite(trust.misfit) else ""
    return " ".join([misfit, *(f"{reason[:1].upper()}{reason[1:]}." for reason in trust.reasons)]).strip()


def marked(data: TableData, trust: Trust) -> TableData:
    """The table as it is, or with every estimated figure marked if the result is not to be trusted."""
    if trust.verdict != "bad":
        return data
    groups = ((heading, tuple((row[0], *map(_marked, row[1:])) for row in rows)) for heading, rows in data.groups)
    return replace(data, title=f"{data.title} (✗ {UNTRUSTED})".strip(), groups=tuple(groups))


def _marked(cell: Cell) -> Cell:
    estimated = cell.verdict is not None or cell.strong or cell.muted
    return replace(cell, text=f"✗ {cell.text}") if estimated else cell
