"""Terminal output of the demo."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from stadera.lab.demo import DemoResult
from stadera.lab.demo.schema import true_load
from stadera.lab.experiments.loaded_walk import LoadedWalkOutcome, WalkOutcome
from stadera.report.numbers import number, with_std
from stadera.report.table import Cell, Row, TableData, rich_table
from stadera.report.weigh.tables import place

NAMES = ("without identification", "with identification")
"""Names of the two runs."""


def demo_tables(result: DemoResult) -> Iterator[RenderableType]:
    """Outcomes of both runs, the estimated payload, and the supervisor's actions."""
    worked = result.identified.outcome.verdict.outcome is WalkOutcome.WALKED
    yield Text(headline(result), style="bold" if worked else "bold red")
    yield rich_table(comparison_table(result))
    identified = result.identified.outcome
    if identified.payload is not None:
        yield rich_table(load_table(identified))
    if identified.transitions:
        yield rich_table(log_table(identified))


def headline(result: DemoResult) -> str:
    """Summary in two sentences."""
    without, identified = result.without.outcome, result.identified.outcome
    payload = identified.payload
    weighed = "" if payload is None else f", having weighed {with_std(payload.mass, payload.mass_std)} kg"
    return f"Without identification it {_ended(without)}. With it, it {_ended(identified)}{weighed}."


def _ended(outcome: LoadedWalkOutcome) -> str:
    """Outcome of a run, as the end of a sentence."""
    trace = outcome.trace
    match outcome.verdict.outcome:
        case WalkOutcome.FELL:
            return f"falls after {trace.time[-1] - trace.loaded_at:.1f} s"
        case WalkOutcome.STUCK:
            return f"gets stuck after {trace.distance:.2f} m: {outcome.verdict.reasons[0]}"
        case WalkOutcome.WALKED if trace.steps_lost:
            return f"walks on after {outcome.updated_after or np.nan:.1f} s, {trace.steps_lost} steps lost"
        case WalkOutcome.WALKED:
            return "walks on without a stop"


def comparison_table(result: DemoResult) -> TableData:
    head = ("since the box was let go", *NAMES)
    return TableData.of("The same walk twice", head, _comparison(result))


def load_table(outcome: LoadedWalkOutcome) -> TableData:
    """Mass and centre of mass of the estimated payload, and the truth."""
    head = ("trunk frame", "mass [kg]", "com x [m]", "com y [m]", "com z [m]")
    return TableData.of("The box", head, _weighed(outcome))


def log_table(outcome: LoadedWalkOutcome) -> TableData:
    """Changes of the supervisor's state, and their reasons."""
    rows = ((f"{t.time:.2f}", str(t.after), t.reason) for t in outcome.transitions)
    return TableData.of("What the supervisor did", ("time [s]", "state", "because"), rows, sides="lww")


def _comparison(result: DemoResult) -> Iterator[Row]:
    """Yields rows of a name and a cell for each run."""

    def each(name: str, shown: Callable[[LoadedWalkOutcome], str | Cell]) -> Row:
        return name, shown(result.without.outcome), shown(result.identified.outcome)

    def ended(outcome: LoadedWalkOutcome) -> Cell:
        verdict = outcome.verdict
        return Cell(str(verdict.outcome), strong=True, good=verdict.outcome is WalkOutcome.WALKED)

    def lost(outcome: LoadedWalkOutcome) -> str:
        return "–" if outcome.trace.fall else str(outcome.trace.steps_lost)

    def ahead(outcome: LoadedWalkOutcome) -> str:
        trace = outcome.trace
        return f"{trace.distance:.2f}" + ("" if trace.fall else f" of {trace.commanded:.2f}")

    yield each("outcome", ended)
    yield each("because", lambda o: "; ".join(o.verdict.reasons) or "–")
    yield each("got ahead, of what was commanded [m]", ahead)
    yield each("steps lost", lost)
    yield each("least margin of the true centre of mass [cm]", lambda o: f"{100.0 * o.least_margin_ever:.1f}")
    yield each("error of the trunk's mass in the controller [kg]", lambda o: f"{o.model.mass - o.truth.mass:+.2f}")
    yield each(
        "error of its centre of mass in x-y, the same [cm]",
        lambda o: f"{100.0 * float(np.linalg.norm((o.model.com_trunk - o.truth.com)[:2])):.2f}",
    )


def _weighed(outcome: LoadedWalkOutcome) -> Iterator[tuple[str, ...]]:
    payload, load = outcome.payload, true_load(outcome)
    if payload is not None:
        mass = with_std(payload.mass, payload.mass_std)
        yield "as weighed", mass, *place(payload.com, payload.com_std)
    yield "truth", number(load.mass), *(number(round(c, 5)) for c in load.com.tolist())
