"""How a number is shown: with its unit, its standard deviation, and whether the data measured it."""

from __future__ import annotations

from dataclasses import dataclass

from stadera.identify.observability import Verdict
from stadera.identify.result import Quantity
from stadera.report.numbers import number, with_std

NOT_MEASURED = "not measured"
_UNMOVED = 1e-6  # relative: below this a value counts as the prior's own


@dataclass(frozen=True)
class Mark:
    """What stands for a verdict: a symbol and a word beside the colour, so that colour is never the only carrier."""

    symbol: str
    word: str
    colour: str  # of Table I, as rich and CSS both know it


MARKS: dict[Verdict, Mark] = {
    Verdict.OBSERVABLE: Mark("●", "observable", "green"),
    Verdict.PARTIAL: Mark("◐", "partial", "gray"),
    Verdict.UNOBSERVABLE: Mark("○", "unobservable", "red"),
}

MODEL_NAMES: dict[str, str] = {"identified": "identified", "prior_friction": "CAD + friction", "prior": "CAD"}
"""Models that are compared, best first, in words."""


def is_held(quantity: Quantity) -> bool:
    """Whether the value is the prior's because the data do not tell it: nothing to put a standard deviation on."""
    if quantity.std is None or quantity.verdict is Verdict.UNOBSERVABLE:
        return True
    return quantity.verdict is Verdict.PARTIAL and quantity.std <= 1e-12 * abs(quantity.prior)


def shown(quantity: Quantity, prior: str = "CAD") -> str:
    """A found value as text, without its unit. One that the data do not tell is never shown as if measured: it is the
    prior's, or, where links' consistency or the prior moved it along with what was measured, a value said to be none.
    """
    if not is_held(quantity) and quantity.std is not None:
        return with_std(quantity.value, quantity.std)
    if abs(quantity.value - quantity.prior) <= _UNMOVED * abs(quantity.prior):
        return f"{prior}, {NOT_MEASURED}"
    return f"{NOT_MEASURED} ({number(quantity.value, 3)})"
