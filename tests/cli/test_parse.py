"""Values of options, parsed."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer

from stadera.cli.parse import counted


def test_a_count_before_a_file_is_a_decimal_number() -> None:
    assert counted("50=a.csv", "--draws") == (50, Path("a.csv"))
    for name in ("out/run=3.csv", "²=a.csv", "٣=a.csv", "a.csv"):
        assert counted(name, "--draws") == (1000, Path(name))
    with pytest.raises(typer.BadParameter):
        counted("0=a.csv", "--draws")
