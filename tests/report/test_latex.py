"""LaTeX of tables: balanced, one cell a column, ASCII."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stadera.identify.observability import Identifiability
from stadera.report.table import Cell, TableData, escaped, latex


def balanced(text: str) -> bool:
    depth = 0
    for brace in re.findall(r"(?<!\\)[{}]", text.replace(r"\\", "")):
        depth += 1 if brace == "{" else -1
        if depth < 0:
            return False
    return depth == 0 and len(re.findall(r"(?<!\\)\$", text)) % 2 == 0


@pytest.mark.parametrize("name", ["result", "weighed", "rested"])
def test_tables_of_results(name: str, request: pytest.FixtureRequest) -> None:
    made = request.getfixturevalue(name).to_latex()
    assert made.isascii()
    assert balanced(made)
    for begun in ("table", "tabular"):
        assert made.count(f"\\begin{{{begun}}}") == made.count(f"\\end{{{begun}}}") >= 2
    for columns, body in re.findall(r"\\begin\{tabular\}\{([lr]+)\}(.*?)\\end\{tabular\}", made, re.DOTALL):
        rows = [row for row in body.splitlines() if row.endswith(r"\\") and "multicolumn" not in row]
        assert {len(re.findall(r"(?<!\\)&", row)) + 1 for row in rows} == {len(columns)}


def test_symbols() -> None:
    assert escaped("−3.6 ± 6.1·10⁻⁵ kg·m²") == (r"$-$3.6 $\pm$ 6.1$\cdot$10$^{-5}$ kg$\cdot$m$^{2}$")
    assert escaped("50 % of λ & rf_haa #1 $") == r"50 \% of $\lambda$ \& rf\_haa \#1 \textdollar{}"
    assert escaped("語") == "?"


def test_marks_and_groups() -> None:
    table = TableData.of(
        "A & B", ("link", "mass [kg]"), {"hip": [("m", Cell("2.0", Identifiability.PARTIAL, note="[2.1]"))]}
    )
    made = latex([table])
    assert r"\caption{A \& B}" in made
    assert r"\multicolumn{2}{l}{\emph{hip}} \\" in made
    assert r"m & $\odot$ 2.0 [2.1] \\" in made


@given(st.text(alphabet="a±−·²⁻⁵%&_#$~^\\{}λ€ ", max_size=30))
def test_any_text_is_balanced(text: str) -> None:
    made = escaped(text)
    assert made.isascii()
    assert len(re.findall(r"(?<!\\)\$", made.replace(r"\textdollar{}", ""))) % 2 == 0
