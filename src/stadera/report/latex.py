"""Tables for LaTeX: booktabs, numbers in math mode, plain ASCII, for any engine."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

from stadera.report.table import TableData

_SIDES = {"l": "l", "r": "r", "w": "p{0.5\\linewidth}"}
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
    columns = "".join(_SIDES[side] for side in table.columns)
    lines = ["\\begin{table}", "\\centering"]
    caption = ". ".join(part.rstrip(".") for part in (table.title, table.note) if part)
    lines += [f"\\caption{{{escaped(caption)}}}"] if caption else []
    lines += [f"\\begin{{tabular}}{{{columns}}}", "\\toprule", _row(table.head), "\\midrule"]
    for k, (heading, rows) in enumerate(table.groups):
        lines += ["\\addlinespace"] if k else []
        lines += [f"\\multicolumn{{{len(table.head)}}}{{l}}{{\\emph{{{escaped(heading)}}}}} \\\\"] if heading else []
        lines += [_row(f"{cell.marked} {cell.note}".rstrip() for cell in row) for row in rows]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", "\\end{table}", ""])


def _row(texts: Iterable[str]) -> str:
    return " & ".join(map(escaped, texts)) + " \\\\"
