"""Terminal output of a weighing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.text import Text

from stadera.report.shown import SHOWN
from stadera.report.terminal import notes, rich_table
from stadera.report.trust import LEVELS, STYLES, trust_text
from stadera.report.weigh.tables import (
    bodies_table,
    changes_table,
    headline,
    inertia_missing,
    inertia_table,
    lag_text,
)
from stadera.weigh.result import Weighing

if TYPE_CHECKING:
    from stadera.weigh.truth import Truth


def weighing_tables(result: Weighing, truth: Truth | None = None) -> Iterator[RenderableType]:
    """Trunk and payload, changes of the load, notes, times without estimate; the answer and its trust last."""
    used = result.end - result.begin - result.refused
    span = f"estimated from {used:.1f} of {result.end - result.begin:.1f} s, as known at {result.time:.2f} s"
    yield Text(f"{result.robot.name}, {result.source}: {span}; {result.status}", style="bold")
    yield rich_table(bodies_table(result, truth))
    if (inertia := inertia_table(result)) is not None:
        yield rich_table(inertia)
    if result.changes:
        yield rich_table(changes_table(result))
    if missing := inertia_missing(result):
        yield Text(missing, style="dim")
    if result.torque_lag is not None:
        yield Text(lag_text(result.torque_lag), style="dim")
    yield from notes(result.notes)
    yield from _refusals(result)
    yield Text(
        f"{headline(result)}; trust: {trust_text(result.trust)}",
        style="bold" if result.trust.verdict == "good" else STYLES[LEVELS[result.trust.verdict]],
    )


def _refusals(result: Weighing) -> Iterator[Text]:
    """The longest periods that were not used, and why."""
    longest = sorted(result.refusals, key=lambda r: r.begin - r.end)[: SHOWN.reasons]
    for refusal in sorted(longest, key=lambda r: r.begin):
        yield Text(f"not used: {refusal.begin:.2f} to {refusal.end:.2f} s: {refusal.reason}", style="yellow")
    if (more := len(result.refusals) - len(longest)) > 0:
        yield Text(f"and {more} shorter times", style="yellow")
