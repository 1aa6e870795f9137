"""Tables of the terminal show what they are given."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from stadera.errors import StaderaError
from stadera.report.table import TableData, rich_table


def test_brackets_in_headings_and_title_are_text() -> None:
    data = TableData.of(
        "forces [N]", ("leg", "mass [kg]", "[red]", "torque [N·m]"), [("LF", "1", "[b]", "3")], sides="llrr"
    )
    console = Console(file=(file := StringIO()), width=120)
    console.print(rich_table(data))
    for said in ("forces [N]", "mass [kg]", "[red]", "torque [N·m]", "[b]"):
        assert said in file.getvalue()


def test_names_to_the_left_and_figures_to_the_right() -> None:
    assert [column.justify for column in rich_table(TableData.of("", ("a", "b", "c"))).columns] == [
        "left",
        "right",
        "right",
    ]


def test_what_does_not_fit_the_head_is_refused() -> None:
    with pytest.raises(StaderaError, match="sides 'lr' for 3 columns"):
        TableData.of("", ("a", "b", "c"), sides="lr")
    with pytest.raises(StaderaError, match="a row of 2 cells under 3 titles"):
        TableData.of("", ("a", "b", "c"), [("1", "2")])
