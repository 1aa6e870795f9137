"""Formats an identified value: with its standard deviation, or as not measured."""

from __future__ import annotations

from stadera.constants import SAME
from stadera.identify.result import Quantity
from stadera.report.numbers import number, with_std
from stadera.report.table import Cell

NOT_MEASURED = "not measured"

MODEL_NAMES: dict[str, str] = {"identified": "identified", "prior_friction": "CAD + friction", "prior": "CAD"}
"""Names of the compared models, best first."""


def shown(quantity: Quantity, prior: str = "CAD") -> str:
    """The value as text, without its unit.

    A value that was not measured is marked as such: it is the prior's, or in brackets if the prior or physical
    consistency changed it along with measured values.
    """
    if not quantity.is_held and quantity.std is not None:
        return with_std(quantity.value, quantity.std)
    if abs(quantity.value - quantity.prior) <= SAME * abs(quantity.prior):
        return f"{prior}, {NOT_MEASURED}"
    return f"{NOT_MEASURED} ({number(quantity.value, 3)})"


def compact_cell(quantity: Quantity) -> Cell:
    """Value and prior in one cell."""
    return Cell(shown(quantity, "prior"), quantity.verdict, note=f"[{number(quantity.prior, 3)}]")


def row(name: str, quantity: Quantity, prior: str = "CAD") -> tuple[Cell, ...]:
    """Name with unit, prior, and the value with its standard deviation."""
    held = quantity.is_held
    named = Cell(name, quantity.verdict, note=f"[{quantity.unit}]")
    return named, Cell(number(quantity.prior, 3)), Cell(shown(quantity, prior), strong=not held, muted=held)
