"""The demo in the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from stadera.lab.demo import DemoResult
from stadera.lab.demo.schema import true_load
from stadera.lab.experiments.moving.loaded_walk import LoadedWalkOutcome
from stadera.report.numbers import number, with_std
from stadera.report.table import TableData
from stadera.report.terminal import rich_table
from stadera.report.weigh.tables import place
from stadera.supervise import State

_CM = 100.0


def demo_tables(result: DemoResult) -> Iterator[RenderableType]:
    """How both runs went, what was weighed, and what the supervisor did."""
    yield Text(headline(result), style="bold")
    yield rich_table(comparison_table(result))
    identified = result.identified.outcome
    if identified.payload is not None:
        yield rich_table(load_table(identified))
    if identified.transitions:
        yield rich_table(log_table(identified))


def headline(result: DemoResult) -> str:
    """What happened, in one sentence."""
    failed, went = verdict(result.without.outcome), verdict(result.identified.outcome)
    how = "Weighed on the way" if result.settings.nonstop else "With it"
    return f"Without identification {failed}. {how}, {went}."


def verdict(outcome: LoadedWalkOutcome) -> str:
    """How a run went, in half a sentence."""
    if outcome.fall is not None:
        return f"the robot fell after {outcome.fall.time - outcome.loaded_at:.1f} s ({outcome.fall.how})"
    if outcome.state in (State.STANDING, State.SITTING):
        return f"the robot is left {outcome.state}: {outcome.transitions[-1].reason}"
    if outcome.least_margin < 0.0:
        return (
            f"the robot's centre of mass left the support polygon by {-_CM * outcome.least_margin:.1f} cm, for "
            f"{outcome.outside:.1f} s in all"
        )
    return f"its centre of mass stayed {_CM * outcome.least_margin:.1f} cm and more inside the support polygon"


def comparison_table(result: DemoResult) -> TableData:
    """What was seen in both runs."""
    head = ("since the load came on", *(run.name for run in result.runs))
    return TableData.of("The same walk twice", head, _comparison(result))


def load_table(outcome: LoadedWalkOutcome) -> TableData:
    """Mass and centre of mass of the payload as weighed, and the truth."""
    head = ("trunk frame", "mass [kg]", "com x [m]", "com y [m]", "com z [m]")
    return TableData.of("The load", head, _weighed(outcome))


def log_table(outcome: LoadedWalkOutcome) -> TableData:
    """When the supervisor changed its state, and why."""
    rows = ((f"{t.time:.2f}", str(t.after), t.reason) for t in outcome.transitions)
    return TableData.of("What the supervisor did", ("time [s]", "state", "because"), rows, sides="lww")


def _comparison(result: DemoResult) -> Iterator[tuple[str, str, str]]:
    """A name, then a text for each run."""

    def each(name: str, shown: Any) -> tuple[str, str, str]:
        return name, shown(result.without.outcome), shown(result.identified.outcome)

    yield each("fell", lambda o: "no" if o.fall is None else f"at {o.fall.time:.1f} s")
    yield each("least margin of the true centre of mass [cm]", lambda o: f"{_CM * o.least_margin:.1f}")
    yield each("time outside the support polygon [s]", lambda o: f"{o.outside:.2f}")
    yield each("way walked since the load [m]", lambda o: f"{o.way:.2f}")
    yield each("steps lost", lambda o: "–" if o.fall else str(o.steps_lost))
    yield each("error of the trunk's mass in the controller [kg]", lambda o: f"{o.model.mass - o.truth.mass:+.2f}")
    yield each(
        "error of its centre of mass in x-y, the same [cm]",
        lambda o: f"{_CM * float(np.linalg.norm((o.model.com_trunk - o.truth.com)[:2])):.2f}",
    )


def _weighed(outcome: LoadedWalkOutcome) -> Iterator[tuple[str, ...]]:
    payload, load = outcome.payload, true_load(outcome)
    if payload is not None:
        mass = with_std(payload.mass, payload.mass_std)
        yield "payload as weighed", mass, *place(payload.com, payload.com_std)
    yield "truth", number(load.mass), *(number(round(c, 5)) for c in load.com.tolist())
