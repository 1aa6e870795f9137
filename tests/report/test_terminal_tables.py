"""Tables of the terminal show what they are given."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from stadera.report.terminal import titled_table


def test_brackets_in_headings_and_title_are_text() -> None:
    table = titled_table("forces [N]", ("leg", "mass [kg]", "[red]", "torque [N·m]"), "llrr")
    table.add_row("LF", "1", "2", "3")
    console = Console(file=(file := StringIO()), width=120)
    console.print(table)
    for said in ("forces [N]", "mass [kg]", "[red]", "torque [N·m]"):
        assert said in file.getvalue()


def test_names_to_the_left_and_figures_to_the_right() -> None:
    assert [column.justify for column in titled_table("", ("a", "b", "c")).columns] == ["left", "right", "right"]
    with pytest.raises(ValueError, match="shorter"):
        titled_table("", ("a", "b", "c"), "lr")
